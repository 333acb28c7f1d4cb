"""Budget of tolerances: the largest amount of each at which enough parts pass, alone, and of all together.

The parts of a study are drawn once; scaling one of their deviations leaves all other numbers as they are. So the share
that passes is a smooth function of the scale, whose root is bracketed by traced parts, and then closed in by parts
traced at interpolated scales: there only those that pass at one end of the bracket and fail at the other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from lensforge.made.measured_parts import MeasuredParts
from lensforge.made.tolerance_result import PASS_RATE, Budget, BudgetRow
from lensforge.spec.tolerances_section import Factor

_UP = (16.0, 4.0)  # most tolerances of most lenses matter little: one look tells
_DOWN = (0.25, 0.0)
_ROUNDS = 3

Passes = Bool[np.ndarray, " n"]


@dataclass
class ScaleSearch:
    """Search for the scale of the tolerances ``names`` at which ``PASS_RATE`` of the first parts pass.

    ``known``: which parts pass, by scale; 1 is as specified.
    """

    parts: MeasuredParts
    names: Sequence[str]
    known: dict[float, Passes]

    def passing(self, scale: float, at_least: Passes, at_most: Passes) -> Passes:
        """Parts that pass at ``scale``; those in both or in neither of the two are taken as known."""
        if scale not in self.known:
            passes = at_least & at_most
            open_parts = np.flatnonzero(at_least != at_most)
            if len(open_parts):
                values = self.parts.of(open_parts.tolist(), dict.fromkeys(self.names, scale))[..., 0]
                passes[open_parts] = (self.parts.study.excess(values) <= 0.0).all(axis=1)
            self.known[scale] = passes
        return self.known[scale]

    def bracket(self) -> tuple[float | None, float | None]:
        """The largest scale tried at which enough parts pass, and the least at which too few do; None for none."""
        if self.known[1.0].mean() >= PASS_RATE:
            return self._above()
        everything = np.ones_like(self.known[1.0])
        high = 1.0
        for scale in _DOWN:
            if self.passing(scale, everything, self.known[high]).mean() >= PASS_RATE:
                return scale, high
            high = scale
        return None, high

    def _above(self) -> tuple[float, float | None]:
        """The largest scale that passes and the smallest that does not, where enough parts pass as specified."""
        high, low, nothing = None, 1.0, np.zeros_like(self.known[1.0])
        for scale in _UP:
            above = nothing if high is None else self.known[high]
            if self.passing(scale, self.known[1.0], above).mean() >= PASS_RATE:
                low = scale
                break
            high = scale
        return low, high

    def root(self, low: float, high: float) -> tuple[float, float, float]:
        """The scale, and those at which a standard error more and fewer of the parts pass."""
        for _ in range(_ROUNDS):
            middle = self._scale_at(PASS_RATE, low, high)
            middle = min(max(middle, low + 0.1 * (high - low)), high - 0.1 * (high - low))
            if self.passing(middle, self.known[low], self.known[high]).mean() >= PASS_RATE:
                low = middle
            else:
                high = middle
        error = float(np.sqrt(PASS_RATE * (1.0 - PASS_RATE) / len(self.known[1.0])))
        root = self._scale_at(PASS_RATE, low, high)
        return root, self._scale_at(PASS_RATE + error, 0.0, high), self._scale_at(PASS_RATE - error, low, None)

    def _scale_at(self, rate: float, low: float, high: float | None) -> float:
        """The scale at which ``rate`` pass, linear between those that are known from ``low`` to ``high``."""
        scales = sorted(scale for scale in self.known if scale >= low and (high is None or scale <= high))
        rates = np.minimum.accumulate([self.known[scale].mean() for scale in scales])
        above = np.flatnonzero(rates >= rate)
        if not len(above):
            return scales[0]
        last = int(above[-1])
        if last == len(scales) - 1:
            return scales[-1]
        drop = rates[last] - rates[last + 1]
        share = (rates[last] - rate) / drop if drop > 0.0 else 0.5
        return float(scales[last] + share * (scales[last + 1] - scales[last]))


def budget(parts: MeasuredParts, passes: Passes, announce: Callable[[str], None]) -> Budget:
    """Search for the largest amount of each tolerance alone, and of all together.

    ``passes``: of the first parts as specified, those that pass.
    """
    factors = parts.study.factors
    rows = []
    for factor in factors:
        announce(f"budget: {factor.words}")
        rows.append(_row(parts, (factor,), passes, factor.name, factor.words, factor.unit, factor.amount))
    announce("budget: all tolerances together")
    together = _row(parts, factors, passes, "all", "all tolerances, by one factor", "", 1.0)
    return Budget(pass_rate=PASS_RATE, parts=len(passes), alone=tuple(rows), together=together)


def _row(
    parts: MeasuredParts, factors: Sequence[Factor], passes: Passes, name: str, words: str, unit: str, amount: float
) -> BudgetRow:
    search = ScaleSearch(parts, [factor.name for factor in factors], {1.0: passes})
    low, high = search.bracket()
    roots = None if low is None or high is None else search.root(low, high)
    at_most, least, most = (None, None, None) if roots is None else (each * amount for each in roots)
    return BudgetRow(
        tolerance=name,
        words=words,
        unit=unit,
        specified=amount,
        at_most=at_most,
        low=least,
        high=most,
        searched_to=max(_UP) * amount,
        unlimited=high is None,
    )
