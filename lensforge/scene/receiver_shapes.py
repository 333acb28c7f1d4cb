"""Receivers of a spec, as those that rays land on: a plane, a cylinder, a dome, and the far field.

Cylinders are unrolled; the dome and the far field are on charts that keep areas, so that pixels of the far field are
candela.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import ceil, floor
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError
from lensforge.kernels.landing import (
    LEAST_RISE,
    POLE,
    cylinder,
    cylinder_adjoint,
    far_field,
    far_field_adjoint,
    plane,
    plane_adjoint,
    sphere,
    sphere_adjoint,
)
from lensforge.optics.arrays import Array, lengths, module_of
from lensforge.optics.pose import Pose
from lensforge.scene.housing import Housing
from lensforge.scene.housing_room import require_room
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver import Kernel, PosedReceiver, equal_area, from_equal_area, posed_receiver
from lensforge.spec import ReceiverSection, Spec
from lensforge.spec.housing_sections import bodies_of
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.receiver_fields import OF_RECEIVER
from lensforge.spec.receiver_sections import CylinderReceiver, FarFieldReceiver, PlaneReceiver, SphereReceiver
from lensforge.surfaces.placed_bodies import depths

WHOLE = 1e-6  # pixels: two moves that differ by whole pixels to so much are alike


@dataclass(frozen=True)
class Plane(PosedReceiver):
    """A rectangle in the plane of the pose's x and y axes (mm), about its centre."""

    is_flat: ClassVar[bool] = True
    has_quarter_turn: ClassVar[bool] = True
    kernels: ClassVar[tuple[Kernel, Kernel] | None] = (plane, plane_adjoint)

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        return directions[:, 2] > LEAST_RISE

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        reached = points - (points[:, 2] / directions[:, 2])[:, None] * directions
        return reached[:, :2]

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        return np.stack([x, y, np.zeros_like(x)], axis=-1)


@dataclass(frozen=True)
class Cylinder(PosedReceiver):
    """The cylinder of ``radius_mm`` about the pose's y axis: arc length from its z axis, and height (mm)."""

    radius_mm: float = field(kw_only=True)  # type: ignore[misc]  # of planes it has no meaning

    kernels: ClassVar[tuple[Kernel, Kernel] | None] = (cylinder, cylinder_adjoint)

    def _paths(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, " n"]:
        flat = points[:, ::2]
        across = directions[:, ::2]
        square = (across**2).sum(1)
        half = (flat * across).sum(1)
        root = half**2 - square * ((flat**2).sum(1) - self.radius_mm**2)
        return (_root(root) - half) / module_of(square).where(square > 0.0, square, 1.0)

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        return (lengths(directions[:, ::2]) > LEAST_RISE) & (self._paths(points, directions) > 0.0)

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        ends = points + self._paths(points, directions)[:, None] * directions
        xp = module_of(ends)
        return xp.stack([self.radius_mm * xp.arctan2(ends[:, 0], ends[:, 2]), ends[:, 1]], 1)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        angle = x / self.radius_mm
        return np.stack([self.radius_mm * np.sin(angle), y, self.radius_mm * np.cos(angle)], axis=-1)


@dataclass(frozen=True)
class SphericalReceiver(PosedReceiver):
    """The sphere of ``radius_mm`` about the pose's centre, charted (mm) about its z axis; the lens is inside."""

    radius_mm: float = field(kw_only=True)  # type: ignore[misc]  # of planes it has no meaning

    has_quarter_turn: ClassVar[bool] = True
    kernels: ClassVar[tuple[Kernel, Kernel] | None] = (sphere, sphere_adjoint)

    def _paths(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, " n"]:
        half = (points * directions).sum(1)
        return _root(half**2 - (points**2).sum(1) + self.radius_mm**2) - half

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        paths = self._paths(points, directions)
        return (paths > 0.0) & (1.0 + (points[:, 2] + paths * directions[:, 2]) / self.radius_mm > POLE)

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        ends = points + self._paths(points, directions)[:, None] * directions
        return self.radius_mm * equal_area(ends / self.radius_mm)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        return self.radius_mm * from_equal_area(x / self.radius_mm, y / self.radius_mm)


@dataclass(frozen=True)
class FarField(PosedReceiver):
    """Directions about the pose's z axis, on Lambert's azimuthal equal-area chart: at a radius of 2 sin(gamma / 2).

    Where a ray starts does not count: the lens is a point, seen from far away.
    """

    is_far: ClassVar[bool] = True
    has_quarter_turn: ClassVar[bool] = True
    kernels: ClassVar[tuple[Kernel, Kernel] | None] = (far_field, far_field_adjoint)

    @property
    def pixel_measure(self) -> float:
        """Solid angle of a pixel in sr, so that flux (W) over it is intensity (W/sr); of lamps for the flux of one."""
        width, height = self.grid.pixel
        return width * height / len(self.lamps)

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        return 1.0 + directions[:, 2] > POLE

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        return equal_area(directions)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        return from_equal_area(x, y)

    def target_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Degrees from the axis along x and y: gamma times the cosine and the sine of the azimuth."""
        radius = np.hypot(x, y)
        scale = np.degrees(2.0 * np.arcsin(np.minimum(0.5 * radius, 1.0))) / np.where(radius > 0.0, radius, np.inf)
        return scale * x, scale * y

    def chart_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Chart of degrees from the axis along x and y."""
        gamma = np.hypot(x, y)
        scale = 2.0 * np.sin(0.5 * np.radians(gamma)) / np.where(gamma > 0.0, gamma, np.inf)
        return scale * x, scale * y


def _root(square: Float[Array, " n"]) -> Float[Array, " n"]:
    """Root of ``square``; 0 where rounding takes it below 0."""
    xp = module_of(square)
    return xp.sqrt(xp.where(square > 0.0, square, 0.0))


def chart_radius(gamma_deg: float) -> float:
    """Radius on the chart of the directions at an angle from the axis."""
    return 2.0 * float(np.sin(0.5 * np.radians(gamma_deg)))


def receivers_of(spec: Spec, pixels: int) -> tuple[PosedReceiver, ...]:
    """The receivers of ``spec``, with ``pixels`` along the longer side of each."""
    built = [
        replace(receiver, housing=Housing.of(bodies_of(spec.scene, from_afar=receiver.is_far), spec.scene_events))
        for receiver in (build_receiver(section, pixels) for section in spec.all_receivers)
    ]
    if not spec.all_lamps.is_single:
        built = [with_all_lamps(receiver, spec.all_lamps) for receiver in built]
    side = spec.evaluate.window_mm
    if side is not None and spec.target is not None:
        built = [replace(built[0], window=Window(side, side))]
    _require_behind_glass(spec, built)
    _require_outside_bodies(spec, built)
    require_room(spec)
    return tuple(built)


def seen_by_lamp(spec: Spec, number: int) -> Spec:
    """The spec of one of its lamps at the origin, with receivers and scene where that lamp sees them.

    Without limits on bodies and eyes, which are of all lamps, and stand where those do.
    """
    lamp = spec.all_lamps.lamps[number].pose
    sections = tuple(_alone(section).posed(section.pose.seen_from(lamp)) for section in spec.all_receivers)
    scene = tuple(body.posed(body.pose.seen_from(lamp)) for body in spec.scene)
    limits = tuple(limit for limit in spec.limits if limit.of_receiver)
    return spec.of_one_lamp.changed(target=None, receivers=sections, scene=scene, limits=limits)


def _alone(section: ReceiverSection) -> ReceiverSection:
    targets = tuple(target.changed(**dict.fromkeys(OF_RECEIVER)) for target in section.targets)
    return section.changed(targets=targets)


# Pixels over those asked for: in this range lamps may lie alike on the pixels.
_FEWER = 0.75
_MORE = 1.3


def with_all_lamps(receiver: PosedReceiver, lamps: Lamps) -> PosedReceiver:
    """The receiver in the light of ``lamps``.

    A plane has pixels so many, near those asked for, that as many of the lamps as can be lie alike on them: their light
    is then one picture, moved by whole pixels.
    """
    grid = receiver.grid
    if receiver.is_flat and lamps.period_mm is None and not lamps.posed and receiver.housing is None:
        moves = np.array(lamps.places_mm) @ receiver.pose.rotation[:2, :2]
        columns = _alike(grid.columns, moves[:, 0] / grid.width)
        rows = _alike(grid.rows, moves[:, 1] / grid.height)
        grid = replace(grid, columns=columns, rows=rows)
    at_one_place = receiver.is_far and receiver.housing is None
    return replace(receiver, grid=grid, lamps=lamps.in_far_field if at_one_place else lamps)


def _alike(asked: int, moves: Float[np.ndarray, " n"]) -> int:
    """The count of pixels by which ``moves``, in receivers, have the fewest parts of a pixel; or that asked for."""

    def parts(count: int) -> int:
        return len(np.unique(np.round(moves * count % 1.0 / WHOLE) % round(1.0 / WHOLE)))

    counts = range(ceil(_FEWER * asked), floor(_MORE * asked) + 1)
    best = min(counts, key=lambda count: (parts(count), abs(count - asked)), default=asked)
    return best if parts(best) < parts(asked) else asked


def _require_behind_glass(spec: Spec, receivers: Sequence[PosedReceiver]) -> None:
    """Refuse receivers that lie in part before the far face of the cover glass: light meets them first."""
    glass = spec.lens.cover_glass
    if glass is None:
        return
    end_mm = glass.distance_mm + glass.thickness_mm
    for receiver in receivers:
        low_mm = float(receiver.corners()[..., 2].min())
        if not receiver.is_far and low_mm < end_mm:
            raise InputError(
                f"lens.cover_glass ends at z = {end_mm:g} mm, and a receiver reaches down to z = {low_mm:.4g} mm; "
                "put all of it behind the glass"
            )


def _require_outside_bodies(spec: Spec, receivers: Sequence[PosedReceiver]) -> None:
    """Refuse receivers that lie in part within a body of a lamp: light meets them first."""
    near = [receiver.corners().reshape(-1, 3) for receiver in receivers if not receiver.is_far]
    for body, corners, lamp in product(spec.media.bodies, near, spec.all_lamps.lamps):
        depth = depths(body, lamp.pose.to_local_points(corners), inner=False)
        inside = np.isfinite(depth) & (depth > 0.0)
        if inside.any():
            x, y, z = corners[int(np.argmax(inside))]
            raise InputError(
                f"body {body.name!r}: a receiver lies within it, at ({x:.4g}, {y:.4g}, {z:.4g}) mm; put all of it "
                "outside of the last body"
            )


def build_receiver(section: ReceiverSection, pixels: int) -> PosedReceiver:
    """One receiver; its window is all of it unless the section names one."""
    return posed_receiver(section, section.pose, PixelGrid.of(*section.size, pixels))


posed_receiver.register(
    PlaneReceiver, lambda section, pose, grid: Plane(pose, grid, Window(*(section.window_mm or section.size)))
)
posed_receiver.register(
    CylinderReceiver,
    lambda section, pose, grid: Cylinder(pose, grid, Window(*section.size), radius_mm=section.radius_mm),
)


@posed_receiver.register
def _(section: FarFieldReceiver, pose: Pose, grid: PixelGrid) -> PosedReceiver:
    return FarField(pose, grid, Window(radius=chart_radius(section.half_angle_deg)))


@posed_receiver.register
def _(section: SphereReceiver, pose: Pose, grid: PixelGrid) -> PosedReceiver:
    radius = section.radius_mm * chart_radius(section.half_angle_deg)
    return SphericalReceiver(pose, grid, Window(radius=radius), radius_mm=section.radius_mm)
