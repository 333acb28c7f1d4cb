"""Poses: position and orientation of a source, a lamp, a body, a receiver or a made part.

A local frame is right-handed. It is turned about its z axis, from x towards y, then its z axis is tilted: by angles
about the fixed axes x and then y of the parent frame, by the right-hand rule; or the shortest way into a direction, and
about y by half a turn into -z, to which all ways are as short. Last it is shifted. Angles of a spec are in degrees, and
quarter turns are exact. A small displacement is one rotation vector (rad) instead.
"""

from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, pi, radians, sin
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Inexact

from lensforge.kernels.face_records import FacePlacement
from lensforge.optics.arrays import Array, like

Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
ALONG_Z: Vector = (0.0, 0.0, 1.0)
_X, _Y, _Z = range(3)  # numbers of the axes
_Three = Vector | Float[np.ndarray, "3"]
_Matrix = Float[np.ndarray, "3 3"]
_STRAIGHT_BACK = -1.0 + 1e-12  # z of a unit vector, as straight as numbers of 16 digits can tell


@dataclass(frozen=True)
class Pose:
    """A local frame in its parent: its ``origin_mm`` and its unit ``axes`` x, y, z, in coordinates of the parent.

    With the axes as the columns of R, ``parent = R local + origin``.
    """

    origin_mm: Vector = ORIGIN
    axes: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), ALONG_Z)

    @staticmethod
    def of_axes(axes: Float[np.ndarray, "3 3"], origin_mm: _Three = ORIGIN) -> "Pose":
        """The frame with the unit vectors x, y, z in the rows of ``axes``."""
        x, y, z, origin = (_vector(axis) for axis in (*axes, origin_mm))
        return Pose(origin, (x, y, z))

    @staticmethod
    def of_tilts(
        origin_mm: Vector = ORIGIN, tilt_deg: tuple[float, float] = (0.0, 0.0), turn_deg: float = 0.0
    ) -> "Pose":
        """The frame turned about its z axis, tilted about x and then about y, each by its angle, and shifted."""
        about_x, about_y = tilt_deg
        rotation = _about(_Y, about_y) @ _about(_X, about_x) @ _about(_Z, turn_deg)
        return Pose.of_axes(rotation.T, origin_mm)

    @staticmethod
    def facing(direction: Vector, origin_mm: Vector = ORIGIN, turn_deg: float = 0.0) -> "Pose":
        """The frame turned about its z axis, tilted the shortest way until that is along ``direction``, and shifted.

        The direction may have any length but 0.
        """
        tilt = _shortest(np.array(direction) / np.linalg.norm(direction))
        return Pose.of_axes((tilt @ _about(_Z, turn_deg)).T, origin_mm)

    @staticmethod
    def displaced(shift_mm: _Three = ORIGIN, rotation_rad: _Three = ORIGIN, centre_mm: Vector = ORIGIN) -> "Pose":
        """The frame turned about ``centre_mm`` by the rotation vector, and then shifted (Rodrigues' formula)."""
        x, y, z = rotation_rad
        angle = hypot(x, y, z)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        half = np.sinc(0.5 * angle / pi)
        rotation = np.eye(3) + np.sinc(angle / pi) * cross + 0.5 * half**2 * cross @ cross
        centre = np.array(centre_mm)
        return Pose.of_axes(rotation.T, centre - rotation @ centre + np.array(shift_mm))

    @property
    def rotation(self) -> _Matrix:
        """Matrix from local to parent directions: the axes are its columns."""
        return np.array(self.axes).T

    @property
    def axis(self) -> Vector:
        """Direction of its z axis."""
        _, _, z = self.axes
        return z

    @property
    def moves(self) -> bool:
        """False for the identity."""
        return self != IN_PLACE

    @property
    def turn_deg(self) -> float:
        """Turn (degrees) about the z axis, before the shortest tilt."""
        along_x, _, _ = self.seen_from(Pose.facing(self.axis, self.origin_mm)).axes
        x, y, _ = along_x
        return degrees(atan2(y, x))

    def at(self, origin_mm: _Three) -> "Pose":
        """The frame moved to this origin."""
        return Pose(_vector(origin_mm), self.axes)

    def points(self, local: Float[Array, "*n 3"], factor: float = 1.0) -> Float[Array, "*n 3"]:
        """Transform points (mm) from local to parent coordinates; NumPy or torch, as all that follow.

        ``factor``: parent lengths over local ones.
        """
        placed = local @ like(local, self.axes)
        if factor != 1.0:
            placed *= factor
        placed += like(local, self.origin_mm)
        return placed

    def directions(self, local: Inexact[Array, "*n 3"]) -> Inexact[Array, "*n 3"]:
        """Rotate directions or fields from local to parent coordinates."""
        return local @ like(local, self.axes)

    def to_local_points(self, points: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
        """Transform points (mm) from parent to local coordinates."""
        return (points - like(points, self.origin_mm)) @ like(points, self.axes).T

    def to_local_directions(self, directions: Inexact[Array, "*n 3"]) -> Inexact[Array, "*n 3"]:
        """Rotate directions or fields from parent to local coordinates."""
        return directions @ like(directions, self.axes).T

    def to_local_map(self, linear: _Matrix) -> _Matrix:
        """A linear map of parent directions, such as a mirror, in local coordinates."""
        axes = np.array(self.axes)
        return np.asarray(axes @ linear @ axes.T)

    def after(self, inner: "Pose") -> "Pose":
        """Compose: ``inner``, whose parent is this frame, in coordinates of this frame's parent."""
        return Pose.of_axes(self.directions(np.array(inner.axes)), self.points(np.array(inner.origin_mm)))

    def seen_from(self, frame: "Pose") -> "Pose":
        """This frame in coordinates of ``frame``, which has the same parent."""
        return Pose.of_axes(
            frame.to_local_directions(np.array(self.axes)), frame.to_local_points(np.array(self.origin_mm))
        )

    @property
    def inverse(self) -> "Pose":
        """Inverse transform: from parent to local."""
        return IN_PLACE.seen_from(self)

    @property
    def frame(self) -> Float[np.ndarray, "3 4"]:
        """Axes and origin (mm) as columns, for the kernels: in C order, for which they are compiled."""
        return np.ascontiguousarray(np.transpose([*self.axes, self.origin_mm]))


IN_PLACE = Pose()


class FacePoses(NamedTuple):
    """Frames of the faces of a body, in the order in which rays pass them.

    ``into``: from the frame of the rays to that of the first face. ``between``: from a face to the next. ``back``: from
    the last face to the frame of the rays. ``factor_in``, ``factor_out``: of lengths into and back.
    """

    into: Pose
    between: tuple[Pose, ...]
    back: Pose
    factor_in: float = 1.0
    factor_out: float = 1.0

    def packed(self) -> FacePlacement:
        """Arrays, as the kernels of bodies take them."""
        frames = [pose.frame for pose in (self.into, *self.between, self.back)]
        return FacePlacement(np.stack(frames), self.factor_in, self.factor_out)


FACES_IN_PLACE = FacePoses(IN_PLACE, (), IN_PLACE)


def _vector(values: Any) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _about(axis: int, angle_deg: float) -> _Matrix:
    cosine = cos(radians(angle_deg))
    sine = sin(radians(angle_deg))
    if angle_deg % 90.0 == 0.0:
        cosine = round(cosine)
        sine = round(sine)
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    rotation = np.eye(3)
    rotation[first, first] = rotation[second, second] = cosine
    rotation[second, first] = sine
    rotation[first, second] = -sine
    return rotation


def _shortest(z: Float[np.ndarray, " 3"]) -> _Matrix:
    """The shortest rotation that takes +z to the unit vector ``z`` (Rodrigues)."""
    if z[2] <= _STRAIGHT_BACK:
        return np.diag([-1.0, 1.0, -1.0])
    cross = np.array([[0.0, 0.0, z[0]], [0.0, 0.0, z[1]], [-z[0], -z[1], 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + z[2])
