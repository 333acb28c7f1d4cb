"""Chart of a receiver for figures, with the labels of its axes, and the unit in which light is shown."""

from dataclasses import dataclass
from math import asin, degrees, radians, sin
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis


@dataclass(frozen=True)
class LightUnit:
    """The quantity on a receiver, its unit, and its amount per W/m^2, or in the far field per W/sr."""

    quantity: str
    symbol: str
    per_watt: float

    @property
    def label(self) -> str:
        """Label of an axis or a scale."""
        return f"{self.quantity} ({self.symbol})"


WATTS = LightUnit("irradiance", "W/m²", 1.0)
WATTS_PER_SR = LightUnit("intensity", "W/sr", 1.0)


def light_unit(lumens_per_watt: float | None, *, far_field: bool = False) -> LightUnit:
    """Lux or candela if the source's luminous efficacy is known, else W/m^2 or W/sr."""
    if lumens_per_watt is None:
        return WATTS_PER_SR if far_field else WATTS
    quantity, symbol = ("luminous intensity", "cd") if far_field else ("illuminance", "lx")
    return LightUnit(quantity, symbol, lumens_per_watt)


_STEPS_DEG = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0)  # between labels of angles
_MOST_LABELS = 4  # of angles on either side of the axis
_MOST_MM = 2000.0  # size of a receiver: beyond it, places have four digits in mm
_ROUNDING = 1e-9  # relative, of an angle that goes to the chart and back


@dataclass(frozen=True)
class Chart:
    """A rectangle of ``width`` x ``height`` mm or, in the far field, of an equal-area chart: 2 sin(gamma / 2)."""

    width: float
    height: float
    far_field: bool = False

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper edge."""
        return -0.5 * self.width, 0.5 * self.width, -0.5 * self.height, 0.5 * self.height

    @property
    def unit(self) -> str:
        """Unit of coordinates in labels."""
        return "°" if self.far_field else "mm"

    def x(self, columns: int) -> Float[np.ndarray, " w"]:
        """Centres of ``columns`` columns."""
        return _centres(self.width, columns)

    def y(self, rows: int) -> Float[np.ndarray, " h"]:
        """Centres of ``rows`` rows."""
        return _centres(self.height, rows)

    def label(self, axes: "Axes") -> None:
        """Label the axes of a map of the receiver."""
        axes.set(xlabel=f"x ({self.unit_drawn})", ylabel=f"y ({self.unit_drawn})")
        if self.far_field:
            self.label_angles(axes, x=0.5 * self.width, y=0.5 * self.height)
        self.label_metres(axes.xaxis, axes.yaxis)

    @property
    def unit_drawn(self) -> str:
        """Unit at the axes of figures: metres if numbers in mm would be too long to stand side by side."""
        return "m" if self._in_metres else self.unit

    @property
    def _in_metres(self) -> bool:
        return not self.far_field and max(self.width, self.height) > _MOST_MM

    def label_metres(self, *axes: "Axis") -> None:
        """Label ``axes`` in mm with numbers in ``unit_drawn``."""
        for axis in axes if self._in_metres else ():
            axis.set_major_formatter(lambda value, _: f"{1e-3 * value:g}".replace("-", "−"))

    def label_angles(self, axes: "Axes", *, x: float = 0.0, y: float = 0.0) -> None:
        """Label angles where they lie on the chart, along axes of lengths ``x`` and ``y`` from its centre."""
        for axis, reach in ((axes.xaxis, x), (axes.yaxis, y)):
            if reach > 0.0:
                positive = angles_to(reach)
                angles = [*(-angle for angle in reversed(positive)), 0.0, *positive]
                labels = [f"{angle:g}".replace("-", "−") for angle in angles]
                axis.set_ticks([on_chart(angle) for angle in angles], labels)

    def labelled(self, length: float) -> float:
        """A distance from the centre as labelled: in mm, or in degrees from the axis of a far field."""
        return _angle(length) if self.far_field else length


def angles_to(reach: float) -> list[float]:
    """Round angles (degrees) above 0 that lie within ``reach`` of the centre of a far field's chart."""
    last = _angle(reach) * (1.0 - _ROUNDING)
    step = next((step_deg for step_deg in _STEPS_DEG if _MOST_LABELS * step_deg >= last), _STEPS_DEG[-1])
    return [step * number for number in range(1, int(last / step + 2.0 * _MOST_LABELS * _ROUNDING) + 1)]


def on_chart(angle_deg: float) -> float:
    """Distance from the centre of a far field's chart for an angle from the axis."""
    return 2.0 * sin(0.5 * radians(angle_deg))


def _angle(distance: float) -> float:
    """Angle (degrees) from the axis for a distance from the centre of a far field's chart, negative to the left."""
    return degrees(2.0 * asin(max(-1.0, min(0.5 * distance, 1.0))))


def _centres(length: float, count: int) -> Float[np.ndarray, " k"]:
    return ((np.arange(count) + 0.5) / count - 0.5) * length
