"""Shares of a luminaire's flux by which rooms are planned: its flux code, and the direct ratios of EULUMDAT.

The flux code counts cones about the axis, of solid angles pi/2, pi and 3 pi/2 (EN 13032-2, CIE 52:1982). A direct ratio
is the share that falls straight on the working plane of a room whose luminaires cover the ceiling evenly: light that
goes by (x, y) across a square room of side a gets there from the part (1 - |x|/a) (1 - |y|/a) of the ceiling.
"""

import numpy as np
from jaxtyping import Float

from lensforge.sources.photometric.candela_table import CandelaTable, flux_up_to

ROOM_INDICES = (0.60, 0.80, 1.00, 1.25, 1.50, 2.00, 2.50, 3.00, 4.00, 5.00)  # of EULUMDAT: side over twice the height
_CONE_COSINES = (0.75, 0.5, 0.25, 0.0)
# Steps in which a table is refined; within them the direction of all light is that of the middle.
_C_STEP_DEG = 2.5
_GAMMA_STEP_DEG = 0.5


def flux_code(table: CandelaTable) -> tuple[float, ...]:
    """N1 to N4 of the flux code: shares of the downward flux in three cones, then of all flux downwards; 0 if dark.

    N5 is the light output ratio, which a table of intensities does not contain.
    """
    *cones, down = (table.share_up_to(np.degrees(np.arccos(cosine))) for cosine in _CONE_COSINES)
    return (*(cone / down if down > 0.0 else 0.0 for cone in cones), down)


def direct_ratios(table: CandelaTable) -> tuple[float, ...]:
    """Share of all flux that falls directly on the working plane, for each of the ten room indices."""
    c_deg = _refined(np.append(table.c_deg, 360.0), 360.0, _C_STEP_DEG)
    gamma_deg = _refined(table.gamma_deg, min(90.0, table.gamma_deg[-1]), _GAMMA_STEP_DEG)
    values = np.stack([np.interp(gamma_deg, table.gamma_deg, table.at(turn)) for turn in c_deg])
    of_planes = np.diff(flux_up_to(np.radians(gamma_deg), values), axis=1)
    flux = 0.5 * (of_planes[1:] + of_planes[:-1]) * np.radians(np.diff(c_deg))[:, None]
    turn = np.radians(0.5 * (c_deg[1:] + c_deg[:-1]))[:, None]
    away = np.tan(np.radians(0.5 * (gamma_deg[1:] + gamma_deg[:-1])))
    x, y = np.abs(np.cos(turn)) * away, np.abs(np.sin(turn)) * away
    sides = 2.0 * np.array(ROOM_INDICES)
    landing = (float((flux * np.maximum(1.0 - x / a, 0.0) * np.maximum(1.0 - y / a, 0.0)).sum()) for a in sides)
    return tuple(share / table.flux() for share in landing)


def _refined(nodes: Float[np.ndarray, " n"], end: float, step: float) -> Float[np.ndarray, " k"]:
    """``nodes`` up to ``end`` and steps between them, from the first of them."""
    steps = np.arange(nodes[0], end, step)
    return np.unique(np.concatenate([nodes[nodes <= end], steps, [end] if nodes[0] < end else []]))
