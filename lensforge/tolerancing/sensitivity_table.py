"""Result of the sensitivity study: metrics of the lens as designed and with each error, and the errors' amounts."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

from pydantic import Field

from lensforge.errors import InputError
from lensforge.evaluation.light import LightMetrics
from lensforge.records import Count, NotNegative, Number, Record, SimulatedResult, Text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MetricName = Literal["uniformity", "rsd", "nmse", "efficiency"]

_MOST_ROWS = 200  # bars of a plot; the study has 15 errors: 4 of form, 5 of position, 4 of the source, 2 of the index


class Amounts(Record):
    """Amount of each error, by default typical of optical shops; lengths in mm, angles in rad."""

    low_order_rms_mm: NotNegative = 1e-3
    fine_rms_mm: NotNegative = 1e-4
    decentre_mm: Number = 0.02
    tilt_rad: Number = 1e-3
    gap_mm: Number = 0.02
    source_mm: Number = 0.05
    index: Number = 1e-3


class ErrorRow(Record):
    """One error of form, position, source or index: its amount, the metrics with it, and their change by it.

    ``change`` is the difference from the lens as designed by the same rays, with the standard error of that difference:
    what both have of the noise cancels. That of uniformity cancels least, since each lens has its own darkest pixels.
    """

    name: Text
    amount: Number
    unit: Text
    metrics: LightMetrics
    change: LightMetrics


class Sensitivity(SimulatedResult):
    """Small manufacturing and alignment errors of given ``amounts``, and the change of the light by each."""

    stage: ClassVar[str] = "sensitivity"

    nominal: LightMetrics
    rows: Annotated[tuple[ErrorRow, ...], Field(max_length=_MOST_ROWS)]
    amounts: Amounts
    rays: Count
    seconds: NotNegative

    def plot(self, axes: "Axes | None" = None, *, metric: MetricName = "nmse") -> "Axes":
        """Plot the change of ``metric`` by each error, with its standard error.

        Raises :class:`InputError` for an unknown one, and for one that the spec has no region for.
        """
        from lensforge.figures.plots import plot_bars, require_choice

        require_choice("metric", metric, get_args(MetricName))
        if getattr(self.nominal, metric) is None:
            raise InputError(f"metric = {metric!r}: the spec names no region of uniform light; plot nmse or efficiency")
        changes = {f"{row.name} {row.amount:g} {row.unit}": getattr(row.change, metric) for row in self.rows}
        values = {name: 0.0 if change is None else change.value for name, change in changes.items()}
        errors = [0.0 if change is None else change.standard_error or 0.0 for change in changes.values()]
        return plot_bars(values, f"change of {metric}", axes, errors)
