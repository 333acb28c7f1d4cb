"""Light at stops on the travel of an LED between the states of a lens: few rays, for pictures and a curve.

All stops have the same rays, moved: what differs between them is the travel, not the noise.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.results import Count, Fact, Group, Irradiance, Metric, Number, Positive, Record, Text
from lensforge.results.chart import Chart, LightUnit, light_unit
from lensforge.results.estimates import jackknife_metric, scaled
from lensforge.results.numerals import number

_HALF = 0.5  # of the largest light: where a width is measured
_BESIDE = 2  # rows or columns on each side of the axis whose mean is a cut


class TravelStop(Record):
    """Light at one stop.

    ``shift_mm``: along the travel, from the place in the first state. ``state``: the state whose stop it is; empty
    between them. ``map``: irradiance (W/m²), in the far field intensity (W/sr), [row y, column x]. ``on_axis``: mean of
    the four pixels about the axis. ``width``: full width at half of the largest light, mean of the cuts along x and y;
    in mm, in the far field in degrees; None where a cut is not dark at its ends.
    """

    shift_mm: Number
    state: Text
    map: Irradiance
    on_axis: Metric
    width: Positive | None

    @staticmethod
    def of(shift_mm: float, state: str, images: Float[np.ndarray, "r h w"], chart: Chart) -> "TravelStop":
        """The stop with ``images`` (W/m² or W/sr) of every replicate."""
        middle = [slice(size // 2 - 1, size // 2 + 1) for size in images.shape[1:]]
        light = images.mean(axis=0)
        unit = light_unit(None, far_field=chart.far_field)
        widths = [cut.width() for cut in cuts(light, chart).values()]
        return TravelStop(
            shift_mm=shift_mm,
            state=state,
            map=light,
            on_axis=jackknife_metric(images[:, *middle].mean(axis=(1, 2)), float, unit.symbol),
            width=None if None in widths else float(np.mean([width for width in widths if width])),
        )

    @property
    def title(self) -> str:
        """The stop in a word: its place, and the state that stops there."""
        return ", ".join(filter(None, (f"{number(self.shift_mm, 3)} mm", self.state)))

    def group(self, chart: Chart, unit: LightUnit) -> Group:
        """Its figures."""
        on_axis = scaled(self.on_axis, unit.per_watt, unit.symbol)
        facts = (
            Fact.measured("on_axis", f"{unit.quantity[:1].upper()}{unit.quantity[1:]} on the axis", on_axis),
            Fact("width", "Full width at half maximum", self.width, chart.unit, digits=3),
        )
        return Group("stop", self.title, facts)


class Travel(Record):
    """Light at ``stops`` on the travel of an LED, in their order; ``rays``: at each; ``place``: of the receiver.

    ``width``, ``height``: of its chart, in mm, or for the far field of the equal-area chart, 2 sin(gamma / 2).
    """

    stops: Annotated[tuple[TravelStop, ...], Field(min_length=2)]
    rays: Count
    place: Text
    width: Positive
    height: Positive
    far_field: bool

    @property
    def chart(self) -> Chart:
        """Size of the maps, for figures."""
        return Chart(self.width, self.height, self.far_field)

    def groups(self, unit: LightUnit) -> Iterator[Group]:
        """The figures of each stop."""
        return (stop.group(self.chart, unit) for stop in self.stops)


class Cut(NamedTuple):
    """Light along a line through the axis, at ``places`` (mm, or degrees from the axis)."""

    places: Float[np.ndarray, " k"]
    light: Float[np.ndarray, " k"]

    def width(self) -> float | None:
        """Distance of the outermost places with half of the largest light; None where it is as bright at an end."""
        level = _HALF * self.light.max()
        (bright,) = np.nonzero(self.light >= level)
        first = bright[0]
        last = bright[-1]
        if not level > 0.0 or first == 0 or last == len(self.light) - 1:
            return None
        low, high = (
            float(np.interp(level, self.light[pair], self.places[pair]))
            for pair in ([first - 1, first], [last + 1, last])
        )
        return high - low


def cuts(light: Float[np.ndarray, "h w"], chart: Chart) -> dict[str, Cut]:
    """Cuts along x and along y: the mean of a few rows or columns beside the axis."""
    rows, columns = light.shape
    along = {"x": (chart.x(columns), light), "y": (chart.y(rows), light.T)}
    return {
        name: Cut(
            np.array([chart.labelled(place) for place in places.tolist()]),
            lines[len(lines) // 2 - _BESIDE : len(lines) // 2 + _BESIDE].mean(axis=0),
        )
        for name, (places, lines) in along.items()
    }
