"""Distance between the finished body and the keep-out, and their closest places, by their meshes."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.geometry.keep_out import KeepOut, KeepOutSolid
from lensforge.geometry.manifold import manifold_of
from lensforge.geometry.mesh import BodyMesh
from lensforge.geometry.part import KeepOutDistance

_SLACK = 1.0 + 1e-9  # of a distance in which to look for a smaller one
_Triangles = tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, "_ 3"]]  # vertices and their numbers


def keep_out_distance(mesh: BodyMesh, keep_out: KeepOut, error_mm: float) -> KeepOutDistance | None:
    """Measure the smallest distance from ``mesh`` to the solids of ``keep_out``; ``error_mm``: of both meshes' facets.

    None where ``mesh`` is not closed, which a criterion of its own says. Raises :class:`InputError` where a mesh of the
    solids is not closed.
    """
    import manifold3d

    body = manifold_of(mesh.vertices, mesh.triangles)
    if body.status() != manifold3d.Error.NoError:
        return None
    gap_mm, closest = np.inf, keep_out.solids[0]
    for solid in keep_out.solids:
        other = manifold_of(solid.vertices, solid.triangles)
        if other.is_empty():
            raise InputError(f"{keep_out.path}: the mesh of a solid is not closed; repair it in CAD")
        common = body ^ other
        if not common.is_empty():
            found = -2.0 * common.volume() / common.surface_area()
        else:
            found = body.min_gap(other, _between_vertices(mesh.vertices, solid.vertices) * _SLACK)
        if found < gap_mm:
            gap_mm, closest = found, solid
    places = _places(mesh, closest) if gap_mm >= 0.0 else _common_place(body, closest)
    return KeepOutDistance(
        distance_mm=gap_mm,
        body_point_mm=tuple(places[0].tolist()),
        keep_out_point_mm=tuple(places[1].tolist()),
        error_mm=error_mm,
    )


def _between_vertices(one: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "m 3"]) -> float:
    """Least distance (mm) between two sets of vertices: the meshes are no further apart."""
    from scipy.spatial import cKDTree

    return float(cKDTree(one).query(other)[0].min())


def _places(mesh: BodyMesh, solid: KeepOutSolid) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Closest places of body and solid: a vertex of one, and the nearest point of the other."""
    body, other = (mesh.vertices, mesh.triangles), (solid.vertices, solid.triangles)
    least_mm = _between_vertices(mesh.vertices, solid.vertices)
    there, here, one = _nearest(other, body, least_mm)
    back, forth, another = _nearest(body, other, least_mm)
    return (here, there) if one <= another else (back, forth)


def _nearest(
    surface: _Triangles, vertices: _Triangles, most_mm: float
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"], float]:
    """Place on ``surface``, vertex of another mesh, and their distance (mm), the least of those up to ``most_mm``."""
    import trimesh

    target, points = trimesh.Trimesh(*surface, process=False), vertices[0]
    outside = np.maximum(target.bounds[0] - points, points - target.bounds[1])
    near = points[np.linalg.norm(np.maximum(outside, 0.0), axis=1) <= most_mm * _SLACK]
    if not len(near):
        return np.zeros(3), np.zeros(3), np.inf
    found, distances, _ = trimesh.proximity.closest_point(target, near)
    best = int(distances.argmin())
    return np.asarray(found[best]), near[best], float(distances[best])


def _common_place(body: Any, solid: KeepOutSolid) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """The lowest vertex of what body and solid have in common, and its outermost one, lifted to its highest z."""
    common = np.asarray((body ^ manifold_of(solid.vertices, solid.triangles)).to_mesh64().vert_properties)[:, :3]
    outermost = common[np.hypot(common[:, 0], common[:, 1]).argmax()]
    return common[common[:, 2].argmin()], np.array([outermost[0], outermost[1], common[:, 2].max()])
