"""Rays through the exact surfaces, quickly: the table says where to begin, a Newton step ends on the surface itself.

It takes nothing from the fused kernels: the search runs on the table by plain NumPy, refraction is that of
:mod:`lensforge.optics`.
"""

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from lensforge.lens import Lens
from lensforge.optics.dielectric import fresnel_transmittance, refract, transmitted_cosine_squared
from lensforge.sources.bundle import RayBundle
from lensforge.surfaces.spline import TableGrid, evaluate_table
from lensforge.surfaces.surface import Surface
from lensforge.tracing.exit_rays import ExitRays
from lensforge.tracing.fates import Fate

_SCAN_STEPS, _BISECTIONS = 48, 30
_PROBE = 1e-6  # of the path length: the central difference that gives the table's slope along a ray
_LONGEST_STEP = 1e-3  # of the distance from the origin


def trace_exact_sum(
    lens: Lens,
    grid: TableGrid,
    tables: dict[str, Float[np.ndarray, "side side"]],
    rays: RayBundle,
    steps: int = 1,
) -> ExitRays:
    """Trace ``rays`` through the exact surfaces; ``tables`` of both, by name, bracket the first crossings.

    ``steps`` from there: one where the table is some nm off, more where it is far.
    """
    origins, directions, flux = rays.origins.copy(), rays.directions.copy(), rays.weights.copy()
    fates = np.where(directions[:, 2] > 0.0, Fate.OUTSIDE_CAVITY, Fate.BACKWARD).astype(np.int8)
    sin2_exit = np.zeros(len(rays))
    alive = _enter(grid, tables["inner"], origins, directions)
    own = rays.refractive_indices
    index = np.full(len(rays), lens.refractive_index) if own is None else own
    for name, ratios in (("inner", 1.0 / index), ("outer", index)):
        surface: Surface = getattr(lens, name)
        lengths, found = _search(grid, tables[name], origins[alive], directions[alive])
        fates[alive] = Fate.BASE
        alive, lengths = alive[found], lengths[found]
        for _ in range(steps):
            lengths = _polish(surface, grid, tables[name], origins[alive], directions[alive], lengths)
        points = origins[alive] + lengths[:, None] * directions[alive]
        normals = surface.normal(points / np.linalg.norm(points, axis=1, keepdims=True))
        cosine = np.sum(directions[alive] * normals, axis=1)
        ratio = torch.from_numpy(ratios[alive])
        behind_squared = transmitted_cosine_squared(torch.from_numpy(cosine), ratio).numpy()
        above = points[:, 2] >= 0.0
        fates[alive[above]] = Fate.TOTAL_REFLECTION
        if name == "outer":
            sin2_exit[alive[above]] = 1.0 - behind_squared[above]
        passes = (behind_squared > 0.0) & (cosine > 0.0) & above
        alive, points, normals, cosine = alive[passes], points[passes], normals[passes], cosine[passes]
        ratio = ratio[torch.from_numpy(passes)]
        origins[alive] = points
        directions[alive] = refract(torch.from_numpy(directions[alive]), torch.from_numpy(normals), ratio).numpy()
        flux[alive] *= fresnel_transmittance(torch.from_numpy(cosine), ratio).numpy()
    fates[alive] = Fate.LEFT_LENS
    left = (fates == Fate.LEFT_LENS)[:, None]
    exits = (np.where(left, origins, 0.0), np.where(left, directions, 0.0), flux, sin2_exit, fates)
    return ExitRays(*(torch.from_numpy(array) for array in exits))


def _enter(
    grid: TableGrid,
    table: Float[np.ndarray, "side side"],
    origins: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
) -> Int[np.ndarray, " k"]:
    """Rays that come to be inside the cavity; those from below z = 0 are moved to its opening, in ``origins``."""
    rows = np.flatnonzero(directions[:, 2] > 0.0)
    with np.errstate(over="ignore", invalid="ignore"):  # far below, nearly level: it enters nowhere
        points = origins[rows] + np.maximum(-origins[rows, 2:] / directions[rows, 2:], 0.0) * directions[rows]
        points[:, 2] = np.maximum(points[:, 2], 0.0)
        near = np.linalg.norm(points, axis=1) < 2.0 * table.max()
    rows, points = rows[near], points[near]
    origins[rows] = points
    entered: Int[np.ndarray, " k"] = rows[_inside(grid, table, points)]
    return entered


def _inside(
    grid: TableGrid, table: Float[np.ndarray, "side side"], points: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether the points are nearer to the origin than the table's surface."""
    distance = np.linalg.norm(points, axis=1)
    rising = np.array(points)
    rising[distance == 0.0] = [0.0, 0.0, 1.0]
    rising[:, 2] = np.maximum(rising[:, 2], -0.2 * distance)  # the chart's table ends a little below the horizon
    inside: Bool[np.ndarray, " n"] = evaluate_table(grid, table, rising) > distance
    return inside


def _search(
    grid: TableGrid,
    table: Float[np.ndarray, "side side"],
    origins: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Path length to the first crossing of the table above z = 0, and whether there is one."""

    def inside(lengths: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        return _inside(grid, table, origins + lengths[:, None] * directions)

    reach = 2.5 * float(table.max())
    low, high = np.zeros(len(origins)), np.full(len(origins), reach)
    found = np.zeros(len(origins), dtype=bool)
    for step in range(1, _SCAN_STEPS + 1):
        here = np.full(len(origins), reach * step / _SCAN_STEPS)
        outside = ~inside(here)
        high = np.where(outside & ~found, here, high)
        found |= outside
        low = np.where(found, low, here)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        before = inside(middle)
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return 0.5 * (low + high), found


def _polish(
    surface: Surface,
    grid: TableGrid,
    table: Float[np.ndarray, "side side"],
    origins: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    lengths: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Path lengths to the exact surface from those to its table.

    The step is the table's error, some nm, and its slope that of the table: what is left is a product of two errors.
    """

    def split(at: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
        points = origins + at[:, None] * directions
        distance = np.linalg.norm(points, axis=1)
        return points / distance[:, None], distance

    u, distance = split(lengths)
    probe = _PROBE * distance
    (ahead, far), (behind, near) = split(lengths + probe), split(lengths - probe)
    rise = evaluate_table(grid, table, ahead) - evaluate_table(grid, table, behind) - (far - near)
    gap = surface.radius(u) - distance
    leaving = 2.0 * probe * np.abs(gap) < -rise * _LONGEST_STEP * distance  # not where the ray is tangent
    return lengths - np.where(leaving, gap * 2.0 * probe / np.where(leaving, rise, 1.0), 0.0)
