"""The record of the photometry, field by field, of light that is given: 16 samples without any symmetry."""

import numpy as np
import pytest
from scenes import small_spec, sphere

from lensforge.kernels.fate import Fate
from lensforge.light import far_field
from lensforge.light.angular_grid import AngularGrid, FittedIntensity
from lensforge.light.exit_light import ExitLight, Goniophotometer
from lensforge.light.photometry_export import measure_photometry
from lensforge.light.photometry_result import CandelaTables, Photometry
from lensforge.light.received_flux import CAUSES
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.accuracy import PRESETS

GRID = AngularGrid(8, np.array([0.0, 10.0, 30.0, 50.0, 90.0]))
FALL = np.array([1.0, 0.8, 0.45, 0.2, 0.0])
FLUX_W = 2.0
LM_PER_W = 300.0
SPEC = small_spec(source__luminous_efficacy_lm_per_w=LM_PER_W, source__flux_w=FLUX_W, manufacture__date="2026-03-01")
LENS = Lens.double(sphere(3.0), sphere(6.0), SPEC, seed=5, accuracy="draft")


def light(count: int = 16) -> ExitLight:
    random = np.random.default_rng(0)
    around = np.array([1.0, 1.2, 2.0, 0.9, 0.7, 1.1, 0.5, 0.6])[:, None]
    samples = around * FALL * random.uniform(0.9, 1.1, (count, 8, 5))
    samples[:, :, 0] = samples[:, :1, 0]
    flux = (samples * GRID.solid_angles).sum(axis=(1, 2))
    samples *= 1.5 / flux.mean()
    by_fate = np.arange(1.0, CAUSES + 1.0) * 0.004
    by_fate[Fate.LEFT_LENS] = 1.5
    rays = RayBundle(np.tile([0.0, 0.0, 6.0], (4, 1)), np.tile([0.0, 0.6, 0.8], (4, 1)), np.full(4, 1.5 / 4))
    exit_w = Metric(value=1.5, unit="W", standard_error=0.02 if count > 1 else None)
    return ExitLight(
        640, FittedIntensity(GRID, samples, 0.0123), exit_w, by_fate, rays, np.full((count, 2, 4), 1.5 / 8)
    )


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict:
    """What is asked of the tracing, which returns the given light; ``light`` of it may be replaced."""
    asked: dict = {"light": light()}

    def traced(lens: object, source: object, meter: Goniophotometer, **options: object) -> ExitLight:
        asked.update(options, meter=meter)
        return asked["light"]

    monkeypatch.setattr(far_field, "trace_exit_light", traced)
    return asked


def measured(lens: Lens = LENS, **options: object) -> Photometry:
    return measure_photometry(lens, build_source(lens.spec.source), PRESETS["draft"], **options)


def test_every_field_is_that_of_the_light(asked: dict) -> None:
    photometry = measured(rays=1000)
    given = light()
    assert (asked["rays"], asked["by_itself"], asked["seed"]) == (1000, PRESETS["draft"].photometry_rays, 5)
    assert asked["meter"].sphere_mm == pytest.approx(1.001 * 6.0) and asked["meter"].symmetry == "none"
    assert photometry.inputs == {"lens": LENS.sha256} and (
        photometry.rays,
        photometry.source_w,
        photometry.source_lm,
    ) == (640, 2.0, 600.0)
    for metric, factor, unit in (
        (photometry.exit_w, 1.0, "W"),
        (photometry.exit_lm, 300.0, "lm"),
        (photometry.light_output_ratio, 0.5, ""),
    ):
        assert (metric.value, metric.standard_error) == pytest.approx((1.5 * factor, 0.02 * factor))
        assert metric.unit == unit
    assert photometry.reflected_w == pytest.approx(FLUX_W - given.by_fate_w.sum())
    assert photometry.lost_w.base == given.by_fate_w[Fate.BASE]
    tables = CandelaTables.of(given.intensity, 300.0)
    assert photometry.axis_cd == tables.axis_cd and photometry.peak_direction == tables.peak_direction
    assert (photometry.beam_c0, photometry.beam_c90) == (tables.plane(0.0), tables.plane(90.0))
    assert photometry.beam_c0.peak_cd != photometry.beam_c90.peak_cd
    assert (
        photometry.peak_cd.value == pytest.approx(300.0 * given.intensity.peak.value)
        and photometry.peak_cd.unit == "cd"
    )
    assert (
        photometry.road is None
        and photometry.node_error == given.intensity.node_error
        and photometry.interpolation_error == 0.0123
    )
    np.testing.assert_array_equal(photometry.candela, tables.whole.values)
    assert (photometry.c_deg.tolist(), photometry.gamma_deg.tolist()) == (
        np.linspace(0.0, 360.0, 9).tolist(),
        GRID.gamma_deg.tolist(),
    )
    errors = 300.0 * given.intensity.samples.std(axis=0, ddof=1) / 4.0
    np.testing.assert_allclose(photometry.candela_standard_error, np.concatenate([errors, errors[:1]])[::-1])
    assert photometry.warnings == () and photometry.seconds < 60.0 and len(photometry.criteria) == 4
    text = photometry.ies.decode("ascii")
    assert "[ISSUEDATE] 2026-03-01" in text and "640 rays; standard error" in text and "peak without noise" in text
    sizes = text.split("TILT=NONE")[1].split()
    assert float(sizes[1]) == 600.0 and sorted(map(float, sizes[7:10]))[:2] == pytest.approx([-0.012, -0.012], abs=2e-4)
