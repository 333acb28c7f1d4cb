"""Closed loops of straight lines and arcs in the plane: their area, points along them, and distances of places.

A loop is written as corners, each with the bulge of the edge to the next one, as drawings in DXF have it: the tangent
of a quarter of an arc's angle, above 0 where it runs counter-clockwise, and 0 for a line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, pi, sin

import numpy as np
from jaxtyping import Float

# Files of ``step_outline``, which runs in a child process: a damaged STEP file may crash the kernel.
DRAWING = "drawing.step"
JOB = "job.json"
FOUND = "loops.json"
MOST_LOOPS = 200
MOST_CORNERS = 1000

Place = tuple[float, float]
Corner = tuple[float, float, float]  # x and y (mm), and the bulge of the edge to the next corner


@dataclass(frozen=True)
class LoopEdge:
    """A line from ``start`` to ``end`` (mm), or an arc between them about ``centre``, counter-clockwise or not.

    An arc that ends where it starts is a whole circle.
    """

    start: Place
    end: Place
    centre: Place | None = None
    clockwise: bool = False

    @property
    def radius_mm(self) -> float:
        """Radius of an arc; 0 of a line."""
        return 0.0 if self.centre is None else hypot(self.start[0] - self.centre[0], self.start[1] - self.centre[1])

    @property
    def azimuths(self) -> tuple[float, float]:
        """Azimuths (rad) of an arc's ends about its centre; the second one is smaller where it runs clockwise."""
        x, y = self.centre or (0.0, 0.0)
        first, last = (atan2(point[1] - y, point[0] - x) for point in (self.start, self.end))
        if self.clockwise:
            return first, last if last < first - 1e-9 else last - 2.0 * pi
        return first, last if last > first + 1e-9 else last + 2.0 * pi

    @property
    def twice_area_mm2(self) -> float:
        """Integral of x dy - y dx along the edge."""
        (x0, y0) = self.start
        (x1, y1) = self.end
        if self.centre is None:
            return x0 * y1 - y0 * x1
        first, last = self.azimuths
        return self.radius_mm**2 * (last - first) + self.centre[0] * (y1 - y0) - self.centre[1] * (x1 - x0)

    def at(self, shares: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
        """Points along the edge, from its start at 0 to its end at 1."""
        if self.centre is None:
            return np.array(self.start) + shares[..., None] * np.subtract(self.end, self.start)
        first, last = self.azimuths
        turns = first + shares * (last - first)
        return np.array(self.centre) + self.radius_mm * np.stack([np.cos(turns), np.sin(turns)], axis=-1)

    def points(self, chord_mm: float) -> Float[np.ndarray, "n 2"]:
        """Points from the start up to, but without, the end; chords of an arc deviate by at most ``chord_mm``."""
        if self.centre is None:
            return np.array([self.start])
        first, last = self.azimuths
        step = 2.0 * np.arccos(max(1.0 - chord_mm / self.radius_mm, 0.5))
        return self.at(np.linspace(0.0, 1.0, max(ceil(abs(last - first) / step), 2), endpoint=False))

    @property
    def farthest(self) -> tuple[Place, ...]:
        """The start, and the points of an arc at which x or y is largest or smallest."""
        if self.centre is None:
            return (self.start,)
        x, y, radius = *self.centre, self.radius_mm
        low, high = sorted(self.azimuths)
        quarters = range(ceil(2.0 * low / pi), int(2.0 * high // pi) + 1)
        return self.start, *((x + radius * cos(k * pi / 2.0), y + radius * sin(k * pi / 2.0)) for k in quarters)

    @property
    def right(self) -> Place:
        """Unit vector to the right of the edge at its middle: outwards if its loop runs counter-clockwise."""
        if self.centre is None:
            x, y = self.end[0] - self.start[0], self.end[1] - self.start[1]
            return y / hypot(x, y), -x / hypot(x, y)
        middle = sum(self.azimuths) / 2.0
        sign = -1.0 if self.clockwise else 1.0
        return sign * cos(middle), sign * sin(middle)

    def away_mm(self, place: Place) -> float:
        """Distance (mm) of ``place`` from the edge."""
        (x, y) = place
        (x0, y0) = self.start
        (x1, y1) = self.end
        if self.centre is None:
            along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2)
            along = min(max(along, 0.0), 1.0)
            return hypot(x - x0 - along * (x1 - x0), y - y0 - along * (y1 - y0))
        low, high = sorted(self.azimuths)
        turn = atan2(y - self.centre[1], x - self.centre[0])
        if any(low <= turn + k * 2.0 * pi <= high for k in (-1, 0, 1)):
            return abs(hypot(x - self.centre[0], y - self.centre[1]) - self.radius_mm)
        return min(hypot(x - x0, y - y0), hypot(x - x1, y - y1))

    def turns_about(self, place: Place) -> float:
        """Angle (rad) that the edge subtends at ``place``, signed by its direction."""
        ways = [(at[0] - place[0], at[1] - place[1]) for at in (self.start, self.end)]
        (x0, y0), (x1, y1) = ways
        turned = 0.0 if self.start == self.end else atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
        if self.centre is None:
            return turned
        beside = (y1 - y0) * x0 - (x1 - x0) * y0  # above 0 on the left of the chord
        in_circle = hypot(place[0] - self.centre[0], place[1] - self.centre[1]) < self.radius_mm
        if in_circle and (self.start == self.end or (beside > 0.0) == self.clockwise):
            turned += -2.0 * pi if self.clockwise else 2.0 * pi
        return turned


Loop = tuple[LoopEdge, ...]


def circle_at(place: Place, radius_mm: float) -> Loop:
    """The circle about ``place``, counter-clockwise from +x."""
    start = (place[0] + radius_mm, place[1])
    return (LoopEdge(start, start, place),)


def loop_of(corners: Sequence[Corner]) -> Loop:
    """The loop through ``corners``."""
    return tuple(
        _edge(corner, next_corner) for corner, next_corner in zip(corners, (*corners[1:], corners[0]), strict=True)
    )


def _edge(start: Corner, end: Corner) -> LoopEdge:
    (x0, y0, bulge) = start
    (x1, y1, _) = end
    if bulge == 0.0:
        return LoopEdge((x0, y0), (x1, y1))
    across = (1.0 / bulge - bulge) / 4.0  # of the chord, from its middle to the left
    centre = 0.5 * (x0 + x1) - across * (y1 - y0), 0.5 * (y0 + y1) + across * (x1 - x0)
    return LoopEdge((x0, y0), (x1, y1), centre, bulge < 0.0)


def reversed_corners(corners: Sequence[Corner]) -> list[Corner]:
    """The corners of the same loop, run the other way."""
    back = list(reversed(corners))
    return [(x, y, -before[2]) for (x, y, _), before in zip(back, [*back[1:], back[0]], strict=True)]


def circle_of(corners: Sequence[Corner]) -> tuple[Place, float] | None:
    """Centre (mm) and radius (mm) of a loop of two half circles; None for any other loop."""
    if len(corners) != 2 or any(abs(abs(bulge) - 1.0) > 1e-12 for *_, bulge in corners):
        return None
    (x0, y0, _), (x1, y1, _) = corners
    return (0.5 * (x0 + x1), 0.5 * (y0 + y1)), 0.5 * hypot(x1 - x0, y1 - y0)


def bulge_of(angle_rad: float) -> float:
    """Bulge of an arc of ``angle_rad``; positive if counter-clockwise."""
    return sin(angle_rad / 4.0) / cos(angle_rad / 4.0)


def area_mm2(loop: Loop) -> float:
    """Area (mm^2) within a loop; negative if the loop runs clockwise."""
    return sum(edge.twice_area_mm2 for edge in loop) / 2.0


def points_on(loop: Loop, chord_mm: float) -> Float[np.ndarray, "n 2"]:
    """Points (mm) along the loop."""
    return np.concatenate([edge.points(chord_mm) for edge in loop])


def inside_by_mm(loop: Loop, place: Place) -> float:
    """Distance (mm) of ``place`` from a loop; negative outside."""
    away = min(edge.away_mm(place) for edge in loop)
    return away if abs(sum(edge.turns_about(place) for edge in loop)) > pi else -away


def box_of_loop(loop: Loop) -> tuple[Place, Place]:
    """Least and largest x and y (mm) of a loop."""
    x, y = zip(*(place for edge in loop for place in edge.farthest), strict=True)
    return (min(x), min(y)), (max(x), max(y))


def drafted_scale(curve: Float[np.ndarray, "n 2"], slope: float, length_mm: float) -> float:
    """Scale factor from a ``curve``, points (mm) around the axis, to the foot of the conical wall below it.

    The wall's least draft is that of ``slope``, which is negative if it narrows downwards; it occurs where a tangent is
    nearest to the axis.
    """
    along = np.roll(curve, -1, axis=0) - np.roll(curve, 1, axis=0)
    nearest = np.abs(curve[:, 0] * along[:, 1] - curve[:, 1] * along[:, 0]) / np.hypot(*along.T)
    return 1.0 + slope * length_mm / float(nearest.min())
