"""Clearance of the ball at the base: near the rim the ball extends below z = 0, where it may hit the base.

The measures say how far a built-in base must be cut back for the ball to touch a sample. A custom base, from a STEP
file, is represented by its mesh; CAD and mesh libraries load only where a spec has one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.cad.cutter_room import ball_centres_mm, largest_wall_mm, needed_step_mm, smallest_bore_mm
from lensforge.cad.face_tolerance import FINEST_NM
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan
from lensforge.shop.ball_cutter import LEAF
from lensforge.shop.check_measures import (
    AnyClearance,
    BallClearance,
    BoreClearance,
    CustomBaseClearance,
    StepClearance,
)
from lensforge.shop.face_check import MilledFace
from lensforge.shop.face_samples import AirSide, FaceSamples, OpticalFace

# At the rim of a hemisphere the ball touches the bore's wall exactly, up to the form error.
_CLEAR_MM = 1e-6 * FINEST_NM
_RIM_POINTS = 4096
_BASE_CHORD_MM = 1e-3  # between the mesh and the curved faces of a custom base
_BASE_POINTS = 4000
_SEED = 0

Retreats = dict[str, Float[np.ndarray, " k"]]


@dataclass(frozen=True)
class CustomBaseMesh:
    """The base of a STEP file as a closed ``trimesh.Trimesh`` (mm)."""

    mesh: Any

    def retreat_mm(self, face: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
        """Depth (mm) by which the base enters the ball that touches each sample; 0 if clear."""
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

    from lensforge.cad.custom_base import mesh_of_base

    return CustomBaseMesh(trimesh.Trimesh(*mesh_of_base(path, _BASE_CHORD_MM), process=False))


def wall_retreat_mm(face: FaceSamples, cutter_radius_mm: float, depth_mm: float) -> Float[np.ndarray, " k"]:
    """Width (mm) by which a wall straight down from the face's rim, to ``depth_mm``, enters the ball at each sample.

    Valid for samples that the ball reaches on the face itself: a centre above z = 0 is then at least R from the rim.
    """
    centres = face.points + cutter_radius_mm * face.normals
    below = np.maximum(-centres[:, 2] - depth_mm, 0.0)
    low = (centres[:, 2] < 0.0) & (below < cutter_radius_mm)
    retreat = np.zeros(len(centres))
    if low.any():
        across = np.sqrt(cutter_radius_mm**2 - below[low] ** 2)
        rim = cKDTree(_rim_mm(face.face)[:, None] * _turn(), leafsize=LEAF)
        retreat[low] = across - rim.query(centres[low, :2])[0]
    return np.where(retreat > _CLEAR_MM, retreat, 0.0)


def _rim_mm(face: OpticalFace) -> Float[np.ndarray, " n"]:
    """Distance (mm) of the rim from the axis, all around."""
    return face.rim_mm(_turn())


def _turn() -> Float[np.ndarray, "n 2"]:
    azimuth = np.linspace(0.0, 2.0 * np.pi, _RIM_POINTS, endpoint=False)
    return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


def check_ball_clearance(
    plan: Plan[Patch] | None, custom: CustomBaseMesh | None, faces: Mapping[str, MilledFace]
) -> BallClearance:
    """Clearance that the cutter lacks at the base, over the samples that it could reach without the base.

    ``plan``: the body with its base, None for a mould insert; ``custom``: the base from a STEP file, None without one.
    """
    if not faces:
        return BallClearance(faces={}, note="no face is milled")
    if custom is None and (plan is None or not plan.has_base):
        return BallClearance(faces={}, note="a mould insert has no base" if plan is None else "there is no base")
    return BallClearance(faces={name: _clearance(plan, custom, face) for name, face in faces.items()})


def base_retreats(plan: Plan[Patch] | None, custom: CustomBaseMesh | None, face: MilledFace) -> Retreats:
    """Lengths (mm) by which parts of the base must be cut back for the ball at each sample of ``face``; 0 if clear.

    Valid where the ball reaches the face without a base. Keyed by the fields of :data:`AnyClearance`; empty without a
    base.
    """
    if custom is not None:
        return {"retreat_mm": custom.retreat_mm(face.samples, face.cutter_radius_mm)}
    return {} if plan is None or not plan.has_base else _BY_SIDE[face.samples.face.air][1](plan, face)


def _clearance(plan: Plan[Patch] | None, custom: CustomBaseMesh | None, face: MilledFace) -> AnyClearance:
    retreats = base_retreats(plan, custom, face)
    kind = CustomBaseClearance if custom is not None else _BY_SIDE[face.samples.face.air][0]
    reached = face.reached
    needed = {name: float(retreat[reached].max()) if reached.any() else None for name, retreat in retreats.items()}
    clear = np.all([retreat == 0.0 for retreat in retreats.values()], axis=0)
    return kind(**needed, flush_fraction=face.samples.fraction(reached & clear))


def _at_step(plan: Plan[Patch], face: MilledFace) -> Retreats:
    cutter_mm = face.cutter_radius_mm
    distance, height = ball_centres_mm(face.samples.points, face.samples.normals, cutter_mm)

    def missing(base_mm: float, present_mm: float) -> Float[np.ndarray, " k"]:
        return np.maximum(needed_step_mm(distance, height, cutter_mm, base_mm) - present_mm, 0.0)

    base = plan.base
    present = plan.relief_mm
    step = missing(base.widest_mm / 2.0, present)
    step = np.where(step > _CLEAR_MM, step + present, 0.0)
    flange = np.zeros(len(step))
    if base.flange_diameter_mm is not None:
        flange = missing(base.flange_diameter_mm / 2.0, plan.shoulder_mm)
        flange = np.where(flange > _CLEAR_MM, flange, 0.0)
    if plan.ring is None:
        overhangs = all(arc.relation == "overhang" for arc in plan.arcs)  # the side of the base is then further inside
        depth = plan.relief_mm if overhangs else base.height_mm
        setback = wall_retreat_mm(face.samples, cutter_mm, depth) if depth > 0.0 else np.zeros(len(distance))
    else:
        wall = float(plan.ring.radius(np.zeros(1))[0])
        largest = largest_wall_mm(distance, height, cutter_mm)
        setback = np.where(largest < wall - _CLEAR_MM, _rim_mm(face.samples.face).min() - largest, 0.0)
    return {"smallest_step_mm": step, "step_clearance_mm": setback, "flange_clearance_mm": flange}


def _at_bore(plan: Plan[Patch], face: MilledFace) -> Retreats:
    cutter_mm = face.cutter_radius_mm
    distance, height = ball_centres_mm(face.samples.points, face.samples.normals, cutter_mm)

    def needed(radius_mm: float, top_mm: float, bottom_mm: float) -> Float[np.ndarray, " k"]:
        radius = smallest_bore_mm(distance, height, cutter_mm, top_mm, bottom_mm)
        return np.where(radius > radius_mm + _CLEAR_MM, radius, 0.0)

    if plan.bore is None:
        bore = wall_retreat_mm(face.samples, cutter_mm, plan.bore_mm)
    else:
        bore = needed(float(plan.bore.radius(np.zeros(1))[0]), 0.0, plan.bore_mm)
        bore = np.where(bore > 0.0, bore - _rim_mm(face.samples.face).max(), 0.0)
    pocket = np.zeros(len(bore))
    if plan.base.pocket_diameter_mm is not None:
        pocket = 2.0 * needed(plan.base.pocket_diameter_mm / 2.0, plan.bore_mm, plan.base.height_mm)
    return {"bore_clearance_mm": bore, "pocket_diameter_mm": pocket}


_BY_SIDE: dict[AirSide, tuple[type[StepClearance | BoreClearance], Callable[[Plan[Patch], MilledFace], Retreats]]] = {
    AirSide.OUTSIDE: (StepClearance, _at_step),
    AirSide.INSIDE: (BoreClearance, _at_bore),
}
