"""Accuracy against computing time on one scene: what each setting costs, and which error it leaves."""

from dataclasses import replace
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field

from lensforge.light.evaluation_result import LightMetrics
from lensforge.light.receiver_light import EFFICIENCY, NMSE
from lensforge.public import public
from lensforge.results import Count, Fact, Group, Metric, NotNegative, Record, StageResult, Text
from lensforge.results.arguments import require_choice
from lensforge.results.figure import Figure, facts_in
from lensforge.results.plots import Axes, plot_curves
from lensforge.spec import AnyAccuracy

Series = Literal["search", "rays", "presets"]
TradedError = Literal["nmse", "efficiency"]


@public
class TradeoffRow(Record):
    """One setting of a series: its cost, and the light that it finds on the first receiver.

    ``search``: the lens at the end of a stage of one search, with its ``functions`` a surface and gradient ``steps``.
    ``rays``: an evaluation with so many rays. ``presets``: the evaluation of an accuracy preset, with at most the rays
    asked for.
    ``seconds``: of the search so far, or of the evaluation. ``nmse``, ``efficiency``: noise taken off, with standard
    errors. ``noise_nmse``: what the noise of the rays adds to the NMSE of the picture. ``by_led``: the light with each
    LED, of a lens for several; then nmse and efficiency are each of the LED which has it worst.
    """

    series: Series
    setting: Text
    seconds: Annotated[NotNegative, Figure("Time", digits=2)]
    rays: Annotated[Count, Figure("Rays")]
    nmse: Annotated[Metric, replace(NMSE, label="NMSE")]
    efficiency: Annotated[Metric, EFFICIENCY]
    noise_nmse: Annotated[NotNegative | None, Figure("Ray noise, NMSE", key="noise", digits=2)] = None
    functions: Count | None = None
    steps: Annotated[Count | None, Figure("Steps")] = None
    by_led: dict[Text, LightMetrics] = Field(default_factory=dict)

    @property
    def facts(self) -> Group:
        """The cost of the setting, and the errors that it leaves."""
        worst = f", worst of {len(self.by_led)} LEDs" if self.by_led else ""
        return Group(self.setting, f"{self.setting}{worst}", tuple(facts_in(self)))

    @property
    def line(self) -> Fact:
        """The setting in one line: its NMSE, and behind it efficiency, time and rays."""
        named = {fact.key: fact.text for fact in self.facts.facts}
        note = f"efficiency {named['efficiency']}, {named['seconds']}, {named['rays']} rays"
        return Fact.measured("setting", self.setting, self.nmse, note=note, is_square=True)

    def error(self, name: TradedError) -> float:
        """NMSE, or lost light, of a stage of the search; the standard error of an evaluation, 0 where it is unknown."""
        metric = self.nmse if name == "nmse" else self.efficiency
        if self.series != "search":
            return metric.standard_error or 0.0
        return metric.value if name == "nmse" else 1.0 - metric.value


@public
class Tradeoff(StageResult):
    """Accuracy against computing time on one scene.

    ``name``: of the spec. ``accuracy``: by which the lens was designed. ``threads``: used. ``rows``: each setting of
    all series, with its seconds and its errors.
    """

    stage: ClassVar[str] = "tradeoff"
    in_folder: ClassVar[bool] = False

    name: Text
    accuracy: AnyAccuracy
    threads: Count
    rows: tuple[TradeoffRow, ...]
    seconds: NotNegative

    def series(self, name: Series) -> tuple[TradeoffRow, ...]:
        """Rows of a series."""
        return tuple(row for row in self.rows if row.series == name)

    @property
    def facts(self) -> list[Group]:
        """A line for each accuracy preset, and one for each stage of the search."""
        lines = tuple(row.line for row in self.rows if row.series != "rays")
        return [Group("settings", "Presets, and stages of a search", lines)]

    def plot(self, axes: "Axes | None" = None, *, series: Series = "rays", error: TradedError = "nmse") -> "Axes":
        """Plot ``error`` of ``series`` over seconds, in logarithms. Raises :class:`InputError` for unknown ones."""
        require_choice("series", series, get_args(Series))
        require_choice("error", error, get_args(TradedError))
        shown = [row for row in self.series(series) if row.seconds > 0.0 and row.error(error) > 0.0]
        curve = [row.seconds for row in shown], [row.error(error) for row in shown]
        return plot_curves({series: curve}, ("seconds", error_label(series, error)), axes, (True, True))


def error_label(series: Series, error: TradedError) -> str:
    """Name of an error of a series at the axis of a plot."""
    if series == "search":
        return "NMSE" if error == "nmse" else "lost light"
    return f"standard error of the {'NMSE' if error == 'nmse' else error}"
