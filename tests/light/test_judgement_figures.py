"""Figures that judge the light of a few known pictures: limits, regions, and changes from lens to lens."""

import numpy as np
import pytest
from scipy import sparse

from lensforge.light.judged_limits import limit_value
from lensforge.light.region_light import RegionLight, bright_region
from lensforge.light.simulation import ReplicateMetrics
from lensforge.results import Metric
from lensforge.results.estimates import ExtremeEstimate, PairEstimate, RootEstimate, debiased_minimum, uniformity
from lensforge.scene.limit_readings import LightLimit
from lensforge.spec.quantities import (
    BeamAngle,
    FluxShare,
    LeastOverMean,
    LeastOverMost,
    LostShare,
    PlaceLight,
    Quantity,
    RelativeLight,
)

IMAGES = np.array([[[1.0, 2.0, 4.0]], [[3.0, 2.0, 2.0]], [[2.0, 2.0, 3.0]]]) / 10.0  # means 0.2, 0.2, 0.3
PER_FLUX = 0.5
QUANTITIES: dict[str, Quantity] = {
    "light": PlaceLight(), "relative": RelativeLight(), "share": FluxShare(), "loss": LostShare(),
    "min_over_mean": LeastOverMean(), "min_over_max": LeastOverMost(),
}  # fmt: skip


def value_of(quantity: str, sense: str = ">=", rows: int = 3, images: np.ndarray = IMAGES) -> Metric:
    """The value that decides a limit on the first pixels, each with half its flux as light."""
    readings = sparse.csr_array(PER_FLUX * np.eye(3)[:rows])
    kinds = {**QUANTITIES, "beam_angle": BeamAngle(np.array([-1.0, 0.0, 2.0])[:rows], 0.5)}
    limit = LightLimit("a", 0, kinds[quantity], sense, "lx", readings, 0.3)  # type: ignore[arg-type]
    return limit_value(limit, images)


def test_the_value_that_decides_is_the_least_or_the_largest_of_the_mean() -> None:
    assert value_of("light").value == pytest.approx(0.1) and value_of("light").unit == "lx"
    assert value_of("light", "<=").value == pytest.approx(0.15)
    assert value_of("relative", rows=2).value == pytest.approx(0.2 / 0.3), "the maximum is that of the whole picture"
    assert value_of("relative", "<=", rows=2).value == pytest.approx(0.2 / 0.3)
    assert value_of("relative", "<=").value == pytest.approx(1.0)
    for sense in (">=", "<="):
        assert value_of("min_over_max", sense, rows=2).value == pytest.approx(1.0)
        assert value_of("min_over_max", sense).value == pytest.approx(0.2 / 0.3)
    relative = [image[0] / image[0].mean() for image in IMAGES]
    assert value_of("min_over_mean", "<=").value == pytest.approx(np.mean(relative, axis=0).min())
    share = value_of("share", rows=1)
    assert share.value == pytest.approx(PER_FLUX * 0.2)
    assert share.standard_error == pytest.approx(PER_FLUX * np.std([0.1, 0.3, 0.2], ddof=1) / np.sqrt(3.0))


def test_a_beam_angle_is_read_at_its_level_and_is_0_in_the_dark() -> None:
    """Light of 0.1, 0.1 and 0.15 at -1, 0 and 2 degrees is above half of its maximum everywhere."""
    assert value_of("beam_angle") == Metric(value=3.0, unit="lx", standard_error=value_of("beam_angle").standard_error)
    assert value_of("beam_angle", images=0.0 * IMAGES).value == 0.0
    one_side = np.array([[[0.0, 1.0, 1.0]]] * 2)
    assert value_of("beam_angle", images=one_side).value == pytest.approx(2.5), "half-way between 0 and the maximum"


def test_a_region_is_bright_above_half_of_the_maximum_and_not_where_it_has_just_half() -> None:
    assert bright_region(np.array([[1.0, 0.5, 0.5 + 1e-6, 0.4, 0.0]])).tolist() == [[True, False, True, False, False]]


def test_light_of_a_region_is_that_of_its_pixels() -> None:
    images = np.array([[[1.0, 2.0, 9.0]], [[2.0, 6.0, 9.0]]]) / 10.0
    target = np.array([[1.0, 0.8, 0.1]])
    light = RegionLight.of(images, target, None, "lx")
    assert light is not None and light.mean.value == pytest.approx(0.275) and light.mean.unit == "lx"
    assert light.mean.standard_error == pytest.approx(np.std([0.15, 0.4], ddof=1) / np.sqrt(2.0))
    assert light.u0.value == pytest.approx(0.15 / 0.275)
    assert light.u1.value == pytest.approx(0.15 / 0.4)
    assert RegionLight.of(images * [[[0.0]], [[1.0]]], target, None, "lx") is None
    masked = RegionLight.of(images, target, np.array([[False, False, True]]), "lx")
    assert masked is not None and masked.region == "uniform" and masked.mean.value == pytest.approx(0.9)


def box(rows: slice, columns: slice) -> np.ndarray:
    """A region on 70 x 120 pixels."""
    mask = np.zeros((70, 120), dtype=bool)
    mask[rows, columns] = True
    return mask


def test_the_peak_is_that_of_known_light() -> None:
    """Light that falls from 1 by 1 % a row, half of it on the rim of the target, and a stripe of 1.4 beside it."""
    target = box(slice(7, 67), slice(10, 110)).astype(float)
    light = np.where(target > 0.0, 1.0 - 0.01 * np.arange(70)[:, None] + 0.07, 0.0)
    rim = box(slice(7, 67), slice(10, 110)) & ~box(slice(9, 65), slice(12, 108))
    light[rim] *= 0.5
    light[2:5, 60:100] = 1.4
    peak = 1.4 / (light.sum() / target.sum())
    exact = RegionLight.of(np.stack([light] * 16), target, None, "lx")
    assert exact is not None and exact.peak.value == pytest.approx(peak, rel=1e-12)
    noisy = np.random.default_rng(1).poisson(200.0 * light, (16, 70, 120)).astype(float)
    region = RegionLight.of(noisy, 3.0 * target, None, "lx")
    assert region is not None and region.peak.standard_error and 0.0 < region.peak.standard_error < 0.05
    mean = noisy.mean(axis=0)
    assert abs(region.peak.value - peak) < 3.0 * region.peak.standard_error
    assert abs(region.peak.value - peak) <= abs(mean.max() / mean.sum() * target.sum() - peak)


def test_the_error_of_a_change_is_that_of_what_both_lenses_do_not_share() -> None:
    """By each replicate as much more is a change without error; rounding is none."""
    shares = np.array([0.1, 0.2, 0.3, 0.2])
    apart = np.diag(np.full(4, 0.1))
    even = ExtremeEstimate(0.5, np.array([0.4, 0.7, 0.6, 0.5]))
    before = ReplicateMetrics(PairEstimate(0.1, apart), even, RootEstimate(0.2, 2.0 * apart), shares)
    after = ReplicateMetrics(PairEstimate(0.4, apart), even, RootEstimate(0.3, 2.0 * apart), shares + 0.1)
    change = after.change_from(before)
    for name, value in (("nmse", 0.3), ("rsd", 0.1), ("efficiency", 0.1), ("uniformity", 0.0)):
        assert getattr(change, name).value == pytest.approx(value)
        assert getattr(change, name).standard_error == pytest.approx(0.0, abs=1e-15)
    rounded = ReplicateMetrics(PairEstimate(0.1 + 1e-16, apart), None, None, shares + np.array([1e-16, 0.0, 0.0, 0.0]))
    for metric in (rounded.change_from(before).nmse, rounded.change_from(before).efficiency):
        assert metric == Metric(value=0.0, standard_error=0.0)
    scattered = ReplicateMetrics(PairEstimate(0.4), None, None, shares[::-1] * np.array([1.0, 2.0, 1.0, 1.0]))
    other = scattered.change_from(before)
    assert other.efficiency.standard_error == pytest.approx((scattered.efficiency - shares).std(ddof=1) / 2.0)
    assert other.nmse.standard_error is None and other.uniformity is None and other.rsd is None
    assert before.change_from(scattered).nmse == Metric(value=0.1 - 0.4)
    assert before.change_from(scattered).uniformity is None and before.change_from(scattered).rsd is None


def test_each_figure_changes_from_the_designed_value_of_its_own() -> None:
    """By few rays both clip: the uniformity rises by 0.3 from 0.9 to 1, the RSD by squares falls from 0.6 to 0."""
    apart = np.diag(np.full(4, 1e-6))

    def light(least: float, square: float) -> ReplicateMetrics:
        rsd = RootEstimate(square**0.5, apart, PairEstimate(square, apart))
        return ReplicateMetrics(PairEstimate(0.1, apart), ExtremeEstimate(least), rsd, np.full(4, 0.5))

    before = light(0.4, 0.5)
    after = light(0.7, 0.1)
    change = after.change_from(before, designed_rsd=0.6, designed_uniformity=0.9)
    assert change.uniformity.value == pytest.approx(0.1) and change.rsd.value == pytest.approx(-0.6)
    unknown = after.change_from(before)
    assert unknown.uniformity.value == pytest.approx(0.3) and unknown.rsd.value == pytest.approx(0.1**0.5 - 0.5**0.5)


def test_changes_by_common_rays_scatter_by_what_is_stated_however_noisy_both_lights_are() -> None:
    """The noise of either is 4,000 times that of the change, of which there are 16 replicates."""
    chance = np.random.default_rng(2)
    dark = PairEstimate(0.0), None, None
    changes = []
    for _ in range(200):
        before = chance.normal(0.9, 4e-3, 16)
        after = before + chance.normal(1e-4, 1e-6, 16)
        change = ReplicateMetrics(*dark, after).change_from(ReplicateMetrics(*dark, before)).efficiency
        changes.append((change.value, change.standard_error))
    values, stated = np.array(changes).T
    truth = 1e-6 / np.sqrt(16.0)
    # The scatter of 200 is known to 5 %, the stated rms to 1.3 %.
    assert values.std(ddof=1) == pytest.approx(truth, rel=0.2)
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(truth, rel=0.05)


def test_metrics_of_replicates_are_those_in_the_mask() -> None:
    images = np.random.default_rng(1).uniform(0.5, 1.5, (5, 2, 3))
    mask = np.array([[True, True, False], [True, False, False]])
    target = np.ones((2, 3))
    metrics = ReplicateMetrics.of(images, target, mask, np.full(5, 0.25)).metrics()
    assert metrics.uniformity is not None and metrics.uniformity.value == uniformity(images.mean(axis=0), mask)
    assert metrics.efficiency == Metric(value=0.25, standard_error=0.0)
    alone = ReplicateMetrics.of(images, target, None, np.full(5, 0.25)).metrics()
    assert alone.uniformity is None and alone.rsd is None and alone.nmse == metrics.nmse
    assert debiased_minimum(images[:, mask]).value == pytest.approx(images.mean(axis=0)[mask].min())
