"""A base from a STEP file in the way of a tool: its mesh, the room that a ball lacks, points that a shank may meet.

CAD and mesh libraries load only where a spec has such a base.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.geometry.mesh_union import tessellated
from lensforge.geometry.step_base import read_base
from lensforge.manufacturing.sampling import FaceSamples

_CHORD_MM = 1e-3  # between the mesh and the round faces of the base
_CLEAR_MM = 1e-6
_POINTS, _SEED = 4000, 0


@dataclass(frozen=True)
class OwnBase:
    """The base as a closed ``trimesh.Trimesh`` (mm)."""

    mesh: Any

    def retreat_mm(self, face: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
        """How far (mm) the base would have to draw back for the ball to touch each sample; 0 where it is clear."""
        from trimesh.proximity import closest_point

        centres = face.points + cutter_radius_mm * face.normals
        near = np.flatnonzero(centres[:, 2] < cutter_radius_mm)  # the base ends in z = 0
        retreat = np.zeros(len(centres))
        if len(near):
            closest, distance, facet = closest_point(self.mesh, centres[near])
            into = np.sum((centres[near] - closest) * self.mesh.face_normals[facet], axis=1) < 0.0
            retreat[near] = cutter_radius_mm - np.where(into, -distance, distance)
        return np.where(retreat > _CLEAR_MM, retreat, 0.0)

    def points(self) -> Float[np.ndarray, "m 3"]:
        """Points (mm) all over the base, as obstacles for shanks and holders."""
        from trimesh.sample import sample_surface

        return np.asarray(sample_surface(self.mesh, _POINTS, seed=_SEED)[0], dtype=np.float64)


def read_own_base(path: Path) -> OwnBase:
    """The base in the STEP file ``path``. Raises :class:`InputError` as the export does."""
    import trimesh

    vertices, triangles = tessellated(read_base(path).solid, _CHORD_MM)
    return OwnBase(trimesh.Trimesh(vertices, triangles, process=False))
