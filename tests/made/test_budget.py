"""Budget of tolerances: on parts whose metrics are known functions of their scales."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from lensforge.made.tolerance_budget import budget, flux_needed
from lensforge.made.tolerance_result import PASS_RATE, MetricBound
from lensforge.spec.accuracy import PRESETS
from lensforge.spec.tolerances_section import Factor

COUNT = 1000
PARTS = PRESETS["draft"].studies.budget_parts


class KnownParts:
    """A metric |a z1| + |b z2| over quantiles of normal numbers, which must be at most ``bound``."""

    def __init__(self, bound: float, widths: dict[str, float]) -> None:
        rng = np.random.default_rng(0)
        self.widths = widths
        self.numbers = {name: rng.permutation(norm.ppf((np.arange(PARTS) + 0.5) / PARTS)) for name in widths}
        self.measured = 0
        factors = tuple(Factor(name, name, "mm", 1.0, 0.1, "spread", "normal", 1) for name in widths)
        numbers = {name: values[:, None] for name, values in self.numbers.items()}
        self.study = SimpleNamespace(
            factors=factors,
            recipe=SimpleNamespace(parts=COUNT),
            excess=lambda values: values[..., :1] - bound,
            draws=SimpleNamespace(numbers=numbers),
        )

    def metric(self, scales: dict[str, float | np.ndarray]) -> np.ndarray:
        return sum(np.abs(scales.get(name, 1.0) * w * self.numbers[name]) for name, w in self.widths.items())

    @property
    def excess(self) -> np.ndarray:
        return self.study.excess(self.metric({})[:, None])

    def of(self, parts, scales=None) -> np.ndarray:
        self.measured += len(parts)
        values = self.metric(scales or {})[list(parts)]
        return np.stack([values, 0.0 * values], axis=-1)[:, None, :]


def _true_scale(known: KnownParts, names: list[str], bound: float, rate: float = PASS_RATE) -> float:
    scales = np.linspace(0.0, 20.0, 4001)
    rates = np.mean(known.metric(dict.fromkeys(names, scales[:, None])) <= bound, axis=-1)
    return float(scales[np.flatnonzero(rates >= rate)[-1:].sum()])


@pytest.mark.parametrize("bound", [1.0, 3.0, 6.0])
def test_amounts_are_those_of_the_known_parts(bound: float) -> None:
    known = KnownParts(bound, {"one": 0.5, "other": 0.3, "nothing": 0.0})
    result = budget(known, known.excess, lambda _: None)
    rows = {row.tolerance: row for row in (*result.alone, result.together)}
    for name, names in (("one", ["one"]), ("other", ["other"]), ("all", list(known.widths))):
        amount = 1.0 if name == "all" else 0.1
        true = amount * _true_scale(known, names, bound)
        row = rows[name]
        if row.at_most is None:
            assert true == 0.0 or row.unlimited
            continue
        assert row.at_most == pytest.approx(true, rel=0.08)
        error = np.sqrt(PASS_RATE * (1.0 - PASS_RATE) / PARTS)  # of a share of so many parts
        assert row.low <= row.at_most <= row.high
        for limit, rate in ((row.low, PASS_RATE + error), (row.high, PASS_RATE - error)):
            end = amount * _true_scale(known, names, bound, rate)
            assert limit == pytest.approx(end, rel=0.08) or end == 0.0
    free = rows["nothing"]
    assert free.unlimited or rows["one"].at_most is None or rows["one"].at_most < 0.1
    assert known.measured < 20 * PARTS


def test_where_the_others_alone_are_too_much_no_amount_is_small_enough() -> None:
    known = KnownParts(0.5, {"one": 0.5, "other": 3.0})
    rows = {row.tolerance: row for row in budget(known, known.excess, lambda _: None).alone}
    assert rows["one"].at_most is None
    assert not rows["one"].unlimited


def test_a_tolerance_that_does_nothing_has_no_limit() -> None:
    known = KnownParts(10.0, {"one": 0.5, "nothing": 0.0})
    rows = {row.tolerance: row for row in budget(known, known.excess, lambda _: None).alone}
    assert rows["nothing"].unlimited
    assert rows["nothing"].searched_to == pytest.approx(1.6)


def test_the_cheapest_is_the_tolerance_that_changes_least_and_few_parts_tell_of_those_that_do_not_help() -> None:
    """Of two that reach the share alone the one with the larger part of its amount; three that cannot cost 48 parts."""
    known = KnownParts(1.0, {"one": 0.5, "other": 0.3, "small": 0.01, "tiny": 0.001, "nothing": 0.0})
    result = budget(known, known.excess, lambda _: None)
    true = {name: _true_scale(known, [name], 1.0) for name in known.widths}
    assert not result.reached and result.cheapest is not None
    assert result.cheapest.tolerance == max((n for n in true if 0.0 < true[n] < 1.0), key=lambda n: true[n])
    failing = int((known.excess > 0.0).sum())
    assert known.measured < 3 * 16 + 3 * (failing * 4 + 2 * 16), "two looks for the interval of each that helps"
    none = KnownParts(0.5, {"one": 0.5, "other": 3.0, "third": 3.0})
    result = budget(none, none.excess, lambda _: None)
    assert result.cheapest is None and not result.reached
    easy = KnownParts(10.0, {"one": 0.5})
    result = budget(easy, easy.excess, lambda _: None)
    assert result.cheapest is None and result.reached


class OneSided(KnownParts):
    """Only numbers above 0 matter: half of the parts that look endangered are not."""

    def metric(self, scales: dict[str, float | np.ndarray]) -> np.ndarray:
        grown = {name: scales.get(name, 1.0) * w * self.numbers[name] for name, w in self.widths.items()}
        return sum(np.maximum(amounts, 0.0) ** 2 for amounts in grown.values())


@pytest.mark.parametrize("bound", [1.0, 4.0])
def test_few_parts_tell_the_amount_where_half_of_them_do_not_mind(bound: float) -> None:
    known = OneSided(bound, {"one": 0.5, "other": 0.2, "nothing": 0.0})
    result = budget(known, known.excess, lambda _: None)
    asked = {"one": ["one"], "other": ["other"], "nothing": ["nothing"], "all": list(known.widths)}
    for row in (*result.alone, result.together):
        names = asked[row.tolerance]
        true = row.specified * _true_scale(known, names, bound)
        assert row.unlimited == (names == ["nothing"])
        assert row.unlimited or row.at_most == pytest.approx(true, rel=0.1)


def test_a_tolerance_that_cannot_matter_costs_one_look_and_those_that_do_less_than_three_times_the_parts() -> None:
    """Rounds are told with their number, those that follow, too."""
    names = [f"harmless {k}" for k in range(12)]
    known = KnownParts(3.0, {"one": 0.5, **dict.fromkeys(names, 1e-4)})
    lines = list[str]()
    before = KnownParts(3.0, {"one": 0.5})
    budget(before, before.excess, lambda _: None)
    budget(known, known.excess, lines.append)
    assert before.measured < 2 * 3 * PARTS and known.measured <= before.measured + 12 * 16 + 3 * 16
    assert lines[0] == "budget: 1 of 14, one" and lines[-1] == "budget: 14 of 14, all tolerances together"


@pytest.mark.parametrize("wanted", [0.6, 0.9])
def test_another_share_has_amounts_of_its_own(wanted: float) -> None:
    known = KnownParts(1.0, {"one": 0.5, "other": 0.3})
    result = budget(known, known.excess, lambda _: None, wanted)
    rows = {row.tolerance: row for row in (*result.alone, result.together)}
    assert result.pass_rate == wanted
    true = _true_scale(known, ["one", "other"], 1.0, wanted)
    assert rows["all"].at_most == pytest.approx(true, rel=0.08)


BOUNDS = [(">=", 1.0, 1.0), ("<=", 1.5, 1.0), ("<=", 10.0, 0.2), (">=", 0.4, 0.0), ("<=", 2.0, 1.0)]


FLUXES = np.linspace(0.5, 2.0, 100_001)  # factors of the flux


def _values() -> np.ndarray:
    """Of 300 parts, each metric of ``BOUNDS``."""
    rng = np.random.default_rng(1)
    values = np.array([1.0, 1.3, 9.6, 0.5, 1.0]) * (1.0 + 0.05 * rng.standard_normal((300, 5)))
    values[:, 3] += 0.05 * rng.standard_normal(300)
    return values


@pytest.fixture(scope="module")
def shares() -> np.ndarray:
    """Share of the parts that pass at each of ``FLUXES``, by counting."""
    passing = np.zeros(len(FLUXES))
    for part in _values():
        passes = np.ones(len(FLUXES), dtype=bool)
        for value, (sense, bound, power) in zip(part, BOUNDS, strict=True):
            scaled = value * FLUXES**power
            passes &= scaled >= bound if sense == ">=" else scaled <= bound
        passing += passes
    return passing / len(_values())


@pytest.mark.parametrize("wanted", [0.3, 0.55, 0.95])
def test_the_flux_is_the_least_at_which_so_many_parts_pass(wanted: float, shares: np.ndarray) -> None:
    bounds = [
        MetricBound(metric=str(k), sense=sense, bound=bound, unit="", flux_power=power)
        for k, (sense, bound, power) in enumerate(BOUNDS)
    ]
    values = _values()
    needed = flux_needed(bounds, values, wanted)
    error = np.sqrt(wanted * (1.0 - wanted) / 300)
    assert needed is not None and needed.most == pytest.approx(shares.max(), abs=0.004)
    assert needed.best == pytest.approx(FLUXES[shares >= needed.most - 1e-9][0], abs=2e-5)
    ends = (needed.factor, wanted), (needed.low, wanted - error), (needed.high, wanted + error)
    for factor, share in ends:
        enough = np.flatnonzero(shares >= share)
        assert (factor is None) == (len(enough) == 0)
        assert factor is None or factor == pytest.approx(FLUXES[enough[0]], abs=2e-5)
    assert (needed.factor is None) == (wanted == 0.95)
    assert flux_needed(bounds[3:4], values[:, 3:4], wanted) is None, "no flux makes a ratio"
