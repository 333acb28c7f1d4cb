"""Rays that start high in the cavity and go down: closed forms, three tracers, finite differences, conservation."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from downward_rays import INDEX, downward_rays, through_spheres
from exact_surface import ExactSurface
from hard_rays import all_hits, approach, gap
from landed import on_device, trace_exact, trace_tables
from scenes import random_surface, sphere, table_of

from lensforge.kernels.bicubic import surface_bounds
from lensforge.kernels.fate import Fate
from lensforge.light.reference_hits import ExactFace, TableFace
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.scene.exit_rays import ExitRays
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.surface import Surface


def _by_tracer(tracer: str, surfaces, rays: RayBundle, nodes: int) -> ExitRays:
    grid = TableGrid(nodes)
    tables = [table_of(surface, grid) for surface in surfaces]
    if tracer == "kernels":
        return trace_tables(tables, Scene(Media(Medium(INDEX)), grid), rays)
    if tracer == "device":
        return on_device(tables, Scene(Media(Medium(INDEX)), grid), rays)
    guides = [None if tracer == "exact" else TableFace.of(table, grid) for table in tables]
    faces = [ExactSurface.of(surface).face(guide) for surface, guide in zip(surfaces, guides, strict=True)]
    return trace_exact(*(replace(face, steps=96, bisections=44) for face in faces), Media(Medium(INDEX)), rays)


TRACERS = ["kernels", "device", "exact", "guided by tables"]


@pytest.mark.parametrize("tracer", TRACERS)
def test_concentric_spheres_in_closed_form(tracer: str) -> None:
    """Every fate, exit point, direction and flux, from all over the cavity; a third of the light goes on upwards."""
    radii = (40.0, 70.0)
    rays = downward_rays(4000, 1, 41.0)
    rays.origins[::13, 2] *= -1.0  # some start below the plane
    expected = through_spheres(rays, radii)
    exits = _by_tracer(tracer, [sphere(r) for r in radii], rays, 40)
    assert np.array_equal(exits.fates.numpy(), expected.fates)
    assert set(expected.fates.tolist()) == {Fate.LEFT_LENS, Fate.BACKWARD, Fate.OUTSIDE_CAVITY, Fate.BASE}
    np.testing.assert_allclose(exits.points.numpy(), expected.points, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(exits.directions.numpy(), expected.directions, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(exits.flux.numpy(), expected.flux, rtol=1e-9)
    rises = expected.directions[expected.fates == Fate.LEFT_LENS, 2] > 0.0
    assert 0.1 < rises.mean() < 0.9


@pytest.mark.parametrize("seed", [1, 2])
def test_no_crossing_near_the_rim_is_missed(seed: int) -> None:
    """Rays that come down to the rim of a wavy wall, where the table ends a hair below: against a dense scan."""
    grid = TableGrid(300)
    count = 1500
    rng = np.random.default_rng(seed)
    table = tabulate(grid, random_surface(seed, 2.0, 0.1, levels=(25, 81)))
    azimuth = rng.random(count) * 2.0 * np.pi
    fall = 10.0 ** rng.uniform(-4.0, -0.3, count)
    rim = np.stack([np.cos(azimuth), np.sin(azimuth), fall * rng.uniform(-1.0, 1.0, count)], axis=1)
    starts = np.stack([np.cos(azimuth + 0.4), np.sin(azimuth + 0.4), fall], axis=1)
    starts *= rng.uniform(0.3, 0.95, (count, 1)) * (1.0 + gap(starts, table, grid)[:, None])
    directions = 2.0 * rim - starts
    directions[:, 2] = -np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    bounds = surface_bounds(table, grid.origin, grid.step)
    lengths, hit, lost = all_hits(starts, directions, table, grid)

    end = np.minimum(-starts[:, 2] / directions[:, 2], 2.2 * bounds.most)
    t = end[:, None] * np.linspace(0.0, 1.0, 800)
    points = starts[:, None] + t[..., None] * directions[:, None]
    inside = gap(np.maximum(points, [-np.inf, -np.inf, 0.0]), table, grid) > 0.0
    crossed = inside[:, :-1] & ~inside[:, 1:]
    first = np.where(crossed.any(axis=1), t[np.arange(count), 1 + crossed.argmax(axis=1)], np.inf)
    assert not lost.any()
    assert 200 < hit.sum() < count - 200
    assert not (~hit & np.isfinite(first)).any()
    assert (lengths <= first + 1e-9)[hit].all()
    crossing = TableFace.of(torch.from_numpy(table), grid, bounds).next_crossing(approach(starts, directions))
    above = starts[:, 2] + crossing.paths_mm.numpy() * directions[:, 2] >= 0.0
    assert np.array_equal(crossing.found.numpy() & above, hit)
    assert np.abs(crossing.paths_mm.numpy() - lengths)[hit].max() < 1e-9


class Flared(Surface):
    """A hemisphere of 1 mm that widens steeply below the plane z = 0."""

    detail_rad = 0.5

    def radius(self, directions: np.ndarray) -> np.ndarray:
        return 1.0 + np.clip(-20.0 * directions[:, 2], 0.0, 2.0)

    def gradient(self, directions: np.ndarray) -> np.ndarray:
        return np.zeros_like(directions)


def test_a_scan_ends_at_the_plane() -> None:
    """Across the wall at z = 0.01, a step later below the plane and inside of what is no wall any more."""
    way = np.array([[1.0, 0.0, -0.19]]) / np.hypot(1.0, 0.19)
    start = np.array([[0.0, 0.0, 0.2]])
    face = replace(ExactFace.of(Flared()), steps=8, bisections=50)
    crossing = face.next_crossing(approach(start, way))
    assert crossing.found.tolist() == [True]
    assert np.linalg.norm(start + crossing.paths_mm.numpy() * way) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("tracer", TRACERS)
@pytest.mark.parametrize(
    ("origin", "direction", "fate"),
    [
        ([0.0, 0.0, 0.3], [0.0, 0.0, -1.0], Fate.BACKWARD),  # down the axis, out of the opening
        ([0.0, 0.0, 0.3], [1.0, 0.0, 0.0], Fate.LEFT_LENS),  # level
        ([0.0, 0.0, 0.3], [1.0, 0.0, -0.2], Fate.LEFT_LENS),  # down to the wall above z = 0
        ([0.0, 0.0, 0.3], [1.0, 0.0, -0.5], Fate.BACKWARD),  # through z = 0 before the wall
        ([0.7, 0.0, 0.05], [0.0, 1.0, -0.1], Fate.BASE),  # through the wall, then down to z = 0 in the body
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], Fate.BACKWARD),  # level in the plane itself
        ([0.0, 0.0, -0.1], [1.0, 0.0, 0.0], Fate.BACKWARD),
        ([0.0, 0.0, 0.81], [1.0, 0.0, -1.0], Fate.OUTSIDE_CAVITY),  # just beyond the wall
        ([0.0, 0.0, 3.0], [0.0, 0.0, -1.0], Fate.OUTSIDE_CAVITY),  # above the lens, down onto it
        ([1.5, 0.0, 0.1], [-1.0, 0.0, -0.01], Fate.OUTSIDE_CAVITY),  # in the body
        ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], Fate.LEFT_LENS),
        ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], Fate.LEFT_LENS),  # from below, through the opening
        ([1.5, 0.0, 0.0], [0.0, 0.0, 1.0], Fate.OUTSIDE_CAVITY),
        ([2.0, 0.0, -0.1], [-0.1, 0.0, 1.0], Fate.OUTSIDE_CAVITY),  # from below, beside it
        ([0.0, 0.0, 3.0], [0.0, 0.0, 1.0], Fate.OUTSIDE_CAVITY),
        ([np.nan, 0.0, 0.1], [0.0, 0.0, -1.0], Fate.OUTSIDE_CAVITY),
        ([0.0, 0.0, np.nan], [0.0, 0.0, -1.0], Fate.BACKWARD),
        ([0.0, 0.0, np.nan], [0.0, 0.0, 1.0], Fate.OUTSIDE_CAVITY),
    ],
)
def test_every_ray_has_its_fate(tracer: str, origin, direction, fate) -> None:
    way = np.array([direction]) / np.linalg.norm(direction)
    rays = RayBundle(np.array([origin]), way, np.ones(1))
    assert _by_tracer(tracer, (sphere(0.8), sphere(2.45)), rays, 24).fates.tolist() == [fate]
