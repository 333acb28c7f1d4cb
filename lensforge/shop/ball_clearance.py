"""Clearance of the ball at the base: near the rim the ball extends below z = 0, where it may hit the base.

The measures say how far a built-in base must be cut back for the ball to touch a sample. A custom base, from a STEP
file, is represented by its mesh; CAD and mesh libraries load only where a spec has one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.cad.custom_base import read_custom_base, tessellated
from lensforge.cad.cutter_room import ball_centres_mm, largest_wall_mm, needed_step_mm, smallest_bore_mm
from lensforge.cad.part_limits import FORM_LIMIT_NM
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan
from lensforge.shop.ball_cutter import LEAF
from lensforge.shop.check_result import BallClearance, BaseBall, CustomBaseClearance, InnerClearance, OuterClearance
from lensforge.shop.face_check import FaceCheck
from lensforge.shop.face_samples import FaceSamples, OpticalFace

# At the rim of a hemisphere the ball touches the bore's wall exactly, up to the form error.
_CLEAR_MM = 1e-6 * FORM_LIMIT_NM
_RIM_POINTS = 4096
_BASE_CHORD_MM = 1e-3  # between the mesh and the curved faces of a custom base
_BASE_POINTS, _SEED = 4000, 0
_LARGEST_BALL = 20.0  # in face radii: as good as a plane
_BALL_WITHIN, _MOST_BALLS = 0.005, 12  # relative, of the base's largest ball; balls that are tried for it

_FaceClearance = TypeVar("_FaceClearance", OuterClearance, InnerClearance, CustomBaseClearance)


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


def wall_retreat_mm(face: FaceSamples, cutter_radius_mm: float, depth_mm: float) -> Float[np.ndarray, " k"]:
    """Width (mm) by which a wall straight down from the face's rim, to ``depth_mm``, enters the ball at each sample.

    Valid for samples that the ball reaches on the face itself: a centre above z = 0 is then at least R from the rim. A
    centre below, where the cavity narrows upwards or the outer rim is undercut, must be R away from the wall.
    """
    centres = face.points + cutter_radius_mm * face.normals
    below = np.maximum(-centres[:, 2] - depth_mm, 0.0)
    low = (centres[:, 2] < 0.0) & (below < cutter_radius_mm)
    retreat = np.zeros(len(centres))
    if low.any():
        across = np.sqrt(cutter_radius_mm**2 - below[low] ** 2)
        retreat[low] = across - _distance_to_rim(face.face, centres[low, :2])
    return np.where(retreat > _CLEAR_MM, retreat, 0.0)


def _distance_to_rim(face: OpticalFace, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Distance (mm) in the plane z = 0 to the face's rim."""
    distance, _ = cKDTree(_rim_mm(face)[:, None] * _turn(), leafsize=LEAF).query(points)
    nearest: Float[np.ndarray, " n"] = distance
    return nearest


def _rim_mm(face: OpticalFace) -> Float[np.ndarray, " n"]:
    """Distance (mm) of the rim from the axis, all around."""
    return face.radius(_turn())


def _turn() -> Float[np.ndarray, "n 2"]:
    azimuth = np.linspace(0.0, 2.0 * np.pi, _RIM_POINTS, endpoint=False)
    return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


def check_ball_clearance(
    plan: Plan[Patch] | None, custom: CustomBaseMesh | None, cutter_mm: float, inner: FaceCheck, outer: FaceCheck
) -> BallClearance:
    """Clearance that the cutter lacks at the base, over the samples that it could reach without the base, and its ball.

    ``plan``: the body with its base, None for a mould insert; ``custom``: the base from a STEP file, if there is one.
    """
    if custom is not None:
        at_base = partial(_at_custom, custom)
        return BallClearance(
            outer=_with_ball(at_base, outer, cutter_mm),
            inner=_with_ball(at_base, inner, cutter_mm),
        )
    if plan is None or not plan.has_base:
        note = "a mould insert has no base" if plan is None else "there is no base"
        return BallClearance(outer=None, inner=None, note=note)
    return BallClearance(
        outer=_with_ball(partial(_outer_clearance, plan), outer, cutter_mm),
        inner=_with_ball(partial(_inner_clearance, plan), inner, cutter_mm),
    )


def _with_ball(
    measured: Callable[[FaceCheck, float], _FaceClearance], face: FaceCheck, cutter_mm: float
) -> _FaceClearance:
    """The clearance of the cutter's ball at one face, and the largest ball that the base clears there.

    Up to the face's own largest ball every sample is reached, and a larger ball that touches a sample holds the
    smaller one: whatever is in the way of that is in its way too, and bisection finds the largest.
    """
    found = measured(face, cutter_mm)
    highest = min(face.largest_cutter_mm, _LARGEST_BALL * float(np.linalg.norm(face.samples.points, axis=1).max()))

    def clears(radius_mm: float) -> bool:
        return measured(replace(face, cutter_radius_mm=radius_mm), radius_mm).needed_mm == 0.0

    if clears(highest):
        return found.model_copy(update={"ball": BaseBall(radius_mm=None)})
    low, high = 0.0, highest
    if cutter_mm < highest:
        low, high = (cutter_mm, highest) if found.needed_mm == 0.0 else (0.0, cutter_mm)
    for _ in range(_MOST_BALLS):
        if high - low <= _BALL_WITHIN * high:
            break
        middle = float(np.sqrt(low * high)) if low > 0.0 else 0.5 * high
        low, high = (middle, high) if clears(middle) else (low, middle)
    return found.model_copy(update={"ball": BaseBall(radius_mm=low, within_mm=high - low)})


def _outer_clearance(plan: Plan[Patch], face: FaceCheck, cutter_mm: float) -> OuterClearance:
    distance, height = ball_centres_mm(face.samples.points, face.samples.normals, cutter_mm)

    def missing(base_mm: float, present_mm: float) -> Float[np.ndarray, " k"]:
        return np.maximum(needed_step_mm(distance, height, cutter_mm, base_mm) - present_mm, 0.0)

    base, present = plan.base, plan.relief_mm
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
    return OuterClearance(
        smallest_step_mm=_largest_reached(face, step),
        step_clearance_mm=_largest_reached(face, setback),
        flange_clearance_mm=_largest_reached(face, flange),
        flush_fraction=_clear(face, step, setback, flange),
    )


def _inner_clearance(plan: Plan[Patch], face: FaceCheck, cutter_mm: float) -> InnerClearance:
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
    return InnerClearance(
        bore_clearance_mm=_largest_reached(face, bore),
        pocket_diameter_mm=_largest_reached(face, pocket),
        flush_fraction=_clear(face, bore, pocket),
    )


def _at_custom(custom: CustomBaseMesh, face: FaceCheck, cutter_mm: float) -> CustomBaseClearance:
    retreat = custom.retreat_mm(face.samples, cutter_mm)
    return CustomBaseClearance(retreat_mm=_largest_reached(face, retreat), flush_fraction=_clear(face, retreat))


def _largest_reached(face: FaceCheck, retreat: Float[np.ndarray, " k"]) -> float | None:
    return float(retreat[face.reached].max()) if face.reached.any() else None


def _clear(face: FaceCheck, *retreats: Float[np.ndarray, " k"]) -> float:
    """Share of the face that the ball reaches, and over which nothing of the base must give way."""
    return face.samples.fraction(face.reached & np.all([retreat == 0.0 for retreat in retreats], axis=0))
