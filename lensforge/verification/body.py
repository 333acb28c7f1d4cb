"""Size of an exported body, from its STL alone, and the amounts by which flat facets change it.

The facets of another program have another chord error. It follows from the mesh itself: two facets that meet at a small
angle lie on one curved face, whose radius is their breadth over that angle.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from lensforge.records import BodySize, Box
from lensforge.verification.part_mesh import CREASE_RAD, LEVEL_MM


@dataclass(frozen=True)
class FacetErrors:
    """Amounts by which flat facets change a body: largest height of the curved face over them (mm), volume, area."""

    chord_mm: float
    volume_mm3: float
    area_mm2: float


def mesh_size(mesh: trimesh.Trimesh) -> BodySize:
    """Volume, area and box of a closed mesh (mm)."""
    return BodySize(volume_mm3=float(mesh.volume), area_mm2=float(mesh.area), bounds_mm=as_box(mesh.bounds))


def as_box(corners: Float[np.ndarray, "2 3"]) -> Box:
    """Least and largest corner as plain numbers."""
    (x0, y0, z0), (x1, y1, z1) = corners.tolist()
    return (x0, y0, z0), (x1, y1, z1)


def facet_errors(mesh: trimesh.Trimesh) -> FacetErrors:
    """Bounds of what the facets of ``mesh`` change, by the angles at which they meet.

    Over an equilateral facet of height h on a sphere of radius R the sphere rises to 2 h^2 / (9 R), and its neighbours
    turn by 2 h / (3 R): so by h / 3 times that angle; over the strip of a cylinder by h / 8 times it. The facets of a
    sphere lack 0.6 of the square of that angle of their area, and flat faces what the chords of their rims cut off.
    """
    ends = mesh.vertices[mesh.face_adjacency_edges]
    between = (np.abs(ends[:, :, 2]) < LEVEL_MM).all(axis=1)  # at z = 0 lens and base meet, at any angle
    smooth = (mesh.face_adjacency_angles < CREASE_RAD) & ~between
    pairs, angles = mesh.face_adjacency[smooth], mesh.face_adjacency_angles[smooth]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    heights = 2.0 * mesh.area_faces[pairs] / np.maximum(lengths[smooth], np.finfo(float).tiny)[:, None]
    rises, turns = np.zeros(len(mesh.faces)), np.zeros(len(mesh.faces))
    np.maximum.at(rises, pairs, angles[:, None] * heights / 3.0)
    np.maximum.at(turns, pairs, angles[:, None])
    at_rims = rises[mesh.face_adjacency[~smooth]].max(axis=1)
    return FacetErrors(
        chord_mm=float(rises.max(initial=0.0)),
        volume_mm3=float(mesh.area_faces @ rises),
        area_mm2=float(mesh.area_faces @ turns**2 + lengths[~smooth] @ at_rims),
    )
