"""Receivers of a spec, as those that rays land on."""

from collections.abc import Sequence
from dataclasses import replace

from lensforge.errors import InputError
from lensforge.receivers.cylinder import Cylinder
from lensforge.receivers.far_field import FarField, chart_radius
from lensforge.receivers.pixels import PixelGrid, Window
from lensforge.receivers.plane import Plane
from lensforge.receivers.pose import ReceiverPose
from lensforge.receivers.posed import PosedReceiver
from lensforge.receivers.sphere import Dome
from lensforge.spec import AnyReceiver, Spec
from lensforge.spec.receivers import CylinderReceiver, FarFieldReceiver, PlaneReceiver, SphereReceiver


def receivers_of(spec: Spec, pixels: int) -> tuple[PosedReceiver, ...]:
    """The receivers of ``spec``, with ``pixels`` along the longer side of each."""
    built = [build_receiver(section, pixels) for section in spec.all_receivers]
    side = spec.evaluate.window_mm
    if side is not None and spec.target is not None:
        built = [replace(built[0], window=Window(side, side))]
    _require_behind_glass(spec, built)
    return tuple(built)


def _require_behind_glass(spec: Spec, receivers: Sequence[PosedReceiver]) -> None:
    """Refuse receivers that lie in part before the far face of the cover glass: light meets them first."""
    glass = spec.lens.cover_glass
    if glass is None:
        return
    end_mm = glass.distance_mm + glass.thickness_mm
    for receiver in receivers:
        low_mm = float(receiver.corners()[..., 2].min())
        if receiver.kind != "far_field" and low_mm < end_mm:
            raise InputError(
                f"lens.cover_glass ends at z = {end_mm:g} mm, and a receiver reaches down to z = {low_mm:.4g} mm; "
                "put all of it behind the glass"
            )


def build_receiver(section: AnyReceiver, pixels: int) -> PosedReceiver:
    """One receiver; its window is all of it unless the section names one."""
    width, height = section.size
    grid = PixelGrid.of(width / section.pixel_aspect, height, pixels)
    grid = replace(grid, width=width)
    whole = Window(width, height)
    match section:
        case PlaneReceiver():
            pose = ReceiverPose.facing(section.facing, section.centre_mm, section.rotation_deg)
            return Plane(pose, grid, whole if section.window_mm is None else Window(*section.window_mm))
        case FarFieldReceiver():
            pose = ReceiverPose.facing(section.facing, (0.0, 0.0, 0.0), section.rotation_deg)
            return FarField(pose, grid, Window(radius=chart_radius(section.half_angle_deg)))
        case CylinderReceiver():
            pose = ReceiverPose.facing(section.facing, section.centre_mm, section.rotation_deg)
            return Cylinder(pose, grid, whole, radius_mm=section.radius_mm)
        case SphereReceiver():
            pose = ReceiverPose.facing(section.facing, section.centre_mm, section.rotation_deg)
            radius = section.radius_mm * chart_radius(section.half_angle_deg)
            return Dome(pose, grid, Window(radius=radius), radius_mm=section.radius_mm)
