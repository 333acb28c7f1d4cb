"""The result of the sensitivity study: the metrics of the lens as designed, and of it with each error."""

from typing import TYPE_CHECKING, ClassVar, Literal, get_args

from lensforge.evaluation.light import Judged
from lensforge.records import Count, NotNegative, Number, Record, StageResult, Text
from lensforge.tolerancing.amounts import Amounts

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MetricName = Literal["uniformity", "rsd", "nmse", "efficiency"]


class Change(Record):
    """Metrics less those of the lens as designed, by the same rays: most of the noise of both cancels."""

    uniformity: Number | None
    rsd: Number | None
    nmse: Number
    efficiency: Number


class ErrorRow(Record):
    """One error of form, position, source or index: its amount, and what it does."""

    name: Text
    amount: Number
    unit: Text
    metrics: Judged
    change: Change


class Sensitivity(StageResult):
    """Small errors of making and mounting, and how they change the light.

    ``amounts``: how much of each kind of error.
    """

    stage: ClassVar[str] = "sensitivity"

    nominal: Judged
    rows: tuple[ErrorRow, ...]
    amounts: Amounts
    rays: Count
    seconds: NotNegative

    def plot(self, axes: "Axes | None" = None, *, metric: MetricName = "nmse") -> "Axes":
        """By how much each error changes ``metric``. Raises :class:`InputError` for an unknown one."""
        from lensforge.figures.plots import plot_bars, require_choice

        require_choice("metric", metric, get_args(MetricName))
        changes = {f"{row.name} {row.amount:g} {row.unit}": getattr(row.change, metric) or 0.0 for row in self.rows}
        return plot_bars(changes, f"change of {metric}", axes)
