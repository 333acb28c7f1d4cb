"""Scatter of parts within cavities and between them, and the capability, against numpy and drawn series."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from lensforge.addons.measure.capability import cp, cpk
from lensforge.addons.measure.part_scatter import PartScatter
from lensforge.addons.measure.part_series import PartSeries
from lensforge.errors import InputError
from lensforge.results import Metric
from lensforge.results.figure import facts_in

PLACES = 40
SHARES = np.random.default_rng(7).dirichlet(np.full(PLACES, 5.0))
UNEQUAL = ("b", "a", "b", "c", "a", "b", "c", "c", "c")  # 3, 2 and 4 parts, not in order


def forms(count: int, seed: int = 1) -> np.ndarray:
    """Forms that are orthonormal over the area."""
    drawn = np.random.default_rng(seed).normal(size=(PLACES, count))
    return np.linalg.qr(np.sqrt(SHARES)[:, None] * drawn)[0].T / np.sqrt(SHARES)


def scattered(cavities: Sequence[str], deviations: np.ndarray) -> PartScatter:
    """Parts called by their numbers."""
    return PartScatter(tuple(map(str, range(len(cavities)))), tuple(cavities), deviations, SHARES)


def series(cavities: tuple[str, ...], seed: int, modes: int = 3, apart: float = 2.0) -> PartScatter:
    """Parts that scatter by 1 in each of ``modes`` forms about cavities that differ by ``apart`` in all places."""
    rng = np.random.default_rng(seed)
    means = {name: apart * np.random.default_rng(ord(name)).normal(size=PLACES) for name in sorted({*cavities})}
    own = rng.normal(size=(len(cavities), modes)) @ forms(modes)
    return scattered(cavities, np.array([means[name] for name in cavities]) + own)


def test_scatter_is_pooled_within_cavities_and_cavities_count_alike() -> None:
    parts = series(UNEQUAL, 5)
    of = {name: parts.deviations[[label == name for label in UNEQUAL]] for name in "bac"}
    within = sum(((rows - rows.mean(axis=0)) ** 2).sum(axis=0) for rows in of.values()) / 6
    np.testing.assert_allclose(parts.at_places, np.sqrt(within))
    assert parts.freedom == 6 and parts.repeats
    repeatability = np.sqrt(SHARES @ within)
    assert parts.repeatability.value == pytest.approx(repeatability)
    means = np.array([rows.mean(axis=0) for rows in of.values()])
    np.testing.assert_allclose(parts.common, means.mean(axis=0))
    np.testing.assert_allclose(parts.weights @ parts.deviations, means.mean(axis=0))
    assert parts.common_error_um == pytest.approx(repeatability * np.sqrt(1 / 3 + 1 / 2 + 1 / 4) / 3.0)
    between = SHARES @ means.var(axis=0, ddof=1) - repeatability**2 * np.mean([1 / 3, 1 / 2, 1 / 4])
    assert parts.between is not None and parts.between.value == pytest.approx(np.sqrt(between))


def test_one_part_of_each_cavity_scatters_about_the_common_face() -> None:
    parts = series(("a", "b", "c", "d"), 2)
    assert not parts.repeats and parts.freedom == 3 and parts.between is None
    np.testing.assert_allclose(parts.at_places, parts.deviations.std(axis=0, ddof=1))
    assert parts.common_error_um == pytest.approx(parts.repeatability.value / 2.0)


@pytest.mark.parametrize("modes", [1, 4])
def test_stated_errors_are_those_of_drawn_series(modes: int) -> None:
    """The truth is a scatter of 1 in each form: a repeatability of the root of their number."""
    drawn = [series(UNEQUAL * 3, seed, modes, 0.5) for seed in range(300)]
    assert np.mean([parts.modes for parts in drawn]) == pytest.approx(modes, rel=0.01)
    scatter = np.array([parts.repeatability.value for parts in drawn])
    stated = np.array([parts.repeatability.standard_error for parts in drawn])
    assert scatter.mean() == pytest.approx(np.sqrt(modes), rel=0.05)
    assert stated.mean() == pytest.approx(scatter.std(), rel=0.12)
    truth = np.mean([0.5 * np.random.default_rng(ord(name)).normal(size=PLACES) for name in "abc"], axis=0)
    errors = [parts.rms(parts.common - truth) for parts in drawn]
    assert np.mean([parts.common_error_um for parts in drawn]) == pytest.approx(
        np.sqrt(np.mean(np.square(errors))), rel=0.1
    )
    means = [0.5 * np.random.default_rng(ord(name)).normal(size=PLACES) for name in "abc"]
    apart = np.sqrt(SHARES @ np.var(means, axis=0, ddof=1))
    pulls = [(parts.between.value - apart) / parts.between.standard_error for parts in drawn]
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_a_contrast_of_the_parts_scatters_as_the_error_of_their_mean() -> None:
    """It holds nothing of what a cavity has in common, and as much of each form."""
    parts = series(UNEQUAL, 4)
    factors = parts.contrast() * parts.weights
    for name in "abc":
        assert factors[[label == name for label in UNEQUAL]].sum() == pytest.approx(0.0, abs=1e-12)
    assert factors @ factors == pytest.approx(parts.weights @ parts.weights)
    drawn = [series(UNEQUAL, seed) for seed in range(300)]
    assert np.mean([s.rms(factors @ s.deviations) ** 2 for s in drawn]) == pytest.approx(
        3.0 * factors @ factors, rel=0.1
    )


def test_labels_that_are_mixed_up_are_found_and_a_part_of_another_lens() -> None:
    parts = series(UNEQUAL, 3, apart=10.0)
    parts.require_alike()
    assert parts.exchanged() == ()
    mixed = [*UNEQUAL]
    mixed[1] = UNEQUAL[6]
    mixed[6] = UNEQUAL[1]
    assert scattered(mixed, parts.deviations).exchanged() == ("1", "6")
    other = parts.deviations.copy()
    other[4] += 300.0
    nearest = min(np.sqrt(SHARES @ (other[4] - other[k]) ** 2) for k in range(9) if k != 4)
    with pytest.raises(InputError, match=rf"^4: its form is {nearest:.3g} µm rms from .*: is it of another lens\?"):
        scattered(UNEQUAL, other).require_alike()
    alike = [series(UNEQUAL, seed, apart=0.0) for seed in range(100)]
    assert sum(bool(s.exchanged()) for s in alike) <= 2
    for drawn in alike:
        drawn.require_alike()


@pytest.mark.parametrize(("limit", "state"), [(15.0, "fail"), (22.0, "pass"), (17.0, "undecided")])
def test_capability_is_the_closed_form_on_each_side_of_the_limit(limit: float, state: str) -> None:
    rng = np.random.default_rng(0)
    groups = [10.0 + rng.normal(size=40), 12.0 + 1.5 * rng.normal(size=30)]
    pooled = np.sqrt((39 * np.var(groups[0], ddof=1) + 29 * np.var(groups[1], ddof=1)) / 68)
    wanted = (limit - groups[1].mean()) / (3.0 * pooled)
    made = cpk(groups, limit)
    assert made.value == pytest.approx(wanted)
    assert made.standard_error == pytest.approx(np.sqrt(1.0 / (9 * 30) + wanted**2 / (2 * 68)))
    fact = next(fact for fact in facts_in(record(cpk=made)) if fact.key == "cpk")
    assert fact.state == state and fact.limit == 1.33


def test_errors_of_capability_are_those_of_drawn_parts() -> None:
    rng = np.random.default_rng(1)
    drawn = [cpk([rng.normal(1.0, 1.0, 12), rng.normal(2.0, 1.0, 12)], 7.0) for _ in range(2000)]
    values = np.array([made.value for made in drawn])
    assert values.mean() == pytest.approx(5.0 / 3.0, rel=0.06), "of few parts a little above"
    assert np.mean([made.standard_error for made in drawn]) == pytest.approx(values.std(), rel=0.1)
    potential = cp(12.0, Metric(value=0.5, unit="µm", standard_error=0.1))
    assert (potential.value, potential.standard_error) == (pytest.approx(4.0), pytest.approx(0.8))


def record(**changes: Any) -> PartSeries:
    content = {
        "parts": (),
        "cavities": (),
        "wavelength_mm": 2.0,
        "repeats": True,
        "freedom": 2,
        "common_um": 1.0,
        "common_error_um": 0.25,
        "repeatability_um": Metric(value=0.5, unit="µm", standard_error=0.125),
        "between_um": None,
        "zone_um": 20.0,
        "cp": None,
        "cpk": None,
        "scatter_map_um": np.ones((3, 3)),
    }
    return PartSeries(**{**content, **changes})


def test_a_series_without_a_tolerance_says_so_and_has_no_capability() -> None:
    told = {fact.key: fact for fact in facts_in(record(zone_um=None))}
    assert told["cp"].text == "none: manufacture.form_tolerance_um is not given" and "cpk" not in told
    assert "exchanged" not in told and "between" not in told
    mixed = {fact.key: fact for fact in facts_in(record(exchanged=("a_1.csv", "b_2.csv")))}
    assert mixed["exchanged"].text == "a_1.csv and b_2.csv" and "mixed up?" in mixed["exchanged"].sentence
