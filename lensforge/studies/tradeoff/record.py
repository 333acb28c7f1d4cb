"""The result of the trade-off: every ladder of one scene, and what each preset costs and leaves there."""

from typing import TYPE_CHECKING, ClassVar

from lensforge.records import Count, Metric, NotNegative, Number, Record, StageResult, Text
from lensforge.spec import Accuracy
from lensforge.studies.tradeoff.ladder import Ladder

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class PresetStage(Record):
    """What a preset leaves in design or evaluation; ``table_*`` None where its tables were not measured.

    ``noise_nmse``: of the filtered irradiance, by ``rays`` rays; ``table_share``: the table's irradiance NMSE over it.
    """

    rays: Count
    noise_nmse: Number
    table_rho: Metric | None = None
    table_normal: Metric | None = None
    table_hit: Metric | None = None
    table_hit_99_percent: Metric | None = None
    table_irradiance_nmse: Metric | None = None
    table_share: Number | None = None
    efficiency_standard_error: NotNegative | None = None


class PresetPrice(Record):
    """A preset in its two stages."""

    design: PresetStage
    evaluation: PresetStage


class MeasuredLens(Record):
    """How the lens was designed that the ladders were measured on."""

    accuracy: Accuracy
    seed: Count
    version: Text


class Tradeoff(StageResult):
    """Accuracy against time for one scene: ``ladders`` by name, ``presets`` read off them, on ``threads`` threads."""

    stage: ClassVar[str] = "tradeoff"

    name: Text
    lens: MeasuredLens
    threads: Count
    presets: dict[Accuracy, PresetPrice]
    ladders: dict[Text, Ladder]
    seconds: NotNegative

    def plot(self, axes: "Axes | None" = None, *, ladder: str = "rays", error: str | None = None) -> "Axes":
        """An error of a ladder, the first one that it plots, over time or setting; one line for each series.

        Raises :class:`InputError` for an unknown ladder, or an error that it has not.
        """
        from lensforge.figures.plots import plot_curves, require_choice

        require_choice("ladder", ladder, self.ladders)
        drawn = self.ladders[ladder]
        error = next(iter(drawn.plotted or drawn.units)) if error is None else error
        require_choice("error", error, drawn.units)
        curves: dict[str, tuple[list[float], list[float]]] = {}
        for rung in drawn.rows:
            at = rung.seconds if drawn.against == "seconds" else rung.setting
            if at and not rung.reference and rung.errors[error].value > 0.0:
                across, up = curves.setdefault(rung.series, ([], []))
                across.append(at)
                up.append(rung.errors[error].value)
        labels = (drawn.against if drawn.against == "seconds" else drawn.knob, error)
        return plot_curves(curves, labels, axes, (True, True))
