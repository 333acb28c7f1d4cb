"""A playing field by a lens: one figure in evaluation, photometry and file, and on pixels in a search."""

from pathlib import Path

import numpy as np
from application_pixels import judged_both_ways, values_of
from playing_field import FIELD
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.addons.sports.sports_light import SportsLight
from lensforge.light.by_intensities import of_file
from lensforge.sources.photometric.photometric_io import read_photometric
from lensforge.spec import Spec


def spec_of(lamp_lm: float) -> Spec:
    far = {"kind": "far_field", "name": "sky", "half_angle_deg": 90.0, "targets": [{"kind": "beam", "fwhm_deg": 60.0}]}
    return small_spec(target=None, receivers=[far], sports=[FIELD | {"lamp_lm": lamp_lm, "maintenance_factor": 0.9}])


def test_the_evaluation_the_photometry_and_the_file_have_one_figure(tmp_path: Path) -> None:
    spec = spec_of(200_000.0).replace(evaluate={"rays": 1024, "pixels": 16, "window_mm": None})
    preset = FEW.replace("sports", photometry_rays=(2**12, 2**12))
    lens = lf.Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), spec, 3, preset)
    light, far = lf.evaluate(lens), lf.photometry(lens)
    (field,) = far.sports
    by_light = [(limit.label, limit.value, limit.standard_error) for limit in light.limits]
    assert by_light == [(f"field: {limit.label}", limit.value, limit.standard_error) for limit in field.limits]
    assert len(by_light) == 3 and all(error > 0.0 for _, _, error in by_light)
    far.save(tmp_path / "lens.ies")
    file = read_photometric(tmp_path / "lens.ies")
    lamp = of_file(file, -spec.photometry.street_side_deg, 200_000.0)
    read = SportsLight(spec.sports[0]).judged(lamp, "field")
    figures, stated = ([limit.metric.value for limit in judged.limits] for judged in (read, field))
    np.testing.assert_allclose(figures, stated, rtol=2e-4)


def intensity(azimuth: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """A crooked beam (cd) that is wide for its pixels."""
    lobe = np.exp(-((gamma / 0.5) ** 2)) * (1.0 + 0.5 * np.sin(gamma) * np.cos(azimuth - 0.5))
    return 50_000.0 * lobe + 500.0 * np.cos(gamma)


def test_pixels_of_the_far_field_read_the_same_field() -> None:
    spec = spec_of(1.0)
    by_pixels, by_table = judged_both_ways(spec, intensity, 256)
    np.testing.assert_allclose(values_of(by_pixels), values_of(by_table), rtol=0.01)
