"""Clearance of the ball at the base: near the rim the ball extends below z = 0, where it may hit the base.

A built-in base is a disc below z = 0 with a bore straight down from the cavity's rim. The measures say how far that
material must be cut back for the ball to touch a sample: down, below the outer face; sideways, around the bore; and
away from the outer rim, where a relief step's wall runs down from an undercut rim. A custom base, from a STEP file, is
represented by its mesh; CAD and mesh libraries load only where a spec has one.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.geometry.acceptance import FORM_LIMIT_NM
from lensforge.geometry.custom_base import read_custom_base, tessellated
from lensforge.manufacturing.cutter import LEAF
from lensforge.manufacturing.face import FaceSamples, OpticalFace
from lensforge.manufacturing.face_check import FaceCheck
from lensforge.manufacturing.result import CustomBaseRelief, InnerRelief, OuterRelief, Relief
from lensforge.spec import BaseSection

# At the rim of a hemisphere the ball touches the bore's wall exactly, up to the form error.
_CLEAR_MM = 1e-6 * FORM_LIMIT_NM
_RIM_POINTS = 4096
_BASE_CHORD_MM = 1e-3  # between the mesh and the curved faces of a custom base
_BASE_POINTS, _SEED = 4000, 0


@dataclass(frozen=True)
class CustomBaseMesh:
    """The base of a STEP file as a closed ``trimesh.Trimesh`` (mm)."""

    mesh: Any

    def retreat_mm(self, face: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
        """Depth (mm) to which the base enters the ball that touches each sample; 0 where it is clear."""
        from trimesh.proximity import closest_point

        centres = face.points + cutter_radius_mm * face.normals
        near = np.flatnonzero(centres[:, 2] < cutter_radius_mm)  # the top of the base is at z = 0
        retreat = np.zeros(len(centres))
        if len(near):
            closest, distance, facet = closest_point(self.mesh, centres[near])
            into = np.sum((centres[near] - closest) * self.mesh.face_normals[facet], axis=1) < 0.0
            retreat[near] = cutter_radius_mm - np.where(into, -distance, distance)
        return np.where(retreat > _CLEAR_MM, retreat, 0.0)

    def points(self) -> Float[np.ndarray, "m 3"]:
        """Points (mm) all over the base, as obstacles for shanks and holders."""
        from trimesh.sample import sample_surface

        return np.asarray(sample_surface(self.mesh, _BASE_POINTS, seed=_SEED)[0], dtype=np.float64)


def read_base_mesh(path: Path) -> CustomBaseMesh:
    """Mesh of the base in the STEP file ``path``. Raises :class:`InputError` as the export does."""
    import trimesh

    vertices, triangles = tessellated(read_custom_base(path).solid, _BASE_CHORD_MM)
    return CustomBaseMesh(trimesh.Trimesh(vertices, triangles, process=False))


def relief_step_mm(outer: FaceSamples, cutter_radius_mm: float, base_diameter_mm: float) -> Float[np.ndarray, " k"]:
    """Depth (mm) below z = 0 at which the base's top clears the ball at each sample; 0 where it need not be lower.

    Outside the disc of ``base_diameter_mm`` nothing limits the ball.
    """
    centres = outer.points + cutter_radius_mm * outer.normals
    outside = np.maximum(np.hypot(centres[:, 0], centres[:, 1]) - base_diameter_mm / 2.0, 0.0)
    below = np.sqrt(np.maximum(cutter_radius_mm**2 - outside**2, 0.0))
    step = np.where(outside < cutter_radius_mm, below - centres[:, 2], 0.0)
    return np.where(step > _CLEAR_MM, step, 0.0)


def bore_clearance_mm(inner: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
    """Width (mm, all around) that the bore needs beyond the cavity's rim for the ball to touch each sample.

    Valid for samples that the ball reaches in the cavity itself: a centre above z = 0 is then at least R from the rim.
    A centre below, where the cavity narrows upwards, must be R away from the wall of the bore.
    """
    return _clearance_mm(inner, cutter_radius_mm)


def step_clearance_mm(outer: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
    """Setback (mm) from the outer rim that a relief step's wall needs for the ball to touch each sample.

    0 where a wall straight down from the rim is clear; larger only near a rim that is undercut.
    """
    return _clearance_mm(outer, cutter_radius_mm)


def _clearance_mm(face: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
    """Depth (mm) of the ball in a wall straight down from the face's rim; 0 for a centre above z = 0."""
    centres = face.points + cutter_radius_mm * face.normals
    low = centres[:, 2] < 0.0
    clearance = np.zeros(len(centres))
    if low.any():
        clearance[low] = cutter_radius_mm - _distance_to_rim(face.face, centres[low, :2])
    return np.where(clearance > _CLEAR_MM, clearance, 0.0)


def _distance_to_rim(face: OpticalFace, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Distance (mm) in the plane z = 0 to the face's rim."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, _RIM_POINTS, endpoint=False)
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    distance, _ = cKDTree(face.radius(circle)[:, None] * circle, leafsize=LEAF).query(points)
    nearest: Float[np.ndarray, " n"] = distance
    return nearest


def check_relief(
    base: BaseSection | None, custom: CustomBaseMesh | None, cutter_mm: float, inner: FaceCheck, outer: FaceCheck
) -> Relief:
    """Clearance that the cutter lacks at the base, over the samples that it could reach without the base.

    ``base``: None for a mould insert; ``custom``: the base from a STEP file, if ``base`` names one.
    """
    if base is None or base.kind == "none":
        note = "a mould insert has no base" if base is None else "there is no base"
        return Relief(outer=None, inner=None, note=note)
    if custom is not None:
        return Relief(outer=_at_custom(outer, custom, cutter_mm), inner=_at_custom(inner, custom, cutter_mm))
    step = _missing_step(base, cutter_mm, outer)
    setback = step_clearance_mm(outer.samples, cutter_mm)
    setback = np.where(setback > base.relief_setback_mm, setback, 0.0)
    clearance = bore_clearance_mm(inner.samples, cutter_mm)
    return Relief(
        outer=OuterRelief(
            smallest_step_mm=_largest_reached(outer, step),
            step_clearance_mm=_largest_reached(outer, setback),
            flush_fraction=_clear(outer, np.maximum(step, setback)),
        ),
        inner=InnerRelief(
            bore_clearance_mm=_largest_reached(inner, clearance), flush_fraction=_clear(inner, clearance)
        ),
    )


def _missing_step(base: BaseSection, cutter_mm: float, outer: FaceCheck) -> Float[np.ndarray, " k"]:
    """The step (mm) that each sample needs, flange included; 0 where the present one is enough."""
    step = relief_step_mm(outer.samples, cutter_mm, base.widest_mm) - base.relief_step_mm
    if base.flange_diameter_mm is not None:
        shoulder = base.height_mm - base.flange_height_mm
        step = np.maximum(step, relief_step_mm(outer.samples, cutter_mm, base.flange_diameter_mm) - shoulder)
    return np.where(step > 0.0, step + base.relief_step_mm, 0.0)


def _at_custom(face: FaceCheck, custom: CustomBaseMesh, cutter_mm: float) -> CustomBaseRelief:
    retreat = custom.retreat_mm(face.samples, cutter_mm)
    return CustomBaseRelief(retreat_mm=_largest_reached(face, retreat), flush_fraction=_clear(face, retreat))


def _largest_reached(face: FaceCheck, retreat: Float[np.ndarray, " k"]) -> float | None:
    return float(retreat[face.reached].max()) if face.reached.any() else None


def _clear(face: FaceCheck, retreat: Float[np.ndarray, " k"]) -> float:
    return face.samples.fraction(face.reached & (retreat == 0.0))
