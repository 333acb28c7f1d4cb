"""Measurements of one face: best-fit sphere, curvature, draft, and the reach of the ball cutter."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.shop.ball_cutter import largest_ball_mm, local_fit, reachable, residual_height_mm
from lensforge.shop.best_fit_sphere import VARIANTS, BestFitSphere, best_fit_sphere
from lensforge.shop.check_result import Curvature, Cutter, Draft, FaceName, FaceResult, Sphere
from lensforge.shop.face_samples import (
    FaceSamples,
    OpticalFace,
    fraction_below_draft,
    largest_tilt_rad,
    least_draft_rad,
    sample_face,
    undercut_fraction,
)

SAMPLE_NODES = 161  # odd, so that the apex is a node


@dataclass(frozen=True)
class FaceCheck:
    """One face, its best-fit sphere, and the reach of a ball cutter of ``cutter_radius_mm``."""

    name: FaceName
    samples: FaceSamples
    sphere: BestFitSphere
    lowest_curvature: float  # 1/mm, searched between the samples too, as the next
    highest_curvature: float
    cutter_radius_mm: float
    ball_mm: Float[np.ndarray, " k"]
    residual_mm: Float[np.ndarray, " k"]

    @property
    def reached(self) -> Bool[np.ndarray, " k"]:
        """True where the cutter touches the face without gouging it elsewhere."""
        return reachable(self.ball_mm, self.cutter_radius_mm)

    @property
    def reachable_fraction(self) -> float:
        """Share of the area that the cutter reaches."""
        return self.samples.fraction(self.reached)

    @property
    def smallest_concave_radius_mm(self) -> float:
        """Smallest concave radius (mm); infinite for a face that is convex everywhere."""
        return -1.0 / self.lowest_curvature if self.lowest_curvature < 0.0 else np.inf

    @property
    def largest_cutter_mm(self) -> float:
        """Radius (mm) of the largest ball that reaches the whole face; infinite where any ball does."""
        return min(self.smallest_concave_radius_mm, float(self.ball_mm.min()))


def check_face(name: FaceName, face: OpticalFace, cutter_radius_mm: float, nodes: int = SAMPLE_NODES) -> FaceCheck:
    """Measure ``face`` on a chart grid of ``nodes`` x ``nodes``."""
    samples = sample_face(face, nodes)
    ball = largest_ball_mm(samples)
    return FaceCheck(
        name=name,
        samples=samples,
        sphere=best_fit_sphere(samples),
        lowest_curvature=samples.lowest_curvature(),
        highest_curvature=samples.highest_curvature(),
        cutter_radius_mm=cutter_radius_mm,
        ball_mm=ball,
        residual_mm=residual_height_mm(samples, ball, cutter_radius_mm),
    )


def face_result(check: FaceCheck) -> FaceResult:
    """The record of a measured face; an infinite number is None."""
    samples = check.samples
    least_rad = least_draft_rad(samples)
    others = (best_fit_sphere(samples, variant) for variant in VARIANTS if variant != check.sphere.variant)
    return FaceResult(
        best_fit_sphere=_sphere(check.sphere),
        other_spheres=tuple(_sphere(sphere) for sphere in others),
        curvature=Curvature(
            kappa_min_per_mm=check.lowest_curvature,
            kappa_max_per_mm=check.highest_curvature,
            smallest_concave_radius_mm=bounded(check.smallest_concave_radius_mm),
        ),
        cutter=_cutter(check),
        draft_deg=Draft(
            min=float(np.degrees(least_rad)),
            area_fraction_below_half=_fraction_below(samples, least_rad, 0.5),
            area_fraction_below_two=_fraction_below(samples, least_rad, 2.0),
        ),
        undercut_fraction=undercut_fraction(samples) if least_rad < 0.0 else 0.0,
        largest_tilt_deg=float(np.degrees(largest_tilt_rad(samples))),
        area_mm2=samples.area.total_mm2,
    )


def _fraction_below(samples: FaceSamples, least_rad: float, draft_deg: float) -> float:
    """Share of the area below a draft; the rule of the area draws slopes on to the rim, where ``least_rad`` decides."""
    limit_rad = float(np.deg2rad(draft_deg))
    return fraction_below_draft(samples, limit_rad) if least_rad < limit_rad else 0.0


def bounded(value: float) -> float | None:
    """``value``, or None where it is infinite or not a number."""
    return float(value) if np.isfinite(value) else None


def _sphere(sphere: BestFitSphere) -> Sphere:
    x, y, z = sphere.centre_mm.tolist()
    return Sphere(
        variant=sphere.variant,
        radius_mm=sphere.radius_mm,
        centre_mm=(x, y, z),
        pv_mm=sphere.pv_mm,
        rms_mm=sphere.rms_mm,
        slope_departure_mrad=1e3 * sphere.largest_slope,
    )


def _cutter(check: FaceCheck) -> Cutter:
    return Cutter(
        radius_mm=check.cutter_radius_mm,
        reachable_fraction=check.reachable_fraction,
        local_ok_fraction=check.samples.fraction(local_fit(check.samples, check.cutter_radius_mm)),
        largest_radius_mm=bounded(check.largest_cutter_mm),
        residual_mm=bounded(float(check.residual_mm.max())),
    )
