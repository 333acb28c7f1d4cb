"""Everything that is measured on one face, and its part of check.json."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from lensforge.manufacturing.best_fit_sphere import VARIANTS, BestFitSphere, best_fit_sphere
from lensforge.manufacturing.curvature import smallest_curvature
from lensforge.manufacturing.cutter import largest_ball_mm, local_fit, reachable
from lensforge.manufacturing.draft import draft_rad, largest_tilt_rad, undercut_fraction
from lensforge.manufacturing.face import OpticalFace
from lensforge.manufacturing.residual import residual_height_mm
from lensforge.manufacturing.sampling import FaceSamples, sample_face

SAMPLE_NODES = 161  # odd, so that the apex is a node

FaceName = Literal["inner", "outer"]


@dataclass(frozen=True)
class FaceCheck:
    """One face, its best-fit sphere, and how a ball cutter of ``cutter_radius_mm`` fares on it."""

    name: FaceName
    samples: FaceSamples
    sphere: BestFitSphere
    lowest_curvature: float  # 1/mm, searched between the samples too
    cutter_radius_mm: float
    ball_mm: Float[np.ndarray, " k"]
    residual_mm: Float[np.ndarray, " k"]

    @property
    def reached(self) -> Bool[np.ndarray, " k"]:
        """Where the cutter touches the face without gouging it elsewhere."""
        return reachable(self.ball_mm, self.cutter_radius_mm)

    @property
    def reachable_fraction(self) -> float:
        """The part of the area that the cutter reaches."""
        return self.samples.fraction(self.reached)

    @property
    def smallest_concave_radius_mm(self) -> float:
        """Radius (mm) of the tightest hollow; infinite for a face without any."""
        return -1.0 / self.lowest_curvature if self.lowest_curvature < 0.0 else np.inf

    @property
    def largest_cutter_mm(self) -> float:
        """The largest ball (mm) that reaches the whole face; infinite where any ball does."""
        return min(self.smallest_concave_radius_mm, float(self.ball_mm.min()))


def check_face(name: FaceName, face: OpticalFace, cutter_radius_mm: float, nodes: int = SAMPLE_NODES) -> FaceCheck:
    """Measure ``face`` on a chart grid of ``nodes`` x ``nodes``."""
    samples = sample_face(face, nodes)
    sharpest = samples.chart[int(np.argmin(samples.curvatures.minimum))]
    ball = largest_ball_mm(samples)
    return FaceCheck(
        name=name,
        samples=samples,
        sphere=best_fit_sphere(samples),
        lowest_curvature=smallest_curvature(face, sharpest, samples.grid.step),
        cutter_radius_mm=cutter_radius_mm,
        ball_mm=ball,
        residual_mm=residual_height_mm(samples, ball, cutter_radius_mm),
    )


def face_json(check: FaceCheck) -> dict[str, Any]:
    """The face's object in check.json; an unbounded number is null, with a ``note`` beside it."""
    samples = check.samples
    draft = np.degrees(draft_rad(samples))
    others = (best_fit_sphere(samples, variant) for variant in VARIANTS if variant != check.sphere.variant)
    return {
        "best_fit_sphere": _sphere_json(check.sphere),
        "other_spheres": [_sphere_json(sphere) for sphere in others],
        "curvature": _curvature_json(check),
        "cutter": _cutter_json(check),
        "draft_deg": {
            "min": float(draft.min()),
            "area_fraction_below_0.5": samples.fraction(draft < 0.5),
            "area_fraction_below_2": samples.fraction(draft < 2.0),
        },
        "undercut_fraction": undercut_fraction(samples),
        "largest_tilt_deg": float(np.degrees(largest_tilt_rad(samples))),
        "area_mm2": float(samples.areas.sum()),
    }


def _sphere_json(sphere: BestFitSphere) -> dict[str, Any]:
    return {
        "variant": sphere.variant,
        "radius_mm": sphere.radius_mm,
        "centre_mm": sphere.centre_mm.tolist(),
        "pv_mm": sphere.pv_mm,
        "rms_mm": sphere.rms_mm,
        "slope_departure_mrad": 1e3 * float(sphere.slope_departure.max()),
    }


def _curvature_json(check: FaceCheck) -> dict[str, Any]:
    hollow = check.smallest_concave_radius_mm
    return {
        "kappa_min_per_mm": check.lowest_curvature,
        "kappa_max_per_mm": float(check.samples.curvatures.maximum.max()),
        **_finite("smallest_concave_radius_mm", hollow, "the face is convex everywhere"),
    }


def _cutter_json(check: FaceCheck) -> dict[str, Any]:
    largest, left = check.largest_cutter_mm, float(check.residual_mm.max())
    return {
        "radius_mm": check.cutter_radius_mm,
        "reachable_fraction": check.reachable_fraction,
        "local_ok_fraction": check.samples.fraction(local_fit(check.samples, check.cutter_radius_mm)),
        **_finite("largest_radius_mm", largest, "a ball of any radius reaches the whole face"),
        **_finite("residual_mm", left, "the cutter reaches nothing of the face"),
    }


def _finite(key: str, value: float, otherwise: str) -> dict[str, Any]:
    return {key: float(value)} if np.isfinite(value) else {key: None, f"{key}_note": otherwise}
