"""Moved faces against meshes of the moved faces, cast by trimesh, with Snell's law written here."""

import numpy as np
import pytest
import torch
import trimesh
from landed import trace_tables
from nightly import first_by_day
from scenes import random_surface, table_of
from scipy.spatial.transform import Rotation

from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.scene.as_made import AsMade, Displacement
from lensforge.sources.build_source import SquareEmitter
from lensforge.surfaces.bicubic_table import TableGrid

INDEX, GRID = 1.4936, TableGrid(301)
INNER, OUTER = random_surface(1, 3.0, 0.01, (9, 25)), random_surface(2, 6.0, 0.01, (9, 25))
LENS = Displacement((0.08, -0.05, 0.04), (0.02, -0.03))
FACE = Displacement((-0.05, 0.07, 0.03), (0.03, 0.01))
_RINGS, _SPOKES = 100, 200


def _moved(points: np.ndarray, by: Displacement, directions: bool = False) -> np.ndarray:
    turned = Rotation.from_rotvec([*by.tilt_rad, 0.0]).apply(points)
    return turned if directions else turned + np.array(by.shift_mm)


def _mesh(surface, *moves: Displacement) -> tuple[trimesh.Trimesh, np.ndarray]:
    """Mesh of a moved face, and the exact normals at its vertices."""
    z = np.cos(np.linspace(1e-3, 0.49 * np.pi, _RINGS))
    azimuth = 2.0 * np.pi * np.arange(_SPOKES) / _SPOKES
    sine = np.sqrt(1.0 - z * z)[:, None]
    u = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.repeat(z[:, None], _SPOKES, axis=1)], axis=-1)
    u = u.reshape(-1, 3)
    points, normals = surface.radius(u)[:, None] * u, surface.normal(u)
    for by in moves:
        points, normals = _moved(points, by), _moved(normals, by, directions=True)
    corner = np.arange((_RINGS - 1) * _SPOKES).reshape(_RINGS - 1, _SPOKES)
    beside = np.roll(corner, -1, axis=1)
    faces = np.concatenate(
        [
            np.stack([corner, corner + _SPOKES, beside], axis=-1).reshape(-1, 3),
            np.stack([beside, corner + _SPOKES, beside + _SPOKES], axis=-1).reshape(-1, 3),
        ]
    )
    return trimesh.Trimesh(points, faces, process=False), normals


def _refracted(d: np.ndarray, n: np.ndarray, ratio: float) -> np.ndarray:
    cosine = np.sum(d * n, axis=1, keepdims=True)
    return ratio * d + (np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine) * n


def _through(mesh: trimesh.Trimesh, normals: np.ndarray, p: np.ndarray, d: np.ndarray, ratio: float):
    """Points on the mesh, and directions behind it; NaN where a ray does not meet it."""
    places, rays, triangles = mesh.ray.intersects_location(p, d, multiple_hits=False)
    shares = trimesh.triangles.points_to_barycentric(mesh.triangles[triangles], places)
    n = np.einsum("nk,nkj->nj", shares, normals[mesh.faces[triangles]])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    points, directions = np.full_like(p, np.nan), np.full_like(d, np.nan)
    points[rays], directions[rays] = places, _refracted(d[rays], n, ratio)
    return points, directions


@pytest.mark.parametrize(
    ("lens", "face"), first_by_day(1, [(LENS, FACE), (LENS, Displacement()), (Displacement(), FACE)])
)
def test_rays_leave_moved_faces_as_they_leave_their_meshes(lens: Displacement, face: Displacement) -> None:
    rays = SquareEmitter(1.0).sample(64, 3)
    tables = [table_of(surface, GRID) for surface in (INNER, OUTER)]
    found = trace_tables(tables, Scene(Media(Medium(INDEX)), GRID, made=AsMade(lens=lens, faces={"outer": face})), rays)
    p, d = _through(*_mesh(INNER, lens), rays.origins, rays.directions, 1.0 / INDEX)
    inside = np.isfinite(p[:, 0])
    q, e = np.full_like(p, np.nan), np.full_like(p, np.nan)
    q[inside], e[inside] = _through(*_mesh(OUTER, face, lens), p[inside], d[inside], INDEX)
    both = found.left_lens.numpy() & np.isfinite(e).all(axis=1)
    assert both.sum() > 40
    assert np.abs(found.points.numpy() - q)[both].max() < 3e-3
    assert np.abs(found.directions.numpy() - e)[both].max() < 2e-3
    still = trace_tables(tables, Scene(Media(Medium(INDEX)), GRID), rays)
    moved_by = torch.linalg.norm(still.points - found.points, dim=1)[torch.from_numpy(both)]
    assert moved_by.median() > 0.02
