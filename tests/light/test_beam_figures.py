"""Beam figures of a cone of light whose intensity falls linearly from its axis: every width is known."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import small_spec

from lensforge.light import angular_grid
from lensforge.light.angular_grid import AngularGrid, FittedIntensity, Rival, _Candidate, _chosen, _Pyramid
from lensforge.light.photometry_result import CandelaTables, Direction
from lensforge.light.plane_figures import PlaneFigures
from lensforge.results import Metric
from lensforge.results.estimates import ExtremeEstimate
from lensforge.sources.intensity import TabulatedIntensity

PEAK_CD = 100.0
EDGE_DEG = 50.0
C_DEG = np.linspace(0.0, 360.0, 9)
SCALES = (0.98, 1.0, 1.03, 1.01)  # of a half of the rays and of the other one, twice
FIGURES = ("peak_cd", "beam_angle_deg", "field_angle_deg")


def cone(scale=1.0, step_deg=10.0):
    gamma = np.arange(0.0, 90.1, step_deg)
    falling = PEAK_CD * scale * np.maximum(1.0 - gamma / EDGE_DEG, 0.0)
    return TabulatedIntensity(C_DEG, gamma, np.tile(falling, (len(C_DEG), 1)))


def tables(scales=SCALES):
    whole = cone()
    return CandelaTables(whole, [cone(scale) for scale in scales], np.stack([whole.values] * 3))


def width(level_cd, scale=1.0):
    return 2.0 * EDGE_DEG * (1.0 - level_cd / (PEAK_CD * scale))


def by_halves(first, second, third, fourth):
    return 0.5 * np.sqrt(((first - second) ** 2 + (third - fourth) ** 2) / 2.0)


def test_the_doubts_of_all_steps_towards_the_chosen_table_count(monkeypatch):
    """Of levels whose gains over the step before have an error of 1: chances by the Gaussian integral."""
    noise = np.diag(np.linspace(-1.0, 1.0, 16)) * 8.0

    def candidate(level, gain):
        return _Candidate(level, np.full((16, 16), gain) + noise)

    steps = {
        (3, 3): [candidate((3, 3), 0.0), candidate((2, 3), 4.0), candidate((3, 2), 1.0)],
        (2, 3): [candidate((2, 3), 0.0), candidate((1, 3), -2.0)],
    }
    monkeypatch.setattr(angular_grid, "_candidates", lambda pyramid, level: steps[level])
    level, others = _chosen(object.__new__(_Pyramid), (3, 3))
    assert level == (2, 3) and [other for other, _ in others] == [(3, 2), (3, 3), (1, 3)]
    assert all(0.0 <= chance < 0.5 for _, chance in others)


@pytest.mark.parametrize(
    ("receiver", "limit", "judged"),
    [
        ({}, {}, True),
        ({"rotation_deg": 30.0}, {}, False),  # its azimuths are no planes C
        ({"axis": [0.0, 0.1, 1.0]}, {}, False),
        ({}, {"azimuth_deg": 180.0}, False),
        ({}, {"level": 0.3}, False),
    ],
)
def test_a_limit_judges_the_beam_angle_of_its_plane_alone(receiver, limit, judged):
    far = {"kind": "far_field", "half_angle_deg": 60.0, "targets": [{"kind": "disc", "diameter_deg": 30.0}]}
    asked = {"kind": "beam_angle", "at_most_deg": 40.0, "azimuth_deg": 270.0}
    spec = small_spec(target=None, receivers=[far | receiver], limits=[asked | limit])
    plane = PlaneFigures(c_deg=90.0, peak_cd=Metric(value=1.0), beam_angle_deg=None, field_angle_deg=None)
    assert plane.is_judged(spec) == judged and not plane.changed(c_deg=45.0).is_judged(spec)


def test_the_error_of_a_figure_is_that_of_the_rays():
    axis = tables().axis_cd
    assert axis.value == PEAK_CD
    assert axis.standard_error == pytest.approx(by_halves(*(PEAK_CD * scale for scale in SCALES)))
    assert tables(()).axis_cd.standard_error is None
    assert tables(SCALES[:2]).axis_cd.standard_error == pytest.approx(1.0)


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_the_error_of_a_width_is_by_halves_each_at_the_level_of_its_peak(share):
    peaks = PEAK_CD * np.array([0.97, 1.02, 1.0, 1.04])
    angle = tables()._angle(0.0, ExtremeEstimate(PEAK_CD, peaks), share)
    assert angle.value == pytest.approx(width(share * PEAK_CD))
    widths = [width(share * peak, scale) for peak, scale in zip(peaks, SCALES, strict=True)]
    assert angle.standard_error == pytest.approx(by_halves(*widths))
    assert tables()._angle(0.0, ExtremeEstimate(PEAK_CD), share).standard_error is None
    assert tables(())._angle(0.0, ExtremeEstimate(PEAK_CD, peaks), share).standard_error is None


def test_without_light_above_the_level_there_is_no_width():
    assert tables()._angle(0.0, ExtremeEstimate(3 * PEAK_CD, np.ones(4)), 0.5) is None


def test_the_peak_is_where_the_table_has_it():
    values = cone().values.copy()
    values[3, 2] = 500.0
    whole = TabulatedIntensity(C_DEG, cone().gamma_deg, values)
    made = CandelaTables(whole, [], np.stack([values]))
    assert made.peak_direction == Direction(c_deg=135.0, gamma_deg=20.0)
    assert tables().peak_direction == Direction(c_deg=0.0, gamma_deg=0.0)
    values[3, 1] = 600.0
    whole = TabulatedIntensity(C_DEG, cone().gamma_deg, values)
    assert CandelaTables(whole, [], values[None]).peak_direction == Direction(c_deg=135.0, gamma_deg=10.0)
    values[3, 0] = 600.0 * (1.0 + 1e-12)  # on the axis, where rounding tells the half-planes apart
    assert CandelaTables(whole, [], values[None]).peak_direction == Direction(c_deg=0.0, gamma_deg=0.0)
    values[:] = 0.0
    values[8, 4] = 1.0
    assert CandelaTables(whole, [], values[None]).peak_direction == Direction(c_deg=0.0, gamma_deg=40.0)


def samples_of(count):
    random = np.random.default_rng(3)
    return random.uniform(1.0, 2.0, (count, 8, 4)) * np.array([4.0, 3.0, 2.0, 0.5])


@pytest.mark.parametrize("count", [1, 5, 16])
def test_tables_of_all_samples_and_of_each_half_are_in_candela_and_turned_over(count):
    grid = AngularGrid(8, np.array([0.0, 20.0, 50.0, 90.0]))
    samples = samples_of(count)
    candela = CandelaTables.of(FittedIntensity(grid, samples, None), 300.0)

    def expected(some):
        values = 300.0 * np.mean(some, axis=0)
        return np.concatenate([values, values[:1]])[::-1]

    np.testing.assert_allclose(candela.whole.values, expected(samples), rtol=1e-9)
    np.testing.assert_allclose(candela.whole.c_deg, np.linspace(0.0, 360.0, 9))
    assert len(candela.by_halves) == (30 if count == 16 else 0)
    pairs = list(zip(candela.by_halves[::2], candela.by_halves[1::2], strict=True))
    for bits, (odd, even) in enumerate(pairs, start=1):
        parity = np.array([(k & bits).bit_count() % 2 for k in range(16)])
        np.testing.assert_allclose(even.values, expected(samples[parity == 0]), rtol=1e-9)
        np.testing.assert_allclose(odd.values, expected(samples[parity == 1]), rtol=1e-9)
    for table, sample in zip(candela.samples, samples, strict=True):
        np.testing.assert_allclose(table, expected(sample[None]), rtol=1e-12)


def test_half_of_the_rays_without_light_tells_no_error():
    grid = AngularGrid(8, np.array([0.0, 20.0, 50.0, 90.0]))
    samples = samples_of(16) * (np.arange(16) % 2)[:, None, None]
    candela = CandelaTables.of(FittedIntensity(grid, samples, None), 300.0)
    assert candela.whole.values.any() and len(candela.by_halves) == 0
    assert candela.axis_cd.standard_error is None


def test_a_plane_has_its_own_peak_and_both_widths():
    """Twice as bright along C 90 - C 270: the other plane has its own peak, half a level and a tenth of it."""
    values = cone().values.copy()
    values[[2, 6]] *= 2.0
    whole = TabulatedIntensity(C_DEG, cone().gamma_deg, values)
    made = CandelaTables(whole, [whole] * 30, np.stack([values] * 16))
    for c_deg, peak in ((0.0, PEAK_CD), (90.0, 2.0 * PEAK_CD)):
        plane = made.plane(c_deg)
        assert plane.c_deg == c_deg and plane.peak_cd.unit == "cd" and plane.beam_angle_deg.unit == "°"
        assert plane.peak_cd.value == pytest.approx(peak)
        assert plane.beam_angle_deg.value == pytest.approx(50.0) and plane.field_angle_deg.value == pytest.approx(90.0)
        assert plane.peak_cd.standard_error == pytest.approx(0.0, abs=1e-9)
        assert plane.beam_angle_deg.standard_error == pytest.approx(0.0, abs=1e-9)


def test_figures_that_other_steps_would_change_know_it_each_by_its_own_change():
    """A rival of another height and width: a sixth of a chance, the root of p (1 - p), of what each figure changes."""
    other = cone(0.7).values + 10.0
    rival = CandelaTables(cone(), [cone()] * 30, np.stack([other] * 16))
    rival = replace(rival, whole=TabulatedIntensity(C_DEG, cone().gamma_deg, other))
    sure = CandelaTables(cone(), [cone(0.98), cone(1.02)] * 15, np.stack([cone().values] * 16))
    doubt = np.sqrt(1.0 / 6.0 * 5.0 / 6.0)
    unsure = replace(sure, rival=rival, doubt=doubt)
    pairs = [(unsure.axis_cd, sure.axis_cd, rival.axis_cd)]
    for c_deg in (0.0, 90.0):
        planes = [tables.plane(c_deg) for tables in (unsure, sure, rival)]
        pairs += [tuple(getattr(plane, name) for plane in planes) for name in FIGURES]
    for figure, alone, changed in pairs:
        assert figure.value == alone.value and abs(changed.value - alone.value) > 1.0
        expected = np.hypot(alone.standard_error, doubt * (changed.value - alone.value))
        assert figure.standard_error == pytest.approx(expected)
    dark = replace(rival, whole=TabulatedIntensity(C_DEG, cone().gamma_deg, 0.0 * other))
    assert replace(unsure, rival=dark).plane(0.0).beam_angle_deg == sure.plane(0.0).beam_angle_deg


def test_the_rival_of_a_far_field_is_in_candela_too():
    grid = AngularGrid(8, np.array([0.0, 20.0, 50.0, 90.0]))
    rival = Rival(FittedIntensity(grid, samples_of(5), None), 0.3)
    candela = CandelaTables.of(FittedIntensity(grid, 2.0 * samples_of(5), None, rival), 300.0)
    assert candela.doubt == 0.3
    np.testing.assert_allclose(candela.rival.whole.values, 0.5 * candela.whole.values, rtol=1e-12)
    assert candela.rival.rival is None
