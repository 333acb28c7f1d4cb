"""Glare of an office by a lens: one figure in evaluation, photometry and file, and on pixels in a search."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from application_pixels import judged_both_ways, values_of
from cie_luminaire import OFFICE
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.addons.office.office_light import OfficeLight
from lensforge.light.angular_grid import AngularGrid
from lensforge.light.by_intensities import of_file, of_lens
from lensforge.light.luminaire_classes import LampLight
from lensforge.scene.application_light import light_in
from lensforge.sources.photometric.photometric_io import read_photometric
from lensforge.spec import Spec

FAR = {"kind": "beam", "fwhm_deg": 60.0, "half_angle_deg": 90.0}
ON_PLANE = OFFICE | {"pitch_m": (2.4, 1.8), "mean_lx": 100.0, "uniformity": 0.3, "lamp_lm": 3000.0}


def spec_of(*offices: dict) -> Spec:
    far = {"kind": "far_field", "name": "sky", "half_angle_deg": 90.0, "targets": [{"kind": "beam", "fwhm_deg": 60.0}]}
    return small_spec(target=None, receivers=[far], offices=list(offices))


def test_the_evaluation_the_photometry_and_the_file_have_one_figure(tmp_path: Path) -> None:
    """Two offices that differ, of a lens without symmetry: value and error of each limit; the file knows no error."""
    dark = {"reflectances": "30/30/20", "room": "4H 4H", "name": "dark"}
    spec = spec_of(ON_PLANE, OFFICE | dark | {"lamp_lm": 2000.0})
    spec = spec.replace(evaluate={"rays": 1024, "pixels": 16, "window_mm": None})
    preset = FEW.replace("offices", photometry_rays=(2**12, 2**12))
    lens = lf.Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), spec, 3, preset)
    light, far = lf.evaluate(lens), lf.photometry(lens)
    by_light = [(limit.label, limit.value, limit.standard_error) for limit in light.limits]
    named = [(f"{office.name}: {limit.label}", limit) for office in far.offices for limit in office.limits]
    assert by_light == [(name, limit.value, limit.standard_error) for name, limit in named]
    assert len(named) == 6 and all(error > 0.0 for _, _, error in by_light)
    far.save(tmp_path / "lens.ies")
    file = read_photometric(tmp_path / "lens.ies")
    for entry, stated in zip(spec.offices, far.offices, strict=True):
        read = OfficeLight(entry).judged(of_file(file, -spec.photometry.street_side_deg, entry.lamp_lm), "o")
        pairs = zip(read.limits, stated.limits, strict=True)
        np.testing.assert_allclose(*zip(*((a.metric.value, b.metric.value) for a, b in pairs), strict=True), rtol=2e-4)


def intensity(azimuth: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """A wide crooked lobe (cd)."""
    return 900.0 * np.cos(np.minimum(gamma, 1.5)) ** 1.5 * (1.0 + 0.6 * np.sin(gamma) * np.cos(azimuth - 0.5))


@pytest.mark.parametrize(("pixels", "most"), [(128, 0.02), (512, 0.004)])
def test_pixels_of_the_far_field_read_the_same_office(pixels: int, most: float) -> None:
    spec = spec_of(ON_PLANE | {"lamp_lm": 1.0})
    by_pixels, by_table = judged_both_ways(spec, intensity, pixels, gamma_nodes=181)
    assert [limit.label for limit in by_pixels] == [f"office: {limit.label}" for limit in by_table]
    np.testing.assert_allclose(values_of(by_pixels), values_of(by_table), rtol=most)


def test_screen_tells_each_figure_of_the_office_that_has_it_worst() -> None:
    """And a limit that is missed has its remedy."""
    spec = spec_of(OFFICE | {"name": "low"}, OFFICE | {"name": "high", "room": "2H 2H"})
    lamp = LampLight(AngularGrid(4, np.array([0.0, 90.0])), np.full((2, 4, 2), 3000.0), 90.0)
    judged = [light_in(entry).judged(of_lens(lamp, 1.0), entry.name) for entry in spec.offices]
    limits = [replace(limit, label=f"{office.name}: {limit.label}") for office in judged for limit in office.limits]
    group = OfficeLight.worst(spec.offices, limits)
    first, *figures = group.facts
    assert group.title == "Offices" and first.value == "UGR 19 in 4H 8H, 70/50/20; UGR 19 in 2H 2H, 70/50/20"
    larger = max(judged, key=lambda office: office.crosswise.value)
    assert [fact.value for fact in figures] == [larger.crosswise.value, larger.endwise.value]
    assert figures[0].note == f"worst: {larger.name}" and figures[0].state == "fail"
    assert "larger luminous_m" in next(iter(OfficeLight(spec.offices[0]).with_remedies(limits))).remedy
