"""Whole tools: the share of each face that a ball end mill reaches with shank and holder clear of the part.

The ball's centre C is one radius from the contact, along the normal. At a distance t from C along the tool's axis the
shank is a cylinder up to ``length_mm``, beyond which the holder's cone widens. The axis may tilt from the lens axis by
up to the machine's largest tilt: one collision-free direction of those tried is enough.

Contacts and obstacles are samples, so a collision that is narrower than their spacing can be missed: the fractions are
for planning; the shop's own simulation decides.
"""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan, base_corners
from lensforge.shop.ball_clearance import CustomBaseMesh
from lensforge.shop.ball_cutter import largest_ball_mm, reachable
from lensforge.shop.check_measures import ToolReach, ToolResult
from lensforge.shop.face_check import MilledFace
from lensforge.shop.face_samples import FaceSamples, all_points, sample_face
from lensforge.spec import Tool

_CLEARANCE = 1e-9  # mm: a shank that touches is clear
_TILT_STEP_RAD = np.deg2rad(15.0)
_AZIMUTHS = 12
_CHUNK = 256
_CONTACT_NODES = 41
_OBSTACLE_NODES = 61
_AROUND = 96  # points around the base
_RINGS = 9  # rings between two of its corners


def tool_reach(
    samples: FaceSamples,
    ball_fits: Bool[np.ndarray, " k"],
    tool: Tool,
    away: Float[np.ndarray, "3"],
    max_tilt_rad: float,
    obstacles: Float[np.ndarray, "m 3"],
) -> ToolReach:
    """Shares of a face that ``tool`` reaches; ``away``: unit vector along the untilted tool, from ball to holder.

    ``ball_fits``: True where the ball alone reaches; ``obstacles``: points of the part, including the face.
    """
    centres = samples.points + tool.radius_mm * samples.normals
    remaining = np.flatnonzero(ball_fits)
    reached = np.zeros(len(centres), dtype=bool)
    shares = []  # by one axis after the other
    for axis in tool_axes(away, max_tilt_rad):
        clear = _is_clear(centres[remaining], axis, tool, obstacles)
        reached[remaining[clear]] = True
        remaining = remaining[~clear]
        shares.append(samples.fraction(reached))
        if not len(remaining):
            break
    return ToolReach(
        ball_reachable_fraction=samples.fraction(ball_fits),
        reachable_fraction_untilted=shares[0],
        reachable_fraction=shares[-1],
    )


def tool_axes(away: Float[np.ndarray, "3"], max_tilt_rad: float) -> Float[np.ndarray, "n 3"]:
    """Unit vectors tilted from ``away`` (+z or -z) by at most the largest tilt, least tilt first."""
    axes = [away]
    tilts = (
        [*np.arange(_TILT_STEP_RAD, max_tilt_rad - 1e-9, _TILT_STEP_RAD), max_tilt_rad] if max_tilt_rad > 0.0 else []
    )
    for tilt in tilts:
        turn = np.arange(_AZIMUTHS) * 2.0 * np.pi / _AZIMUTHS
        around = np.stack([np.cos(turn), np.sin(turn), np.zeros(_AZIMUTHS)], axis=-1)
        axes += list(np.sin(tilt) * around + np.cos(tilt) * away)
    return np.array(axes)


def _is_clear(
    centres: Float[np.ndarray, "k 3"], axis: Float[np.ndarray, "3"], tool: Tool, obstacles: Float[np.ndarray, "m 3"]
) -> Bool[np.ndarray, " k"]:
    """True for a ball centre from which shank and holder, along ``axis``, are clear of every obstacle."""
    slope = float(np.tan(np.deg2rad(tool.holder_half_angle_deg)))
    first, second = _across(axis)
    along = obstacles @ axis
    x = obstacles @ first
    y = obstacles @ second
    clear = np.empty(len(centres), dtype=bool)
    for start in range(0, len(centres), _CHUNK):
        some = centres[start : start + _CHUNK]
        t = along - (some @ axis)[:, None]
        squared = (x - (some @ first)[:, None]) ** 2 + (y - (some @ second)[:, None]) ** 2
        radius = tool.shank_radius_mm + slope * np.maximum(t - tool.length_mm, 0.0) - _CLEARANCE
        clear[start : start + _CHUNK] = ~((t > 0.0) & (squared < radius * radius)).any(axis=1)
    return clear


def _across(axis: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Two unit vectors that complete ``axis`` to an orthonormal frame."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def check_tools(
    tools: tuple[Tool, ...],
    faces: Mapping[str, MilledFace],
    plan: Plan[Patch] | None,
    custom: CustomBaseMesh | None,
    max_tilt_rad: float,
) -> tuple[ToolResult, ...]:
    """Reach of each tool on each face.

    ``plan``: the body with its base, None for a mould insert; ``custom``: the base from a STEP file, None without one.
    """
    if not tools:
        return ()
    reaches = {
        name: _reaches(tools, face, _obstacles(face, plan, custom), max_tilt_rad) for name, face in faces.items()
    }
    return tuple(
        ToolResult(**tool.model_dump(), faces={name: reach[number] for name, reach in reaches.items()})
        for number, tool in enumerate(tools)
    )


def _reaches(
    tools: tuple[Tool, ...], face: MilledFace, obstacles: Float[np.ndarray, "m 3"], max_tilt_rad: float
) -> list[ToolReach]:
    contacts = sample_face(face.samples.face, _CONTACT_NODES)
    ball = largest_ball_mm(contacts, face.samples.points)
    away = face.samples.face.away
    return [
        tool_reach(contacts, reachable(ball, tool.radius_mm), tool, away, max_tilt_rad, obstacles) for tool in tools
    ]


def _obstacles(face: MilledFace, plan: Plan[Patch] | None, custom: CustomBaseMesh | None) -> Float[np.ndarray, "m 3"]:
    on_face = all_points(face.samples.face, _OBSTACLE_NODES)
    if custom is not None:
        return np.concatenate([on_face, custom.points()])
    if plan is None or not plan.has_base:
        return on_face
    return np.concatenate([on_face, points_on_base(plan)])


def points_on_base(plan: Plan[Patch], count: int = _RINGS) -> Float[np.ndarray, "m 3"]:
    """Points on ``count`` rings around each part of the base, from the outer rim to the bore."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    across = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    rings = []
    for corner, following in pairwise(base_corners(plan)):
        start = corner.radius(turn)
        end = following.radius(turn)
        for share in np.linspace(0.0, 1.0, count):
            radius = (1.0 - share) * start + share * end
            depth = (1.0 - share) * corner.depth_mm + share * following.depth_mm
            rings.append(np.column_stack([radius[:, None] * across, np.full(_AROUND, -depth)]))
    return np.concatenate(rings)
