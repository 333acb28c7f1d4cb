"""Result of the sensitivity study: metrics of the lens as designed and with each error, and the errors' amounts."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

from pydantic import Field

from lensforge.evaluation.light import LightMetrics
from lensforge.records import Count, NotNegative, Number, Record, SimulatedResult, Text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MetricName = Literal["uniformity", "rsd", "nmse", "efficiency"]


_MOST_ROWS = 200  # bars of a plot; the study has twelve errors


class Amounts(Record):
    """Amount of each error, by default typical of optical shops; lengths in mm, angles in rad."""

    low_order_rms_mm: NotNegative = 1e-3
    fine_rms_mm: NotNegative = 1e-4
    decentre_mm: Number = 0.02
    tilt_rad: Number = 1e-3
    gap_mm: Number = 0.02
    source_mm: Number = 0.05
    index: Number = 1e-3


class Change(Record):
    """Change of the metrics from the lens as designed, with the same rays.

    Most of the noise of NMSE and efficiency cancels. That of uniformity and RSD does not, since each lens has its own
    darkest pixels: a change is told from noise where it exceeds their standard errors.
    """

    uniformity: Number | None
    rsd: Number | None
    nmse: Number
    efficiency: Number


class ErrorRow(Record):
    """One error of form, position, source or index: its amount, and the metrics with it."""

    name: Text
    amount: Number
    unit: Text
    metrics: LightMetrics
    change: Change


class Sensitivity(SimulatedResult):
    """Small manufacturing and alignment errors of given ``amounts``, and the change of the light by each."""

    stage: ClassVar[str] = "sensitivity"

    nominal: LightMetrics
    rows: Annotated[tuple[ErrorRow, ...], Field(max_length=_MOST_ROWS)]
    amounts: Amounts
    rays: Count
    seconds: NotNegative

    def plot(self, axes: "Axes | None" = None, *, metric: MetricName = "nmse") -> "Axes":
        """Plot the change of ``metric`` by each error. Raises :class:`InputError` for an unknown one."""
        from lensforge.figures.plots import plot_bars, require_choice

        require_choice("metric", metric, get_args(MetricName))
        changes = {f"{row.name} {row.amount:g} {row.unit}": getattr(row.change, metric) or 0.0 for row in self.rows}
        return plot_bars(changes, f"change of {metric}", axes)
