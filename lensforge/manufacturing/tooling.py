"""Every tool of the spec on both faces."""

import numpy as np
from jaxtyping import Float

from lensforge.manufacturing.cut import ToolReach, ToolResult
from lensforge.manufacturing.cutter import largest_ball_mm, reachable
from lensforge.manufacturing.face import AirSide
from lensforge.manufacturing.face_check import FaceCheck, bounded
from lensforge.manufacturing.own_base import OwnBase
from lensforge.manufacturing.sampling import sample_face
from lensforge.manufacturing.tool import tool_reach
from lensforge.spec import BaseSection, Tool

_CONTACT_NODES, _OBSTACLE_NODES = 41, 61
_RINGS = 9
_AWAY = {AirSide.OUTSIDE: np.array([0.0, 0.0, 1.0]), AirSide.INSIDE: np.array([0.0, 0.0, -1.0])}


def check_tools(
    tools: tuple[Tool, ...],
    inner: FaceCheck,
    outer: FaceCheck,
    base: BaseSection | None,
    own: OwnBase | None,
    max_tilt_rad: float,
) -> tuple[ToolResult, ...]:
    """Each tool with what it reaches of each face.

    ``base`` is None where it is not in the way: a mould insert; ``own`` is the base from a STEP file.
    """
    if not tools:
        return ()
    reaches = [_reaches(tools, face, _obstacles(face, base, own), max_tilt_rad) for face in (inner, outer)]
    return tuple(
        ToolResult(
            name=tool.name,
            radius_mm=tool.radius_mm,
            shank_radius_mm=tool.shank_radius_mm,
            length_mm=tool.length_mm,
            holder_half_angle_deg=tool.holder_half_angle_deg,
            inner=of_inner,
            outer=of_outer,
        )
        for tool, of_inner, of_outer in zip(tools, *reaches, strict=True)
    )


def _reaches(
    tools: tuple[Tool, ...], face: FaceCheck, obstacles: Float[np.ndarray, "m 3"], max_tilt_rad: float
) -> list[ToolReach]:
    """What each tool reaches of one face."""
    contacts = sample_face(face.samples.face, _CONTACT_NODES)
    ball, away = largest_ball_mm(contacts, face.samples.points), _AWAY[face.samples.face.air]
    found = []
    for tool in tools:
        reached = tool_reach(contacts, reachable(ball, tool.radius_mm), tool, away, max_tilt_rad, obstacles)
        found.append(
            ToolReach(
                ball_reachable_fraction=reached.ball,
                reachable_fraction_untilted=reached.untilted,
                reachable_fraction=reached.tilted,
                largest_radius_mm=bounded(face.largest_cutter_mm),
            )
        )
    return found


def _obstacles(face: FaceCheck, base: BaseSection | None, own: OwnBase | None) -> Float[np.ndarray, "m 3"]:
    """Points of the face itself, and of the base near it: the bore below the cavity, the top around the dome."""
    on_face = sample_face(face.samples.face, _OBSTACLE_NODES).points
    if base is None or base.kind == "none":
        return on_face
    if own is not None:
        return np.concatenate([on_face, own.points()])
    turn = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    rim = face.samples.face.radius(circle)
    rings = []
    for part in np.linspace(0.0, 1.0, _RINGS):
        if face.name == "inner":
            radius, depth = rim, part * base.height_mm
        else:
            radius, depth = rim + part * np.maximum(base.widest_mm / 2.0 - rim, 0.0), base.relief_step_mm
        rings.append(np.column_stack([radius[:, None] * circle, np.full(len(turn), -depth)]))
    return np.concatenate([on_face, *rings])
