"""A whole tool against the part: which points a ball mill reaches without its shank or its holder in the part.

The ball's centre C is over the contact by its radius. Around the tool's axis, at a distance t beyond C, the shank is a
cylinder up to ``length_mm``, from where the holder's cone widens. The axis may lean from the lens axis by the machine's
largest tilt: of a fan of directions, one that is clear is enough.

Contacts and obstacles are samples, so a clash that is narrower than their spacing can be missed: the fractions are
for planning, the shop's own simulation decides.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.manufacturing.sampling import FaceSamples
from lensforge.spec import Tool

_CLEARANCE = 1e-9  # mm: a shank that touches is clear
_TILT_STEP_RAD = np.deg2rad(15.0)
_TURNS = 12
_CHUNK = 256


@dataclass(frozen=True)
class Reached:
    """Parts of a face's area: reached by the ball alone, by the untilted tool, by the tool with its best tilt."""

    ball: float
    untilted: float
    tilted: float


def tool_reach(
    samples: FaceSamples,
    ball_fits: Bool[np.ndarray, " k"],
    tool: Tool,
    away: Float[np.ndarray, "3"],
    max_tilt_rad: float,
    obstacles: Float[np.ndarray, "m 3"],
) -> Reached:
    """What ``tool`` reaches of a face; ``away`` is the direction (unit) in which the untilted tool leaves the part.

    ``ball_fits`` says where its ball alone may touch; ``obstacles`` are points of the part, the face's own among them.
    """
    centres = samples.points + tool.radius_mm * samples.normals
    waiting = np.flatnonzero(ball_fits)
    reached = np.zeros(len(centres), dtype=bool)
    untilted = 0.0
    for number, axis in enumerate(tool_axes(away, max_tilt_rad)):
        clear = _is_clear(centres[waiting], axis, tool, obstacles)
        reached[waiting[clear]] = True
        waiting = waiting[~clear]
        if number == 0:
            untilted = samples.fraction(reached)
        if not len(waiting):
            break
    return Reached(samples.fraction(ball_fits), untilted, samples.fraction(reached))


def tool_axes(away: Float[np.ndarray, "3"], max_tilt_rad: float) -> Float[np.ndarray, "n 3"]:
    """Directions that lean from ``away`` (+z or -z) by no more than the largest tilt, least tilt first."""
    axes = [away]
    tilts = (
        [*np.arange(_TILT_STEP_RAD, max_tilt_rad - 1e-9, _TILT_STEP_RAD), max_tilt_rad] if max_tilt_rad > 0.0 else []
    )
    for tilt in tilts:
        turn = np.arange(_TURNS) * 2.0 * np.pi / _TURNS
        around = np.stack([np.cos(turn), np.sin(turn), np.zeros(_TURNS)], axis=-1)
        axes += list(np.sin(tilt) * around + np.cos(tilt) * away)
    return np.array(axes)


def _is_clear(
    centres: Float[np.ndarray, "k 3"], axis: Float[np.ndarray, "3"], tool: Tool, obstacles: Float[np.ndarray, "m 3"]
) -> Bool[np.ndarray, " k"]:
    """Whether shank and holder, along ``axis`` from each centre, have every obstacle outside."""
    slope = float(np.tan(np.deg2rad(tool.holder_half_angle_deg)))
    first, second = _across(axis)
    along, x, y = obstacles @ axis, obstacles @ first, obstacles @ second
    clear = np.empty(len(centres), dtype=bool)
    for start in range(0, len(centres), _CHUNK):
        some = centres[start : start + _CHUNK]
        t = along - (some @ axis)[:, None]
        squared = (x - (some @ first)[:, None]) ** 2 + (y - (some @ second)[:, None]) ** 2
        radius = tool.shank_radius_mm + slope * np.maximum(t - tool.length_mm, 0.0) - _CLEARANCE
        clear[start : start + _CHUNK] = ~((t > 0.0) & (squared < radius * radius)).any(axis=1)
    return clear


def _across(axis: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Two unit vectors that make a right-angled frame with ``axis``."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)
