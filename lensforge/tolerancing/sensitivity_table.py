"""Result of the sensitivity study: metrics of the lens as designed, and with each tolerance at its end."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

from pydantic import Field

from lensforge.errors import InputError
from lensforge.evaluation.light import LightMetrics
from lensforge.records import Count, NotNegative, Number, Record, SimulatedResult, Text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MetricName = Literal["uniformity", "rsd", "nmse", "efficiency"]

_MOST_ROWS = 200  # bars of a plot; the study has 34 errors at most, of 21 tolerances


class ErrorRow(Record):
    """One tolerance at its end: its amount, the metrics with it, and their change by it.

    ``change`` is the difference from the lens as designed by the same rays, with the standard error of that difference:
    what both have of the noise cancels. That of uniformity cancels least, since each lens has its own darkest pixels.
    """

    name: Text
    amount: Number
    unit: Text
    metrics: LightMetrics
    change: LightMetrics


class Sensitivity(SimulatedResult):
    """Tolerances of the spec, one at a time at its end, and the change of the light by each.

    ``preset``: that of the tolerances that the spec leaves out.
    """

    stage: ClassVar[str] = "sensitivity"

    nominal: LightMetrics
    rows: Annotated[tuple[ErrorRow, ...], Field(max_length=_MOST_ROWS)]
    preset: Text
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
