"""Every tool of the spec on both faces: its part of check.json and its verdicts."""

from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from lensforge.manufacturing.cutter import largest_ball_mm, reachable
from lensforge.manufacturing.face import AirSide
from lensforge.manufacturing.face_check import FaceCheck
from lensforge.manufacturing.own_base import OwnBase
from lensforge.manufacturing.sampling import sample_face
from lensforge.manufacturing.tool import tool_reach
from lensforge.manufacturing.verdicts import ShopVerdict
from lensforge.spec import BaseSection, Tool

_CONTACT_NODES, _OBSTACLE_NODES = 41, 61
_RINGS = 9
_AWAY = {AirSide.OUTSIDE: np.array([0.0, 0.0, 1.0]), AirSide.INSIDE: np.array([0.0, 0.0, -1.0])}


def check_tools(
    tools: tuple[Tool, ...],
    faces: tuple[FaceCheck, FaceCheck],
    base: BaseSection | None,
    own: OwnBase | None,
    max_tilt_rad: float,
) -> list[dict[str, Any]]:
    """Each tool with what it reaches of each face.

    ``base`` is None where it is not in the way: a mould insert; ``own`` is the base from a STEP file.
    """
    content: list[dict[str, Any]] = [tool.model_dump(mode="json") for tool in tools]
    for face in faces if tools else ():
        contacts = sample_face(face.samples.face, _CONTACT_NODES)
        ball = largest_ball_mm(contacts, face.samples.points)
        obstacles = _obstacles(face, base, own)
        largest = face.largest_cutter_mm
        for tool, entry in zip(tools, content, strict=True):
            away = _AWAY[face.samples.face.air]
            fits = reachable(ball, tool.radius_mm)
            reach = tool_reach(contacts, fits, tool, away, max_tilt_rad, obstacles)
            entry[face.name] = {
                "ball_reachable_fraction": reach.ball,
                "reachable_fraction_untilted": reach.untilted,
                "reachable_fraction": reach.tilted,
                "largest_radius_mm": largest if np.isfinite(largest) else None,
            }
    return content


def tool_verdicts(entries: list[dict[str, Any]]) -> list[ShopVerdict]:
    """Whether each tool cuts all of each face, and what stops it."""
    verdicts = []
    for entry in entries:
        names: tuple[Literal["inner", "outer"], ...] = ("inner", "outer")
        for name in names:
            reach = entry[name]
            ball, whole = reach["ball_reachable_fraction"], reach["reachable_fraction"]
            reason = f"{entry['name']} reaches {100.0 * whole:.1f} % of the {name} face"
            if whole < ball - 1e-9:
                reason += f"; its ball alone {100.0 * ball:.1f} %: shank or holder is in the way, a longer one may do"
            if ball < 1.0 - 1e-9:
                reason += f"; the largest ball that reaches all of it is {reach['largest_radius_mm']:.4g} mm"
            verdicts.append(ShopVerdict(name="tool", surface=name, holds=whole >= 1.0 - 1e-9, reason=reason))
    return verdicts


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
