"""Budget of tolerances: on parts whose metrics are known functions of their scales."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from lensforge.made.tolerance_budget import budget
from lensforge.made.tolerance_result import PASS_RATE
from lensforge.spec.accuracy import PRESETS
from lensforge.spec.tolerances_section import Factor

COUNT, PARTS = 1000, PRESETS["draft"].studies.budget_parts


class KnownParts:
    """A metric |a z1| + |b z2| over quantiles of normal numbers, which must be at most ``bound``."""

    def __init__(self, bound: float, widths: dict[str, float]) -> None:
        rng = np.random.default_rng(0)
        self.widths = widths
        self.numbers = {name: rng.permutation(norm.ppf((np.arange(PARTS) + 0.5) / PARTS)) for name in widths}
        self.measured = 0
        factors = tuple(Factor(name, name, "mm", 1.0, 0.1, "spread", "normal", 1) for name in widths)
        self.study = SimpleNamespace(
            factors=factors, recipe=SimpleNamespace(parts=COUNT), excess=lambda values: values[..., :1] - bound
        )

    def metric(self, scales: dict[str, float]) -> np.ndarray:
        return sum(np.abs(scales.get(name, 1.0) * w * self.numbers[name]) for name, w in self.widths.items())

    @property
    def passes(self) -> np.ndarray:
        return self.study.excess(self.metric({})[:, None])[:, 0] <= 0.0

    def of(self, parts, scales=None) -> np.ndarray:
        self.measured += len(parts)
        values = self.metric(scales or {})[list(parts)]
        return np.stack([values, 0.0 * values], axis=-1)[:, None, :]


def _true_scale(known: KnownParts, names: list[str], bound: float, rate: float = PASS_RATE) -> float:
    scales = np.linspace(0.0, 20.0, 4001)
    rates = [np.mean(known.metric(dict.fromkeys(names, scale)) <= bound) for scale in scales]
    return float(scales[np.flatnonzero(np.array(rates) >= rate)[-1:].sum()])


@pytest.mark.parametrize("bound", [1.0, 3.0, 6.0])
def test_amounts_are_those_of_the_known_parts(bound: float) -> None:
    known = KnownParts(bound, {"one": 0.5, "other": 0.3, "nothing": 0.0})
    found = budget(known, known.passes, lambda _: None)
    rows = {row.tolerance: row for row in (*found.alone, found.together)}
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
        for found, rate in ((row.low, PASS_RATE + error), (row.high, PASS_RATE - error)):
            end = amount * _true_scale(known, names, bound, rate)
            assert found == pytest.approx(end, rel=0.08) or end == 0.0
    free = rows["nothing"]
    assert free.unlimited or rows["one"].at_most is None or rows["one"].at_most < 0.1
    assert known.measured < 20 * PARTS


def test_where_the_others_alone_are_too_much_no_amount_is_small_enough() -> None:
    known = KnownParts(0.5, {"one": 0.5, "other": 3.0})
    rows = {row.tolerance: row for row in budget(known, known.passes, lambda _: None).alone}
    assert rows["one"].at_most is None
    assert not rows["one"].unlimited


def test_a_tolerance_that_does_nothing_has_no_limit() -> None:
    known = KnownParts(10.0, {"one": 0.5, "nothing": 0.0})
    rows = {row.tolerance: row for row in budget(known, known.passes, lambda _: None).alone}
    assert rows["nothing"].unlimited
    assert rows["nothing"].searched_to == pytest.approx(1.6)
