"""Result of the trade-off: the convergence studies of one scene, and the accuracy of each preset there."""

from typing import TYPE_CHECKING, ClassVar

from lensforge.results import Count, Metric, NotNegative, Number, Record, StageResult, Text
from lensforge.runs.tradeoff.convergence import ConvergenceStudy
from lensforge.spec import Accuracy

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class PresetStage(Record):
    """Errors of a preset in design or evaluation; ``table_*`` None where its tables were not measured.

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


class PresetAccuracy(Record):
    """Accuracy of a preset in its two stages."""

    design: PresetStage
    evaluation: PresetStage


class MeasuredLens(Record):
    """Preset, seed and program version by which the measured lens was designed."""

    accuracy: Accuracy
    seed: Count
    version: Text


class Tradeoff(StageResult):
    """Accuracy against time for one scene: the convergence ``studies`` by name, and the accuracy of the ``presets``."""

    stage: ClassVar[str] = "tradeoff"

    name: Text
    lens: MeasuredLens
    threads: Count
    presets: dict[Accuracy, PresetAccuracy]
    studies: dict[Text, ConvergenceStudy]
    seconds: NotNegative

    def plot(self, axes: "Axes | None" = None, *, study: str = "rays", error: str | None = None) -> "Axes":
        """Plot an error of a study, by default its first, over time or setting; one line for each series.

        Raises :class:`InputError` for an unknown study, or an error that it does not have.
        """
        from lensforge.results.plots import plot_curves, require_choice

        require_choice("study", study, self.studies)
        drawn = self.studies[study]
        error = drawn.plotted[0] if error is None else error
        require_choice("error", error, drawn.units)
        curves: dict[str, tuple[list[float], list[float]]] = {}
        for level in drawn.levels:
            position = level.seconds if drawn.against == "seconds" else level.setting
            if position and not level.reference and level.errors[error].value > 0.0:
                x, y = curves.setdefault(level.series, ([], []))
                x.append(position)
                y.append(level.errors[error].value)
        labels = (drawn.against if drawn.against == "seconds" else drawn.knob, error)
        return plot_curves(curves, labels, axes, (True, True))
