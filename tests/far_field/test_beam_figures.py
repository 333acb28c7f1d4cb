"""Beam figures of a cone of light whose intensity falls linearly from its axis: every width is known."""

import numpy as np
import pytest

from lensforge.far_field.beam_figures import CandelaTables, Direction
from lensforge.records import Metric
from lensforge.sources.intensity import TabulatedIntensity

PEAK_CD, EDGE_DEG = 100.0, 50.0
C_DEG = np.linspace(0.0, 360.0, 9)
SCALES = (0.98, 1.0, 1.03)


def cone(scale=1.0, step_deg=10.0):
    gamma = np.arange(0.0, 90.1, step_deg)
    falling = PEAK_CD * scale * np.maximum(1.0 - gamma / EDGE_DEG, 0.0)
    return TabulatedIntensity(C_DEG, gamma, np.tile(falling, (len(C_DEG), 1)))


def tables(scales=SCALES, finer=1.0):
    whole = cone()
    return CandelaTables(whole, [cone(scale) for scale in scales], np.stack([whole.values] * 3), cone(finer, 5.0))


def width(level_cd, scale=1.0):
    return 2.0 * EDGE_DEG * (1.0 - level_cd / (PEAK_CD * scale))


def jackknife(values):
    values = np.array(values)
    return np.sqrt((len(values) - 1) ** 2 / len(values) * values.var(ddof=1))


def test_the_error_of_a_figure_is_that_of_the_rays_and_of_the_step():
    axis = tables(finer=1.01).axis_cd
    assert axis.value == PEAK_CD
    assert axis.standard_error == pytest.approx(np.hypot(jackknife([PEAK_CD * s for s in SCALES]), 0.01 * PEAK_CD))
    assert tables(SCALES[:1]).axis_cd.standard_error is None
    two = tables(SCALES[:2]).axis_cd
    assert two.standard_error == pytest.approx(jackknife([98.0, 100.0]))


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_the_error_of_a_width_has_that_of_its_level_too(share):
    peak = Metric(value=PEAK_CD, unit="cd", standard_error=4.0)
    found = tables()._angle(0.0, peak, share)
    level = share * PEAK_CD
    assert found.value == pytest.approx(width(level))
    by_level = (width(share * 96.0) - width(share * 104.0)) / 2.0
    by_rays = jackknife([width(level, scale) for scale in SCALES])
    assert found.standard_error == pytest.approx(np.hypot(by_rays, by_level))


def test_a_level_that_noise_may_lift_above_all_light_leaves_a_width_of_zero_there():
    found = tables((1.0, 1.0))._angle(0.0, Metric(value=PEAK_CD, unit="cd", standard_error=50.0), 0.95)
    assert found.standard_error == pytest.approx(0.5 * (width(0.95 * 50.0) - 0.0))


def test_no_width_errs_by_more_than_the_table_and_by_steps_no_more_than_two_of_them():
    noisy = Metric(value=PEAK_CD, unit="cd", standard_error=99.9)
    assert tables((0.6, 1.0, 1.9))._angle(0.0, noisy, 0.5).standard_error == pytest.approx(np.hypot(
        jackknife([width(50.0, 0.6), width(50.0), width(50.0, 1.9)]), 0.5 * (width(0.05) - width(99.95))
    ))  # fmt: skip
    assert tables((0.51, 1.0, 9.0))._angle(0.0, noisy, 0.5).standard_error <= 180.0
    other_steps = tables((1.0, 1.0), finer=0.6)
    found = other_steps._angle(0.0, Metric(value=PEAK_CD, unit="cd", standard_error=0.0), 0.5)
    assert found.standard_error == pytest.approx(min(width(50.0) - width(50.0, 0.6), 2 * 10.0))


def test_without_light_above_the_level_there_is_no_width():
    assert tables()._angle(0.0, Metric(value=3 * PEAK_CD, unit="cd", standard_error=1.0), 0.5) is None


def test_the_peak_is_where_the_table_has_it():
    values = cone().values.copy()
    values[3, 2] = 500.0
    whole = TabulatedIntensity(C_DEG, cone().gamma_deg, values)
    made = CandelaTables(whole, [], np.stack([values]), whole)
    assert made.peak_direction == Direction(c_deg=135.0, gamma_deg=20.0)
    assert tables().peak_direction == Direction(c_deg=0.0, gamma_deg=0.0)
