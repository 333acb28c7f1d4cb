"""Measurements of one face: best-fit sphere, curvature, draft, and of one that is milled the reach of the ball cutter.

The best-fit sphere is that of least squares over the area, its centre on the axis; of a face that is drawn along y it
is a cylinder, its axis along y through the z axis. A deviation is measured along the sphere's normal, ``|P - c| - R``:
positive where the face is farther from the centre than the sphere. Along z it would diverge at the steep rim of a
hemisphere.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from lensforge.cad.part_limits import ANGLE_TOLERANCE_DEG
from lensforge.results.verdict import within
from lensforge.shop.axis_tilt import free_tilt_deg, needed_tilt_deg
from lensforge.shop.ball_cutter import largest_ball_mm, reachable, residual_height_mm
from lensforge.shop.check_measures import FLAT_MM, Curvature, Cutter, Draft, FaceResult, Sphere
from lensforge.shop.face_samples import FaceArea, FaceSamples, OpticalFace, all_points, least_draft_rad, sample_face
from lensforge.spec import Spec
from lensforge.spec.accuracy import PartEffort

SAMPLE_NODES = PartEffort().check_nodes


@dataclass(frozen=True)
class FaceCheck:
    """One face, whether it is cut or not; ``residual_mm``: height left uncut at each sample."""

    samples: FaceSamples
    sphere: Sphere
    lowest_curvature: float  # 1/mm, searched between the samples too, as the next
    highest_curvature: float
    residual_mm: Float[np.ndarray, " k"]

    @property
    def cutter(self) -> Cutter | None:
        """The record of the tool that cuts it; None if nothing does."""
        return None

    @property
    def smallest_concave_radius_mm(self) -> float:
        """Smallest concave radius (mm); infinite for a face that is convex or flat everywhere."""
        return -1.0 / self.lowest_curvature if self.lowest_curvature < -1.0 / FLAT_MM else np.inf

    def worst_places(self) -> dict[str, Float[np.ndarray, "3"]]:
        """Samples (mm) at which each finding is worst, by the name of the finding."""
        steepest = self.samples.points[np.argmin(self.samples.upward)]
        return {"tilt": steepest, "draft": steepest}

    @property
    def sag_mm(self) -> Float[np.ndarray, " k"]:
        """Deviation (mm) of each sample from the best-fit sphere."""
        distances = self.samples.face.distances(self.samples.points, np.array(self.sphere.centre_mm))
        return distances - self.sphere.radius_mm


@dataclass(frozen=True)
class MilledFace(FaceCheck):
    """One face, and the reach of a ball cutter of ``cutter_radius_mm``."""

    cutter_radius_mm: float
    ball_mm: Float[np.ndarray, " k"]

    @property
    def cutter(self) -> Cutter:
        """The record of the ball on it."""
        return Cutter(
            radius_mm=self.cutter_radius_mm,
            reachable_fraction=self.samples.fraction(self.reached),
            largest_radius_mm=bounded(self.largest_cutter_mm),
            residual_mm=bounded(float(self.residual_mm.max())),
        )

    @property
    def reached(self) -> Bool[np.ndarray, " k"]:
        """True where the cutter touches the face without gouging it elsewhere."""
        return reachable(self.ball_mm, self.cutter_radius_mm)

    def worst_places(self) -> dict[str, Float[np.ndarray, "3"]]:
        """Worst samples, that of the smallest ball among them."""
        return super().worst_places() | {"cutter": self.samples.points[np.argmin(self.ball_mm)]}

    @property
    def largest_cutter_mm(self) -> float:
        """Radius (mm) of the largest ball that reaches the whole face; infinite where any ball does."""
        return min(self.smallest_concave_radius_mm, float(self.ball_mm.min()))


def measured_face(face: OpticalFace, nodes: int = SAMPLE_NODES) -> FaceCheck:
    """Measure ``face`` on a chart grid of ``nodes`` x ``nodes``."""
    samples = sample_face(face, nodes)
    lowest = samples.lowest_curvature()
    highest = samples.highest_curvature()
    return FaceCheck(samples, best_fit_sphere(samples), lowest, highest, np.zeros(len(samples.points)))


def milled_face(face: OpticalFace, cutter_radius_mm: float, nodes: int = SAMPLE_NODES) -> MilledFace:
    """Measure ``face`` on a chart grid of ``nodes`` x ``nodes``, and what the ball reaches of it."""
    measured = measured_face(face, nodes)
    samples = measured.samples
    ball = largest_ball_mm(samples, all_points(face, nodes) if face.beside else None)
    left_mm = residual_height_mm(samples, ball, cutter_radius_mm)
    return MilledFace(**{**vars(measured), "residual_mm": left_mm}, cutter_radius_mm=cutter_radius_mm, ball_mm=ball)


def face_result(check: FaceCheck, spec: Spec) -> FaceResult:
    """The record of a measured face of a lens of ``spec``, with None for an infinite number."""
    samples = check.samples
    layer_um = spec.manufacture.layer_um
    is_milled = isinstance(check, MilledFace) and spec.manufacture.cuts == "lens"
    draft_deg = float(np.degrees(least_draft_rad(check.samples)))
    curvatures = samples.curvatures
    to_map = samples.grid.to_map
    return FaceResult(
        best_fit_sphere=check.sphere,
        curvature=Curvature(
            kappa_min_per_mm=check.lowest_curvature,
            kappa_max_per_mm=check.highest_curvature,
            smallest_concave_radius_mm=bounded(check.smallest_concave_radius_mm),
        ),
        cutter=check.cutter,
        layer_step_um=None if layer_um is None else layer_um * _most_level(samples),  # the highest where it is level
        draft_deg=Draft(min=draft_deg),
        undercut_fraction=0.0 if within(draft_deg, ">=", 0.0, ANGLE_TOLERANCE_DEG) else samples.area.undercut_fraction,
        largest_tilt_deg=needed_tilt_deg(samples),
        free_tilt_deg=free_tilt_deg(samples, spec) if is_milled else None,
        area_mm2=samples.area.total_mm2,
        xyz=to_map(samples.points),
        sag_mm=to_map(check.sag_mm),
        kappa_min=to_map(curvatures.minimum),
        kappa_max=to_map(curvatures.maximum),
        residual_mm=to_map(check.residual_mm),
    )


def _most_level(samples: FaceSamples) -> float:
    """Largest cosine between the face's normal and the axis."""
    patch = samples.face.patch
    return samples.largest(lambda points: np.abs(patch.normals(points)[:, 2]), np.abs(samples.normals[:, 2]))


def bounded(value: float) -> float | None:
    """``value``, or None if it is infinite or not a number."""
    return float(value) if np.isfinite(value) else None


def best_fit_sphere(samples: FaceSamples) -> Sphere:
    """Fit the sphere to a face, or a cylinder to one that is drawn along y.

    Its extreme departures are searched for between the samples too.
    """
    area = samples.area
    face = samples.face
    centre = _least_squares_centre(area)
    from_area = face.distances(area.points, centre)
    radius = float(area.shares @ from_area)

    def beyond(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        return face.distances(face.patch.points(points), centre) - radius

    at_samples = face.distances(samples.points, centre) - radius
    highest = samples.largest(beyond, at_samples)
    lowest = -samples.largest(lambda c: -beyond(c), -at_samples)
    return Sphere(
        radius_mm=radius,
        centre_mm=tuple(centre.tolist()),
        pv_mm=highest - lowest,
        rms_mm=float(np.sqrt(area.shares @ (from_area - radius) ** 2)),
    )


def _least_squares_centre(area: FaceArea) -> Float[np.ndarray, "3"]:
    """Centre on the axis (variable projection: for any centre the best radius is the mean distance over the area)."""
    shares = area.shares
    root = np.sqrt(shares)
    x, y, z = area.points.T
    from_axis_2 = x**2 + y**2

    def residual(height: Float[np.ndarray, "1"]) -> Float[np.ndarray, " q"]:
        distance = np.sqrt(from_axis_2 + (z - height) ** 2)
        return np.asarray(root * (distance - shares @ distance))

    def slope(height: Float[np.ndarray, "1"]) -> Float[np.ndarray, "q 1"]:
        below = z - height
        towards = -below / np.sqrt(from_axis_2 + below**2)
        return np.asarray(root * (towards - shares @ towards))[:, None]

    scale = float(np.linalg.norm(area.points, axis=1).mean())
    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    # Between a centre below the face and one beyond it the departure is largest: the least is sought from either side.
    starts = (np.zeros(1), np.full(1, 3.0 * scale))
    fits = [least_squares(residual, start, slope, method="lm", x_scale=scale, **tight) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost))
    return np.array([0.0, 0.0, float(best.x[0])])
