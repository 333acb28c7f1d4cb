"""The first crossing, against a dense scan that shares no code with the kernels."""

import numpy as np
import pytest
from hard_rays import all_hits, gap, hard_rays
from nightly import first_by_day
from scenes import random_surface

from lensforge.kernels.bicubic import surface_bounds
from lensforge.surfaces.bicubic_table import TableGrid, evaluate_table, tabulate

SCAN = 1500


def _wrong(seed: int, roughness: float, count: int) -> tuple[int, int]:
    """(rays on which the kernel is late, lost, or not on the surface; rays with more than one crossing)."""
    surface = random_surface(seed, 2.0, roughness, levels=(25, 81, 289))
    grid = TableGrid(100)
    table = tabulate(grid, surface)
    starts, directions = hard_rays(table, grid, count, seed)
    bounds = surface_bounds(table, grid.origin, grid.step)
    lengths, crossed, lost = all_hits(starts, directions, table, grid)

    # quadratically denser near the start, where tangent rays cross
    t = 2.2 * bounds.most * np.linspace(0, 1, SCAN) ** 2
    first = np.full(count, np.inf)
    several = 0
    for part in np.array_split(np.arange(count), max(1, count // 1000)):
        points = starts[part, None] + t[None, :, None] * directions[part, None]
        above = points[..., 2] >= 0.0
        inside = gap(np.where(above[..., None], points, [0.0, 0.0, 1e-3]), table, grid) > 0.0
        crossing = inside[:, :-1] & ~inside[:, 1:] & above[:, 1:]
        hit = crossing.any(axis=1)
        several += int((crossing.sum(axis=1) > 1).sum())
        first[part[hit]] = t[1:][crossing[hit].argmax(axis=1)]
        below = (~above).argmax(axis=1)  # a ray that has left through z = 0 meets nothing afterwards
        gone = (~above).any(axis=1) & (t[below] <= first[part])
        first[part[gone]] = np.inf

    ends = starts + np.where(crossed, lengths, 0.0)[:, None] * directions
    late = crossed & (lengths > first + 1e-9)
    missed = ~crossed & np.isfinite(first)
    astray = crossed & (np.abs(gap(np.where(crossed[:, None], ends, 1.0), table, grid)) > 1e-9)
    return int((late | missed | astray | lost).sum()), several


@pytest.mark.parametrize(("seed", "roughness"), first_by_day(1, [(1, 0.01), (2, 0.03), (3, 0.06)], "a second each"))
def test_no_hard_ray_is_wrong(seed: int, roughness: float) -> None:
    wrong, several = _wrong(seed, roughness, 4000)
    assert several > 20, "the surface should be wavy enough for rays that cross it more than once"
    assert wrong == 0


def test_bounds_hold_as_far_as_they_reach() -> None:
    """Least radius, gradient and Hessian of the exact sum, near directions of the hemisphere, against their tiles."""
    surface = random_surface(5, 2.0, 0.03, levels=(25, 81))
    grid = TableGrid(80)
    bounds = surface_bounds(tabulate(grid, surface), grid.origin, grid.step)
    rng = np.random.default_rng(0)
    centre = rng.normal(size=(40_000, 3))
    centre[:, 2] = np.abs(centre[:, 2])
    centre /= np.linalg.norm(centre, axis=1, keepdims=True)
    aside = np.cross(centre, rng.normal(size=centre.shape))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    u = centre + rng.random((len(centre), 1)) * bounds.tan_reach * aside
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    above = u[:, 2] >= 0.0
    centre = centre[above]
    u = u[above]
    chart = centre[:, :2] / (1.0 + centre[:, 2:])
    least, slope, bend = bounds.tiles[tuple(((chart - grid.origin) * bounds.per_unit).astype(int).T)].T

    rho = surface.radius(u)
    gradient = np.linalg.norm(surface.gradient(u), axis=1)
    assert bounds.least <= rho.min() and rho.max() <= bounds.most
    assert np.all(least <= rho) and np.all(gradient <= slope)
    along = np.cross(u, rng.normal(size=u.shape))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    e = 1e-3
    ahead, behind = (surface.radius(np.cos(e) * u + s * np.sin(e) * along) for s in (1, -1))
    second = np.abs((ahead - 2.0 * rho + behind) / e**2)
    assert np.all(second <= bend)
    # and are not so wide that they would be true of anything
    assert np.median(slope / gradient) < 4.0 and slope.max() < 3.0 * gradient.max() and bend.max() < 5.0 * second.max()


@pytest.mark.parametrize("seed", range(4))
def test_bounds_see_every_coefficient_that_acts_within_their_reach(seed: int) -> None:
    """Lone dents one node wide, of which a tile sees none but by the coefficients at the very end of its reach."""
    grid = TableGrid(80)
    rng = np.random.default_rng(seed)
    table = np.where(rng.random((grid.side, grid.side)) < 3e-3, 1.0, 2.0)
    bounds = surface_bounds(table, grid.origin, grid.step)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, 200_000)
    height = rng.uniform(0.0, 0.3, 200_000)
    sine = np.sqrt(1.0 - height**2)
    centre = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), height], axis=1)
    aside = np.cross(centre, rng.normal(size=centre.shape))
    u = centre + bounds.tan_reach * aside / np.linalg.norm(aside, axis=1, keepdims=True)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    centre = centre[u[:, 2] >= 0.0]
    u = u[u[:, 2] >= 0.0]
    tile = ((centre[:, :2] / (1.0 + centre[:, 2:]) - grid.origin) * bounds.per_unit).astype(int)
    least = bounds.tiles[tile[:, 0], tile[:, 1], 0]
    rho = evaluate_table(grid, table, u)
    assert (least <= rho + 1e-12).all()
    assert (rho < 1.9).any() and (least == 2.0).mean() > 0.1, "there are dents, and tiles without"
