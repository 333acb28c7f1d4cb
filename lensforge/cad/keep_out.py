"""The keep-out: solids of a STEP file (LED package, bond wires, board) that a lens and its base must not enter.

The file is in the coordinates of the lens. It comes from outside, and is read in a child process as a custom base is.
The distance from the finished body is that of their meshes, which are within ``FACET_MM`` of their faces.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.cad.mesh import BodyMesh, manifold_of
from lensforge.cad.part_limits import KeepOutDistance
from lensforge.errors import InputError
from lensforge.results.file_bounds import MOST_STEP_MIB
from lensforge.results.files import MIB, read_file
from lensforge.spec import BaseSection
from lensforge.surfaces.solid_file import tessellated

# Largest distance of the meshes from curved faces. The CAD kernel keeps its chord at the edges of its triangles; in the
# middle of those of a ball it is off by 1.7 times as much.
FACET_MM = 2e-3


def mesh_error_mm(base: BaseSection, rings: int, chord_mm: float) -> float:
    """Largest error (mm) of a distance between the meshes of body and keep-out.

    ``chord_mm``: of the optical facets. A cylinder of the base is a polygon of 6 ``rings`` corners, or more.
    """
    widest = (base.flange_diameter_mm or base.widest_mm) if base.kind in ("cylinder", "square") else 0.0
    return max(chord_mm, widest / 2.0 * (1.0 - cos(pi / (6 * rings)))) + FACET_MM


_CHORD_MM = 0.5 * FACET_MM


@dataclass(frozen=True, eq=False)
class KeepOutSolid:
    """A closed mesh of one solid: vertices (mm), and triangles that face outwards."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]

    @property
    def corners(self) -> Float[np.ndarray, "t 3 3"]:
        """Corners (mm) of every triangle."""
        return self.vertices[self.triangles]


@dataclass(frozen=True, eq=False)
class KeepOut:
    """The solids of a file, as meshes within ``FACET_MM`` of their faces."""

    path: Path
    solids: tuple[KeepOutSolid, ...]


def read_keep_out(path: Path) -> KeepOut:
    """The solids of the STEP file ``path`` in mm, whatever its unit; the same object for the same content.

    Raises :class:`InputError` for a missing file, for anything but STEP, and if it holds no valid solid.
    """
    missing = "constraints.keep_out is relative to the folder of its spec"
    return _meshed(read_file(path, missing=missing, most_bytes=MOST_STEP_MIB * MIB), path)


@lru_cache(maxsize=2)
def _meshed(content: bytes, path: Path) -> KeepOut:
    from lensforge.cad.custom_base import solids_in

    solids = solids_in(content, path)
    if not solids:
        raise InputError(f"{path}: holds no solid, a keep-out is one or several; export closed bodies, not surfaces")
    for number, solid in enumerate(solids, start=1):
        if not solid.valid:
            raise InputError(
                f"{path}: its solid {number} of {len(solids)} is not valid (open, with a void, or self-intersecting); "
                "repair it in CAD"
            )
    return KeepOut(path, tuple(KeepOutSolid(*tessellated(solid.shape, _CHORD_MM)) for solid in solids))


_SLACK = 1.0 + 1e-9  # of a distance in which to look for a smaller one
_Triangles = tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, "_ 3"]]  # vertices and their numbers


def keep_out_distance(mesh: BodyMesh, keep_out: KeepOut, error_mm: float) -> KeepOutDistance | None:
    """Measure the smallest distance from ``mesh`` to the solids of ``keep_out``; ``error_mm``: of both meshes' facets.

    None if ``mesh`` is not closed, which another criterion judges. Raises :class:`InputError` if a mesh of the solids
    is not closed.
    """
    import manifold3d

    body = manifold_of(mesh.vertices, mesh.triangles)
    if body.status() != manifold3d.Error.NoError:
        return None
    gap_mm = np.inf
    closest = keep_out.solids[0]
    for solid in keep_out.solids:
        other = manifold_of(solid.vertices, solid.triangles)
        if other.is_empty():
            raise InputError(f"{keep_out.path}: the mesh of a solid is not closed; repair it in CAD")
        common = body ^ other
        if not common.is_empty():
            distance = -2.0 * common.volume() / common.surface_area()
        else:
            distance = body.min_gap(other, _between_vertices(mesh.vertices, solid.vertices) * _SLACK)
        if distance < gap_mm:
            gap_mm = distance
            closest = solid
    places = _places(mesh, closest) if gap_mm >= 0.0 else _common_place(body, closest)
    return KeepOutDistance(
        distance_mm=gap_mm,
        body_point_mm=tuple(places[0].tolist()),
        keep_out_point_mm=tuple(places[1].tolist()),
        error_mm=error_mm,
    )


def _between_vertices(first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "m 3"]) -> float:
    """Least distance (mm) between the vertices of two meshes, an upper bound of that between the meshes."""
    from scipy.spatial import cKDTree

    return float(cKDTree(first).query(second)[0].min())


def _places(mesh: BodyMesh, solid: KeepOutSolid) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Closest places of body and solid: a vertex of one, and the nearest point of the other."""
    body = (mesh.vertices, mesh.triangles)
    keep_out = (solid.vertices, solid.triangles)
    least_mm = _between_vertices(mesh.vertices, solid.vertices)
    on_solid, on_body, points = _nearest(keep_out, body, least_mm)
    back, forth, another = _nearest(body, keep_out, least_mm)
    return (on_body, on_solid) if points <= another else (back, forth)


def _nearest(
    surface: _Triangles, vertices: _Triangles, most_mm: float
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"], float]:
    """Place on ``surface``, vertex of another mesh, and their distance (mm), the least of those up to ``most_mm``."""
    import trimesh
    from scipy.spatial import cKDTree

    points = vertices[0]
    (places, triangles) = surface
    most_mm = most_mm * _SLACK
    corners = places[triangles]
    # No place of a facet is farther from any of its corners than its longest edge is long.
    reach_mm = most_mm + np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    away = cKDTree(points).query(places, distance_upper_bound=reach_mm.max())[0]
    chosen = away[triangles].min(axis=1) <= reach_mm
    if not chosen.any():
        return np.zeros(3), np.zeros(3), np.inf
    facets = trimesh.Trimesh(places, triangles[chosen], process=False)
    to_corner = cKDTree(corners[chosen].reshape(-1, 3)).query(points, distance_upper_bound=reach_mm[chosen].max())[0]
    near = points[np.isfinite(to_corner)]
    if not len(near):
        return np.zeros(3), np.zeros(3), np.inf
    closest, distances, _ = trimesh.proximity.closest_point(facets, near)
    best = int(distances.argmin())
    return np.asarray(closest[best]), near[best], float(distances[best])


def _common_place(body: Any, solid: KeepOutSolid) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """The lowest vertex of the intersection of body and solid, and its outermost one, lifted to its greatest height."""
    common = np.asarray((body ^ manifold_of(solid.vertices, solid.triangles)).to_mesh64().vert_properties)[:, :3]
    outermost = common[np.hypot(common[:, 0], common[:, 1]).argmax()]
    return common[common[:, 2].argmin()], np.array([outermost[0], outermost[1], common[:, 2].max()])
