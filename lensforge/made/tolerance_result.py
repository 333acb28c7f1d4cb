"""Results of the tolerance studies: the sensitivity to each tolerance, and the yield of parts that have all of them.

The sensitivity table has the metrics of the lens as designed, and with each tolerance at its end. The yield study says
how many parts pass, how far their metrics scatter, and which tolerance decides.
"""

import csv
import io
from typing import Annotated, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from lensforge.errors import InputError
from lensforge.light.evaluation_result import LightMetrics
from lensforge.public import public
from lensforge.results import (
    Array,
    Count,
    Metric,
    NotNegative,
    Number,
    Record,
    ResultByLed,
    Sense,
    Share,
    SimulatedResult,
    Text,
    stated,
)
from lensforge.results.arguments import require_choice
from lensforge.results.figure import Apart, Figure, figure
from lensforge.results.numerals import NOTHING, percent, quantity
from lensforge.results.plots import Axes, plot_bars, plot_distribution
from lensforge.results.verdict import CERTAIN
from lensforge.spec.tolerances_section import Factor, amount_words

MetricName = Literal["uniformity", "rsd", "nmse", "efficiency"]

_MOST_ROWS = 200  # bars of a plot; the study has 34 errors at most, of 21 tolerances


class LimitChange(Record):
    """The value that decides on a limit of the spec, with a tolerance at its end, and its change by that."""

    name: Text
    value: Metric
    change: Metric


class ErrorRow(Record):
    """One tolerance at its end: its amount, the metrics with it, their change by it, and that of each limit.

    ``change`` is the difference from the lens as designed by the same rays, with the standard error of that difference:
    common noise cancels. That of uniformity cancels least, since each lens has its own darkest pixels.
    """

    name: Text
    amount: Number
    unit: Text
    metrics: LightMetrics
    change: LightMetrics
    limits: tuple[LimitChange, ...] = ()


@public
class Sensitivity(ResultByLed):
    """Tolerances of the spec, one at a time at its end, and the change of the light by each.

    ``nominal``: the light as designed. ``rows``: each tolerance with its amount and the change of each metric, the same
    errors with each LED. ``preset``: gives the tolerances that the spec leaves out.
    """

    stage: ClassVar[str] = "sensitivity"

    others: "tuple[Sensitivity, ...]" = ()
    nominal: Annotated[LightMetrics, Apart()]
    rows: Annotated[tuple[ErrorRow, ...], Field(max_length=_MOST_ROWS)]
    preset: Text
    rays: Annotated[Count, Figure("Rays")]
    seconds: NotNegative

    def plot(self, axes: "Axes | None" = None, *, metric: MetricName = "nmse") -> "Axes":
        """Plot the change of ``metric`` by each error, with its standard error.

        Raises :class:`InputError` for an unknown one, and for one that the spec has no region for.
        """
        require_choice("metric", metric, get_args(MetricName))
        if getattr(self.nominal, metric) is None:
            raise InputError(f"metric = {metric!r}: the spec names no region of uniform light; plot nmse or efficiency")
        changes = {
            case.title(f"{row.name} {row.amount:g} {row.unit}"): getattr(row.change, metric)
            for case in self.cases()
            for row in case.result.rows
        }
        values = {name: 0.0 if change is None else change.value for name, change in changes.items()}
        errors = [0.0 if change is None else change.standard_error or 0.0 for change in changes.values()]
        return plot_bars(values, f"change of {metric}", axes, errors)


MOST_PARTS = 100_000
_MOST_FACTORS = 64
_MOST_BOUNDS = 2048
_CONFIDENCE = 0.95
PASS_RATE = 0.95  # of the parts, by a budget
FIELD = "Gaussian field"  # in the place of a distribution


class PassRate(Record):
    """Share of the parts that pass, and its 95 % confidence interval by Wilson's score (Wilson 1927)."""

    value: Share
    low: Share
    high: Share

    @staticmethod
    def of(passed: int, count: int) -> "PassRate":
        """Share ``passed`` of ``count`` parts (Wilson, J. Am. Stat. Assoc. 22, 209, 1927)."""
        from scipy.stats import binomtest  # a second, which only studies of parts need

        within = binomtest(passed, count).proportion_ci(_CONFIDENCE, "wilson")
        return PassRate(value=passed / count, low=float(within.low), high=float(within.high))

    @property
    def interval(self) -> str:
        """The confidence interval in words."""
        return f"{percent(self.low)} to {percent(self.high)}"


class MetricBound(Record):
    """Bound that a part must keep to pass: ``metric``, a name of ``metrics``, ``sense`` ``bound``, in ``unit``.

    ``flux_power``: power of the flux of the LED by which the metric grows; 0 if independent of it.
    """

    metric: Text
    sense: Sense
    bound: Number
    unit: Text
    flux_power: Number = 0.0

    def kept_by(self, values: Float[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        """True for values of the metric that keep it."""
        return values <= self.bound if self.sense == "<=" else values >= self.bound

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit not in ("", "°") else self.unit
        return f"{self.metric} {self.sense} {self.bound:.4g}{unit}"


class MetricSpread(Record):
    """Distribution of a metric over the parts; ``designed``: of the lens as designed, by its own many rays.

    ``p5``, ``p50``, ``p95``: percentiles; ``mean`` and ``spread`` (standard deviation, without ray noise) of the parts.
    ``standard_error``: of one part's change from the designed lens, the median over the parts. That of ``mean`` is by
    the parts and by the rays.
    """

    unit: Text
    designed: Annotated[Metric, Figure("As designed")]
    p5: Annotated[Number, Figure("5th percentile")]
    p50: Annotated[Number, Figure("Median")]
    p95: Annotated[Number, Figure("95th percentile")]
    mean: Metric
    spread: Annotated[NotNegative, Figure("Standard deviation")]
    standard_error: NotNegative | None

    @stated
    def undecided(self) -> bool:
        """True if the noise of a part's rays outweighs the spread of the parts: percentiles are those of noise."""
        return self.standard_error is not None and self.spread < self.standard_error


class CauseShare(Record):
    """Share of a metric's variance that one tolerance makes by itself, and its standard error."""

    tolerance: Text
    words: Text
    share: Number
    standard_error: NotNegative

    @property
    def metric(self) -> Metric:
        """The share with its standard error."""
        return Metric(value=self.share, standard_error=self.standard_error)

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key of the causes: the certain part of their share, two standard errors less, then the value."""
        return -max(self.share - CERTAIN * self.standard_error, 0.0), -self.share


UNCERTAIN = "not significant with so few parts"


class Variance(Record):
    """Causes of a metric's spread, the surest first; ``interactions``: share of several tolerances together."""

    causes: Annotated[tuple[CauseShare, ...], Field(max_length=_MOST_FACTORS)]
    interactions: Metric

    @property
    def certain(self) -> tuple[CauseShare, ...]:
        """The causes that exceed the noise of the parts, the surest first: the others are not shown."""
        return tuple(cause for cause in self.causes if cause.share > CERTAIN * cause.standard_error)

    @property
    def main_words(self) -> str:
        """The surest cause and its share, in words."""
        for cause in self.certain[:1]:
            return f"{cause.words}, {quantity(100.0 * cause.share, '%', 100.0 * cause.standard_error, digits=4)}"
        return UNCERTAIN


def drawn_to_mean(values: Float[np.ndarray, " n"], spread: float) -> Float[np.ndarray, " n"]:
    """``values`` shrunk towards their mean until they scatter by ``spread``, which removes ray noise.

    Unchanged if the noise leaves no spread: the parts then cannot be told apart.
    """
    mean = float(values.mean())
    scatter = float(values.std(ddof=1))
    return mean + (values - mean) * (spread / scatter if scatter > 0.0 < spread else 1.0)


class ApplicationYield(Record):
    """Share of the parts that hold the class of an application, and the figure and tolerances that decide on it.

    The margin of a part is the least distance of all that the class asks for to its bound, relative to that, and below
    0 beyond one. ``nearest``: the metric from which most parts have it, ``nearest_share`` of them; ``variance``: causes
    of the margin, None if the rays' noise outweighs its spread.
    """

    name: Text
    lighting_class: Annotated[Text, Figure("Class")]
    pass_rate: Annotated[
        PassRate,
        Figure("Yield", key="holds", of="value", unit="%"),
        Figure("95\u2009% confidence", key="confidence", of="interval"),
    ]
    nearest: Annotated[Text, Figure("Most critical figure", value=lambda study, entry: entry.nearest_words)]
    nearest_share: Share
    variance: Annotated[
        Variance | None,
        Figure("Main cause", key="main", of="main_words", missing="undecided: within the ray noise"),
    ]

    @property
    def nearest_words(self) -> str:
        """The most critical figure, and the share of the parts in which it is the most critical."""
        return f"{self.nearest.removeprefix(f'{self.name}: ')}, of {percent(self.nearest_share)} of the parts"


class BudgetRow(Record):
    """The largest ``at_most`` of one tolerance at which 95 % of the parts pass, the others as specified.

    ``low``, ``high``: a standard error to either side, from the number of parts. None: no amount is small enough, or
    none up to ``searched_to`` is too large (``unlimited``).
    """

    tolerance: Text
    words: Text
    unit: Text
    specified: NotNegative
    at_most: NotNegative | None
    low: NotNegative | None
    high: NotNegative | None
    searched_to: NotNegative
    unlimited: bool

    @property
    def is_tight(self) -> bool:
        """True if the specified amount is too large."""
        return not self.unlimited and (self.at_most is None or self.at_most < self.specified)

    @property
    @figure(Figure("Specified", key="specified"))
    def specified_words(self) -> str:
        """The specified amount."""
        return self._amount_words(1.0 if self._is_factor else self.specified)

    @property
    @figure(Figure("At most", key="at_most"))
    def most_words(self) -> str:
        """The largest amount at which enough parts pass."""
        if self.unlimited:
            return f"above {self._amount_words(self.searched_to)}"
        return NOTHING if self.at_most is None else self._amount_words(self.at_most)

    @property
    @figure(Figure("Interval", key="interval"))
    def interval_words(self) -> str:
        """The interval of the largest amount, or why there is none."""
        if self.unlimited:
            times = quantity(self.searched_to / self.specified, digits=3) if self.specified > 0.0 else ""
            return "not searched beyond" + (f" ({times} times)" if times and not self._is_factor else "")
        if self.low is None or self.high is None:
            alone = "the other tolerances alone give too low a yield"
            return "no factor is small enough" if self._is_factor else alone
        return f"{self._amount_words(self.low)} to {self._amount_words(self.high)}"

    @property
    def _is_factor(self) -> bool:
        return self.tolerance == "all"

    def _amount_words(self, value: float) -> str:
        return f"× {quantity(value, digits=3)}" if self._is_factor else amount_words(self.tolerance, value, self.unit)


def _is_missed(study: "Yield", budget: "Budget") -> bool:
    return study.pass_rate.value < budget.pass_rate


class Budget(Record):
    """Largest amount of each tolerance at which ``pass_rate`` of the parts pass, by the first ``parts`` of them.

    ``together``: the factor, in the place of an amount, by which all of them may be scaled at once.
    """

    parts: Count
    alone: Annotated[tuple[BudgetRow, ...], Field(max_length=_MOST_FACTORS)]
    together: Annotated[BudgetRow, Apart(), Figure("Tolerances together", "{together_note}", of="most_words")]
    pass_rate: Annotated[Share, Figure("Required yield", key="wanted", unit="%")]

    @property
    def wanted(self) -> str:
        """The required yield in words."""
        return percent(self.pass_rate)

    @property
    def reached(self) -> bool:
        """True if enough of these parts pass as specified."""
        return self.together.unlimited or (self.together.at_most or 0.0) >= self.together.specified

    @property
    def cheapest(self) -> BudgetRow | None:
        """The tolerance that reaches the share alone, by the least change relative to what is specified.

        None if none does, or none needs to.
        """
        tight = [row for row in self.alone if row.at_most is not None and 0.0 < row.at_most < row.specified]
        return max(tight, key=lambda row: (row.at_most or 0.0) / row.specified, default=None)

    @property
    def together_note(self) -> str:
        """Meaning and interval of the factor."""
        return f"one factor on all, for a yield of {self.wanted}; {self.together.interval_words}"

    @property
    @figure(Figure("Smallest tightening", "{cheapest_note}", key="cheapest", when=_is_missed))
    def cheapest_words(self) -> str:
        """The least tightening of one tolerance that reaches the required yield."""
        if self.cheapest is not None:
            return f"{self.cheapest.words}, from {self.cheapest.specified_words} to {self.cheapest.most_words}"
        return "none" if self.reached else "none is enough"

    @property
    def cheapest_note(self) -> str:
        """Its interval, or why there is none."""
        by_parts = f"by {quantity(self.parts)} parts"
        if self.cheapest is not None:
            return f"for a yield of {self.wanted}, the others as specified; {self.cheapest.interval_words}, {by_parts}"
        if self.reached:
            return f"{by_parts} alone the yield is {self.wanted} or more"
        return f"no tolerance alone, however small, gives a yield of {self.wanted}, {by_parts}"


class FluxNeeded(Record):
    """Least flux of the LED, as a ``factor`` of that of the spec, at which ``pass_rate`` of the parts pass.

    ``low``, ``high``: where a standard error of that share fewer and more of them pass. ``most``: the largest share
    that passes at any flux, at ``best`` first. None: no flux is enough.
    """

    pass_rate: Share
    factor: NotNegative | None
    low: NotNegative | None
    high: NotNegative | None
    most: Share
    best: NotNegative | None


class WorstPart(Record):
    """One of the worst parts: its number in the table of parts, and its metrics."""

    part: Count
    metrics: dict[Text, Number]
    passes: bool


class ToleranceAmount(Record):
    """One tolerance as it was drawn."""

    name: Text
    words: Text
    unit: Text
    amount: NotNegative
    distribution: Text

    @staticmethod
    def of(factor: Factor) -> "ToleranceAmount":
        """The tolerance of ``factor``."""
        return ToleranceAmount(
            name=factor.name,
            words=factor.phrase,
            unit=factor.unit,
            amount=factor.amount,
            distribution=FIELD if factor.kind == "field" else factor.distribution,
        )


@public
class Yield(SimulatedResult):
    """Parts drawn from the tolerances of the spec, and their light.

    Names of metrics begin with that of the LED, where there are several.

    ``parts``: number of parts. ``lamps``: of each part. ``leds``: names of several LEDs, with each of which every part
    is measured. ``rays``: of a part, with all LEDs. ``seed``: of the parts. ``preset``: gives the tolerances that the
    spec leaves out. ``tolerances``: amount and distribution of each. ``bounds``: what a part must keep. ``pass_rate``:
    share of the parts that do, with its interval. ``metrics``: spread of each metric over the parts. ``variance``:
    shares of its variance by cause. ``roads``: by the applications of the spec, of which roads were the first.
    ``budget``: largest amount of each tolerance; None where it was not sought. ``flux``: that of the LED at which
    enough parts pass; None if no bound depends on it. ``worst``: the worst parts. ``worst_leds``: LED with which each
    of them is worst.
    ``notes``: remarks on the study. ``columns``: names of the numbers drawn and of the metrics. ``table``: a row for
    each part; numbers in the unit of the spec, those of each of several lamps left out. ``worst_maps``: light of the
    worst parts on the first receiver.
    """

    stage: ClassVar[str] = "yield"
    omit_if_empty: ClassVar[tuple[str, ...]] = ("leds", "worst_leds")

    pass_rate: Annotated[PassRate, Figure("Yield", "95\u2009% confidence: {pass_rate.interval}", of="value", unit="%")]
    parts: Annotated[Count, Field(ge=2, le=MOST_PARTS), Figure("Parts")]
    lamps: Annotated[Count, Figure("Lamps of each part", "drawn apart", when=lambda study: study.lamps > 1)] = 1
    leds: tuple[Text, ...] = ()
    rays: Annotated[Count, Figure("Rays of each part")]
    seed: Count
    preset: Text
    tolerances: tuple[ToleranceAmount, ...]
    bounds: Annotated[tuple[MetricBound, ...], Field(max_length=_MOST_BOUNDS)]
    metrics: dict[Text, MetricSpread]
    variance: dict[Text, Variance]
    roads: tuple[ApplicationYield, ...] = ()
    budget: Annotated[Budget | None, Apart()]
    flux: FluxNeeded | None = None
    worst: tuple[WorstPart, ...]
    worst_leds: tuple[Text, ...] = ()
    notes: tuple[Text, ...]
    seconds: NotNegative
    columns: tuple[Text, ...]
    table: Annotated[Float[np.ndarray, "parts columns"], Array("parts", "columns")]
    worst_maps: Annotated[Float[np.ndarray, "worst h w"], Array("worst", "h", "w", gaps=False)]

    def column(self, name: str) -> Float[np.ndarray, " parts"]:
        """One number of every part."""
        return self.table[:, self.columns.index(name)]

    @property
    def passing(self) -> Bool[np.ndarray, " parts"]:
        """Parts that keep every bound."""
        return self.passing_with("")

    def passing_with(self, led: str) -> Bool[np.ndarray, " parts"]:
        """Parts that keep every bound with one of several LEDs."""
        passes = np.ones(len(self.table), dtype=bool)
        for bound in self.bounds:
            if bound.metric.startswith(f"{led}: " if led else ""):
                passes &= bound.kept_by(self.column(bound.metric))
        return passes

    def without_noise(self, name: str) -> Float[np.ndarray, " parts"]:
        """A metric of every part as used for percentiles, see :func:`drawn_to_mean`."""
        return drawn_to_mean(self.column(name), self.metrics[name].spread)

    def products(self) -> dict[str, bytes]:
        """The table of parts as CSV; a metric whose spread is the noise of the rays says so in its column's name."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")  # names of receivers and limits may hold commas
        noisy = {name for name, spread in self.metrics.items() if spread.undecided}
        writer.writerow(("part", *(f"{name} (undecided)" if name in noisy else name for name in self.columns)))
        writer.writerows((number, *(f"{value:.9g}" for value in row)) for number, row in enumerate(self.table))
        return {".csv": buffer.getvalue().encode()}

    def plot(self, axes: "Axes | None" = None, *, metric: str | None = None) -> "Axes":
        """Share of the parts whose ``metric``, by default the first, is at most the value, with their bound.

        Raises :class:`InputError` for an unknown one.
        """
        first = next(iter(self.metrics))
        metric = require_choice("metric", first if metric is None else metric, self.metrics)
        bound = next((bound.bound for bound in self.bounds if bound.metric == metric), None)
        designed = self.metrics[metric].designed.value
        return plot_distribution(self.column(metric), metric, axes, designed=designed, bound=bound)
