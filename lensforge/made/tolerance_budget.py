"""Budget of tolerances: the largest amount of each at which enough parts pass, alone, and of all together; and of flux.

The parts of a study are drawn once; scaling one of their deviations leaves all other numbers as they are. So the share
that passes is a smooth function of the scale, whose root is bracketed by traced parts, and then closed in by parts
traced at scales between: there only those that pass at one end of the bracket and fail at the other.

Of these the most endangered come first: those near a bound, or with large numbers. Where a look or two of them pass the
rest does, and where too many have failed already the rest need not be traced: a tolerance that matters little costs a
few parts, whatever their number.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.made.measured_parts import MeasuredParts
from lensforge.made.tolerance_result import PASS_RATE, Budget, BudgetRow, FluxNeeded, MetricBound
from lensforge.spec.tolerances_section import Factor

_UP = (16.0, 4.0)  # most tolerances of most lenses matter little: one look tells
_DOWN = 0.25
_LOOK = 16  # parts that are traced at once, before it is asked whether more of them can change the answer
_TOO_MANY = 3.0  # standard errors below the wanted share: how much less passes is of no interest
_ROUNDS = 4

Passes = Bool[np.ndarray, " n"]


@dataclass
class ScaleSearch:
    """Search for the scale of the tolerances ``names`` at which a share ``wanted`` of the first parts passes.

    ``order``: numbers of these parts, the most endangered first. ``known``: which of them pass, by scale; 1 is as
    specified. ``crowded``: scales at which too many fail, so that not every failure is known.
    """

    parts: MeasuredParts
    names: Sequence[str]
    wanted: float
    order: Int[np.ndarray, " n"]
    known: dict[float, Passes]
    crowded: set[float] = field(default_factory=set)

    def passing(self, scale: float, at_least: Passes, at_most: Passes) -> Passes:
        """Parts that pass at ``scale``; parts in both ``at_least`` and ``at_most``, or in neither, are inferred."""
        if scale not in self.known:
            self.known[scale] = self._looked_at(
                scale, at_least & at_most, self.order[(at_least != at_most)[self.order]]
            )
        return self.known[scale]

    def _looked_at(self, scale: float, passes: Passes, parts: Int[np.ndarray, " k"]) -> Passes:
        """Measure ``parts`` look by look until the unseen ones cannot matter; those that pass join ``passes``."""
        least = self.wanted - _TOO_MANY * _error(self.wanted, len(passes))
        needed = 1 if scale == max(_UP) else 2  # looks in a row without a failure
        quiet = 0
        for first in range(0, len(parts), _LOOK):
            look = parts[first : first + _LOOK]
            unseen = parts[first + _LOOK :]
            passes[look] = self._measured(look, scale)
            quiet = quiet + 1 if passes[look].all() else 0
            if quiet == needed:
                passes[unseen] = True
                break
            if len(unseen) and (passes.sum() + len(unseen)) / len(passes) < least:
                self.crowded.add(scale)
                break
        return passes

    def _measured(self, parts: np.ndarray, scale: float) -> Passes:
        values = self.parts.of(parts.tolist(), dict.fromkeys(self.names, scale))[..., 0]
        return np.asarray((self.parts.study.excess(values) <= 0.0).all(axis=1))

    def bracket(self) -> tuple[float | None, float | None]:
        """The largest tried scale at which enough parts pass, and the least at which too few do; None if none does."""
        if self.known[1.0].mean() >= self.wanted:
            return self._above()
        if not self._reached_without():
            return None, 1.0
        enough = self.passing(_DOWN, self.known[0.0], self.known[1.0]).mean() >= self.wanted
        return (_DOWN, 1.0) if enough else (0.0, _DOWN)

    def _reached_without(self) -> bool:
        """True if enough parts pass without these tolerances; no more are traced than this needs."""
        passes = np.ones_like(self.known[1.0])
        failing = np.flatnonzero(~self.known[1.0])
        for first in range(0, len(failing), _LOOK):
            some = failing[first : first + _LOOK]
            passes[some] = self._measured(some, 0.0)
            if passes.mean() < self.wanted:
                return False
        self.known[0.0] = passes
        return True

    def _above(self) -> tuple[float, float | None]:
        """The largest scale that passes and the smallest that does not, if enough parts pass as specified."""
        high = None
        low = 1.0
        nothing = np.zeros_like(self.known[1.0])
        for scale in _UP:
            above = nothing if high is None else self.known[high]
            if self.passing(scale, self.known[1.0], above).mean() >= self.wanted:
                low = scale
                break
            high = scale
        return low, high

    def root(self, low: float, high: float) -> tuple[float, float, float]:
        """The scale, and those at which a standard error more and fewer of the parts pass."""
        for _ in range(_ROUNDS):
            middle = self._between(low, high)
            if self.passing(middle, self.known[low], self.known[high]).mean() >= self.wanted:
                low = middle
            else:
                high = middle
        error = _error(self.wanted, len(self.known[1.0]))
        root = self._scale_at(self.wanted, low, high)
        return (
            root,
            self._refined_scale(self.wanted + error, 0.0, high),
            self._refined_scale(self.wanted - error, low, None),
        )

    def _refined_scale(self, rate: float, low: float, high: float | None) -> float:
        """The scale at which ``rate`` pass, after tracing parts at the most likely scale."""
        likely = self._scale_at(rate, low, high)
        below = max((scale for scale in self.known if scale <= likely), default=None)
        above = min((scale for scale in self.known if scale >= likely), default=None)
        if below is not None and above is not None:
            self.passing(likely, self.known[above], self.known[below])
        return self._scale_at(rate, low, high)

    def _between(self, low: float, high: float) -> float:
        """A scale within the bracket: by the shares at its ends, or its middle if the upper share is not known."""
        if high in self.crowded:
            return float(np.sqrt(low * high)) if low > 0.0 else 0.5 * high
        margin = 0.1 * (high - low)
        return float(np.clip(self._scale_at(self.wanted, low, high), low + margin, high - margin))

    def _scale_at(self, rate: float, low: float, high: float | None) -> float:
        """The scale at which ``rate`` pass, interpolated between the known scales from ``low`` to ``high``."""
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


def budget(
    parts: MeasuredParts, excess: Float[np.ndarray, "n b"], announce: Callable[[str], None], wanted: float = PASS_RATE
) -> Budget:
    """Search for the largest amount of each tolerance alone, and of all together, at which a share ``wanted`` passes.

    ``excess``: of the first parts as specified over each bound.
    """
    factors = parts.study.factors
    passes = np.asarray((excess <= 0.0).all(axis=1))
    rows = list[BudgetRow]()
    for number, factor in enumerate(factors, start=1):
        announce(f"budget: {number} of {len(factors) + 1}, {factor.phrase}")
        search = ScaleSearch(parts, [factor.name], wanted, _endangered(parts, excess, [factor]), {1.0: passes})
        rows.append(_row(search, factor.name, factor.phrase, factor.unit, factor.amount))
    announce(f"budget: {len(factors) + 1} of {len(factors) + 1}, all tolerances together")
    names = [factor.name for factor in factors]
    search = ScaleSearch(parts, names, wanted, _endangered(parts, excess, factors), {1.0: passes})
    together = _row(search, "all", "all tolerances, by one factor", "", 1.0)
    return Budget(pass_rate=wanted, parts=len(passes), alone=tuple(rows), together=together)


def _endangered(
    parts: MeasuredParts, excess: Float[np.ndarray, "n b"], factors: Sequence[Factor]
) -> Int[np.ndarray, " n"]:
    """The parts in the order in which they fail as ``factors`` grow, if the metric is linear in them."""
    width = excess.std(axis=0)
    margin = -(excess / np.where(width > 0.0, width, 1.0)).max(axis=1)
    size = sum((parts.study.draws.numbers[factor.name][: len(margin)] ** 2).mean(axis=1) for factor in factors) ** 0.5
    return np.argsort(margin / np.maximum(size, 1e-9), kind="stable")


def _row(search: ScaleSearch, name: str, description: str, unit: str, amount: float) -> BudgetRow:
    low, high = search.bracket()
    roots = None if low is None or high is None else search.root(low, high)
    at_most, least, most = (None, None, None) if roots is None else (root * amount for root in roots)
    return BudgetRow(
        tolerance=name,
        words=description,
        unit=unit,
        specified=amount,
        at_most=at_most,
        low=least,
        high=most,
        searched_to=max(_UP) * amount,
        unlimited=high is None,
    )


def _error(share: float, count: int) -> float:
    """Standard error of a ``share`` of so many parts."""
    return float(np.sqrt(share * (1.0 - share) / count))


def flux_needed(bounds: Sequence[MetricBound], values: Float[np.ndarray, "n b"], wanted: float) -> FluxNeeded | None:
    """Least flux of the LED at which a share ``wanted`` of the parts keeps all ``bounds``; None if no bound needs it.

    ``values``: of the bounded metrics, known at any flux, as each grows by a power of it.
    """
    if not any(bound.flux_power for bound in bounds):
        return None
    least, most = np.zeros(len(values)), np.full(len(values), np.inf)
    for bound, parts in zip(bounds, values.T, strict=True):
        if not bound.flux_power:
            least[~bound.kept_by(parts)] = np.inf
            continue
        with np.errstate(divide="ignore", over="ignore"):
            factor = (bound.bound / np.maximum(parts, 0.0)) ** (1.0 / bound.flux_power)
        least, most = (least, np.minimum(most, factor)) if bound.sense == "<=" else (np.maximum(least, factor), most)
    attainable = np.isfinite(least) & (least <= most)
    begin = np.sort(least[attainable])
    end = np.sort(most[attainable])
    shares = (np.arange(1, len(begin) + 1) - np.searchsorted(end, begin)) / len(values)

    def at(share: float) -> float | None:
        enough = np.flatnonzero(shares >= share)
        return float(begin[enough[0]]) if len(enough) else None

    error = _error(wanted, len(values))
    low, factor, high = (at(wanted + sign * error) for sign in (-1.0, 0.0, 1.0))
    most_pass = float(max(shares, default=0.0))
    return FluxNeeded(pass_rate=wanted, factor=factor, low=low, high=high, most=most_pass, best=at(most_pass))
