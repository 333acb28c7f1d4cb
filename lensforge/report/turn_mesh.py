"""The exported mesh made small enough to travel inside the page, where a reader can turn it.

The bytes, little-endian: vertex and triangle counts (uint32); mm per unit, half the height of the first view (mm) and
the z of its centre (mm) (float32); then positions about the origin (int16 x 3 per vertex), triangles (uint16 x 3) and
normals (int8 x 3). ``templates/turn.js`` reads them.
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

MOST_TRIANGLES = 12_000  # about 110 kB: too coarse to measure on, fine enough to look at
_EDGE_DEG = 35.0  # sharper edges keep two normals
_CANDIDATES = 8


def small_mesh(mesh: Any, half_height_mm: float, centre_z_mm: float) -> bytes:
    """A triangle mesh (pyvista) as the page carries it; the normals are those of the full mesh."""
    coarse = mesh
    if mesh.n_cells > MOST_TRIANGLES:
        coarse = mesh.decimate(1.0 - MOST_TRIANGLES / mesh.n_cells)
    coarse, fine = _with_normals(coarse), _with_normals(mesh)
    normals = _nearest_normals(coarse, fine)
    triangles = np.asarray(coarse.faces).reshape(-1, 4)[:, 1:]
    return pack(np.asarray(coarse.points, dtype=np.float64), triangles, normals, half_height_mm, centre_z_mm)


def pack(
    points: Float[np.ndarray, "n 3"],
    triangles: Int[np.ndarray, "m 3"],
    normals: Float[np.ndarray, "n 3"],
    half_height_mm: float,
    centre_z_mm: float,
) -> bytes:
    """Quantised: positions to 1/32767 of the largest coordinate, normals to 1/127."""
    unit = float(np.abs(points).max()) / 32767.0
    counts = np.array([len(points), len(triangles)], dtype="<u4")
    view = np.array([unit, half_height_mm, centre_z_mm], dtype="<f4")
    parts = (
        counts,
        view,
        np.round(points / unit).astype("<i2"),
        triangles.astype("<u2"),
        np.round(127.0 * normals).astype("i1"),
    )
    return b"".join(part.tobytes() for part in parts)


def _with_normals(mesh: Any) -> Any:
    return mesh.compute_normals(split_vertices=True, feature_angle=_EDGE_DEG, consistent_normals=False)


def _nearest_normals(coarse: Any, fine: Any) -> Float[np.ndarray, "n 3"]:
    """Of the nearest vertices of the full mesh, the normal that agrees best: beside an edge there are two."""
    own, full = np.asarray(coarse.point_data["Normals"]), np.asarray(fine.point_data["Normals"])
    count = min(_CANDIDATES, fine.n_points)
    _, nearest = cKDTree(fine.points).query(coarse.points, k=count)
    candidates = full[np.reshape(nearest, (-1, count))]
    best = np.argmax(np.einsum("nkc,nc->nk", candidates, own), axis=1)
    return np.asarray(candidates[np.arange(len(own)), best], dtype=np.float64)
