"""Faces that are drawn along y: closed forms, a ray in the plane with another index, ends, and the reference tracer."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
import torch
from landed import by_kernels, in_torch, on_device
from scipy.optimize import brentq

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, TracedBundle, trace_tables
from lensforge.optics.media import Media, Medium
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.drawn_profile import DrawnFace, round_profile

INDEX = 1.5
GRID = TableGrid(241)
SCENE = Scene(Media(Medium(INDEX)), GRID, drawn_half_mm=inf)
ROUND = round_profile(4.0, 12.0, 8), round_profile(10.0, 12.0, 8)
CROOKED = (
    DrawnFace(19.0, (0.26, 0.25, 0.255, 0.24, 0.25, 0.245, 0.235, 0.25, 0.26, 0.25)),
    DrawnFace(19.0, (0.10, 0.102, 0.099, 0.098, 0.097, 0.095, 0.097, 0.1, 0.102, 0.1)),
)


def tables_of(faces: tuple[DrawnFace, DrawnFace]) -> np.ndarray:
    return np.stack([tabulate(GRID, face) for face in faces])


def led(count: int, seed: int = 0, spread: float = 0.5) -> RayBundle:
    """Rays upwards from a rectangle that lies along y, beside the y axis."""
    rng = np.random.default_rng(seed)
    origins = np.column_stack(
        [0.3 + spread * (rng.random(count) - 0.5), 60.0 * (rng.random(count) - 0.5), 0.0 * rng.random(count)]
    )
    directions = rng.normal(size=(count, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    return RayBundle(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True), rng.random(count))


def test_light_of_the_axis_leaves_concentric_cylinders_undeviated_from_any_place_along_y() -> None:
    rays = led(2000)
    rays = replace(rays, origins=rays.origins * (0.0, 1.0, 0.0))
    exits = trace_tables(tables_of(ROUND), SCENE, rays)
    assert (exits.fates == Fate.LEFT_LENS).all()
    assert np.abs(exits.directions - rays.directions).max() < 1e-12
    assert np.abs(np.hypot(exits.points[:, 0], exits.points[:, 2]) - 10.0).max() < 1e-10
    steep = rays.directions[:, 1] / np.hypot(rays.directions[:, 0], rays.directions[:, 2])
    in_body = rays.directions[:, 1] / np.sqrt(INDEX**2 - rays.directions[:, 1] ** 2)
    assert np.allclose(exits.points[:, 1] - rays.origins[:, 1], 4.0 * steep + 6.0 * in_body, rtol=1e-8)


def in_the_plane(face: DrawnFace, start: np.ndarray, way: np.ndarray) -> tuple[float, np.ndarray]:
    """Path to a profile in the plane, and its unit normal there, by the profile alone."""

    def gap(path: float) -> float:
        point = start + path * way
        (profile,) = face.points(np.array([np.arctan2(*point)]))
        return float(np.linalg.norm(profile) - np.linalg.norm(point))

    path = brentq(gap, 1e-9, 40.0, xtol=1e-13)
    angle = np.arctan2(*(start + path * way))
    before, after = face.points(np.array([angle - 1e-5, angle + 1e-5]))
    along = (after - before) / np.linalg.norm(after - before)
    return path, np.array([-along[1], along[0]])


def test_a_ray_is_one_in_the_plane_with_the_index_of_its_direction_along_y() -> None:
    """Its shadow is refracted by ``sqrt(n^2 - p^2)`` over ``sqrt(1 - p^2)``, p being kept along y."""
    rays = led(60, 3)
    exits = trace_tables(tables_of(CROOKED), SCENE, rays)
    out = np.flatnonzero(exits.fates == Fate.LEFT_LENS)
    assert len(out) > 30
    for k in out.tolist():
        along = rays.directions[k, 1]
        start = rays.origins[k, [0, 2]]
        way = rays.directions[k, [0, 2]] / np.sqrt(1.0 - along**2)
        y = rays.origins[k, 1]
        outside, inside = np.sqrt(1.0 - along**2), np.sqrt(INDEX**2 - along**2)
        for face, before, behind in ((CROOKED[0], outside, inside), (CROOKED[1], inside, outside)):
            path, normal = in_the_plane(face, start, way)
            start = start + path * way
            y += path * along / before
            normal *= np.sign(normal @ way)
            ratio = before / behind
            cosine = float(normal @ way)
            way = ratio * way + (np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine) * normal
        assert exits.directions[k, 1] == pytest.approx(along, abs=1e-13)
        assert np.allclose(exits.directions[k, [0, 2]], outside * way, atol=2e-6)
        assert np.allclose(exits.points[k], [start[0], y, start[1]], atol=2e-5)


def test_ends_take_the_light_that_would_leave_beyond_them() -> None:
    """And no other: all light is accounted for, and what leaves is as without an end."""
    rays = led(4000, 1)
    tables = tables_of(CROOKED)
    free = trace_tables(tables, SCENE, rays)
    capped = trace_tables(tables, replace(SCENE, drawn_half_mm=35.0), rays)
    left = free.fates == Fate.LEFT_LENS
    past = left & (np.abs(free.points[:, 1]) > 35.0)
    assert 50 < past.sum() < left.sum() - 50
    assert (capped.fates == np.where(past, Fate.FLANGE, free.fates)).all()
    assert np.array_equal(capped.points[left & ~past], free.points[left & ~past])
    assert (capped.flux <= rays.flux).all() and (capped.flux[past] > 0.8 * rays.flux[past]).any()


def test_faces_look_the_same_all_along() -> None:
    rays = led(500, 5)
    moved = replace(rays, origins=rays.origins + np.array([0.0, 1234.5, 0.0]))
    first, second = (trace_tables(tables_of(CROOKED), SCENE, bundle) for bundle in (rays, moved))
    assert (first.fates == second.fates).all()
    assert np.allclose(second.points[first.left_lens] - first.points[first.left_lens], (0.0, 1234.5, 0.0), atol=1e-9)
    assert np.array_equal(first.directions, second.directions)


@pytest.mark.parametrize("half_mm", [inf, 35.0])
def test_the_reference_tracer_agrees(half_mm: float) -> None:
    scene = replace(SCENE, drawn_half_mm=half_mm)
    tables = [torch.from_numpy(table) for table in tables_of(CROOKED)]
    rays = led(1500, 7, spread=2.0)
    kernels = by_kernels(tables, scene, rays, 100.0)
    reference = in_torch(on_device(tables, scene, rays, "cpu"), 100.0)
    assert torch.equal(reference.fates, kernels.fates)
    assert torch.allclose(reference.carried, kernels.carried, rtol=1e-10, atol=0.0)
    assert torch.allclose(reference.hits, kernels.hits, rtol=1e-7, atol=1e-7)
    assert half_mm == inf or bool((kernels.fates == int(Fate.FLANGE)).any())


def test_gradients_by_the_tables_are_those_of_differences() -> None:
    """On a crooked lens with ends; a change of the tables along a smooth profile."""
    scene = replace(SCENE, drawn_half_mm=45.0)
    rays = led(300, 11)
    tables = tables_of(CROOKED)
    rng = np.random.default_rng(2)
    by_points, by_directions = rng.normal(size=(2, 300, 3))
    by_flux, by_sin2 = rng.normal(size=(2, 300))
    wave = np.stack([tabulate(GRID, DrawnFace(19.0, tuple(0.2 + 0.01 * rng.random(10)))) for _ in range(2)])

    def value(exits: ExitRays, kept: np.ndarray) -> float:
        # no receiver sees where on its line the point of a ray lies
        points = exits.points - (exits.points * exits.directions).sum(axis=1, keepdims=True) * exits.directions
        weighed = (
            (points * by_points).sum(axis=1) + (exits.directions * by_directions).sum(axis=1) + exits.flux * by_flux
        )
        return float(weighed[kept].sum())

    step = 1e-6
    ahead, behind = (trace_tables(tables + sign * step * wave, scene, rays) for sign in (1.0, -1.0))
    traced = TracedBundle.of(tables, scene, rays)
    kept = traced.exits.left_lens & ahead.left_lens & behind.left_lens
    assert kept.sum() > 100
    u = traced.exits.directions
    p = traced.exits.points
    onto = (p * u).sum(axis=1, keepdims=True)
    across = by_points - (by_points * u).sum(axis=1, keepdims=True) * u
    of_directions = by_directions - (by_points * u).sum(axis=1, keepdims=True) * p - onto * by_points
    mask = kept[:, None]
    gradients = traced.gradients(
        Sensitivities(np.where(mask, across, 0.0), np.where(mask, of_directions, 0.0)),
        np.where(kept, by_flux, 0.0),
        0.0 * by_sin2,
    )
    change = (value(ahead, kept) - value(behind, kept)) / (2.0 * step)
    assert float((gradients * wave).sum()) == pytest.approx(change, rel=1e-5)
