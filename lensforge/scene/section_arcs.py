"""The faces of a linear lens along its section: which of them bounds a medium at which angles from z.

In the plane y = 0 the nearest of the faces bounds the medium. Each does so over one arc or several: the cap of a cavity
between both sides of its side. The corners between arcs are the creases, straight along y.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.surfaces.drawn_profile import DrawnFace, in_section

_ANGLES = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 7201)  # at which faces are compared: 0.025 degrees apart
_Angles = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class FaceArc:
    """A face over the angles (rad) from z, positive towards +x, at which it bounds its medium."""

    name: str
    face: DrawnFace
    low_rad: float
    high_rad: float

    def angles(self, count: int) -> _Angles:
        """Even angles from end to end."""
        return np.linspace(self.low_rad, self.high_rad, count)

    def holds(self, angles_rad: _Angles) -> np.ndarray:
        """Mask of the angles within it."""
        return (angles_rad >= self.low_rad) & (angles_rad <= self.high_rad)

    @property
    def side(self) -> int:
        """Sign of x on it; 0 for one that has both sides of the axis."""
        return int(np.sign(self.low_rad) + np.sign(self.high_rad)) // 2


def numbered(arcs: Sequence[FaceArc]) -> dict[str, FaceArc]:
    """Arcs by the names of their faces, with a number where a face has several."""
    names = [arc.name for arc in arcs]
    return {
        name if names.count(name) == 1 else f"{name}_{names[: number + 1].count(name)}": arc
        for number, (name, arc) in enumerate(zip(names, arcs, strict=True))
    }


def points_along(arcs: Sequence[FaceArc], angles_rad: _Angles) -> Float[np.ndarray, "n 2"]:
    """Points (x, z) in mm of the section of a medium at angles from z."""
    points = np.empty((len(angles_rad), 2))
    for arc in arcs:
        here = arc.holds(angles_rad)
        points[here] = arc.face.points(angles_rad[here])
    return points


def arcs_of(faces: Sequence[tuple[str, DrawnFace]]) -> tuple[FaceArc, ...]:
    """The arcs of the faces that bound one medium, from -x to +x.

    Raises :class:`InputError` for a face that is nowhere the nearest.
    """
    from scipy.optimize import brentq

    directions = in_section(_ANGLES)
    nearest = np.stack([face.radius(directions) for _, face in faces]).argmin(axis=0)
    ends = np.flatnonzero(np.diff(nearest))
    corners = [-0.5 * np.pi]
    for k in ends.tolist():
        one, other = (faces[number][1] for number in nearest[[k, k + 1]])

        def gap(angle: float, one: DrawnFace = one, other: DrawnFace = other) -> float:
            direction = in_section(np.array([angle]))
            return float((one.value(direction) - other.value(direction))[0])

        corners.append(float(brentq(gap, _ANGLES[k], _ANGLES[k + 1], xtol=1e-15)))
    numbers = nearest[[*ends.tolist(), -1]].tolist()
    if hidden := [name for number, (name, _) in enumerate(faces) if number not in numbers]:
        others = ", ".join(name for name, _ in faces if name != hidden[0])
        raise InputError(
            f"{hidden[0]}: nowhere the nearest seen from the origin, by {others}; move one of these faces, or leave it "
            "out"
        )
    spans = pairwise([*corners, 0.5 * np.pi])
    bounding = (faces[number] for number in numbers)
    return tuple(FaceArc(name, face, low, high) for (name, face), (low, high) in zip(bounding, spans, strict=True))
