"""A measured surface against the design's: registration, form deviation, and the light of the lens with it."""

from dataclasses import dataclass
from typing import get_args

import numpy as np
import torch
from jaxtyping import Float

from lensforge.accuracy import Preset
from lensforge.errors import InputError
from lensforge.evaluation.evaluate import evaluate_traced
from lensforge.evaluation.light import LightMetrics
from lensforge.evaluation.metrics import relative_square
from lensforge.evaluation.simulate import TracedLens
from lensforge.geometry.patch import Patch, fit_patch
from lensforge.lens import Lens
from lensforge.measurement.comparison import (
    DeviationExtent,
    Pose,
    Registration,
    Side,
    SurfaceComparison,
    surface_criteria,
)
from lensforge.measurement.deviation import FormDeviation, coverage, fit_deviation
from lensforge.measurement.point_cloud import RigidMotion, distances, over_surface, register
from lensforge.sources.bundle import Source
from lensforge.surfaces.chart import to_sphere
from lensforge.surfaces.spline import tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

_MOST_RAYS = 2**20
_MAP_PIXELS = 201


@dataclass(frozen=True)
class Form:
    """The measured surface in lens coordinates: motion, registered points and distances (mm), and the fit.

    ``used``: share of the points over the surface; ``covered``: share of the surface that was measured.
    """

    motion: RigidMotion
    points: Float[np.ndarray, "n 3"]
    distances: Float[np.ndarray, " n"]
    deviation: FormDeviation
    used: float
    covered: float


def compare_surface(
    cloud: Float[np.ndarray, "k 3"],
    *,
    lens: Lens,
    side: Side,
    source: Source,
    preset: Preset,
    rays: int | None = None,
    registration: Registration = "rigid",
) -> SurfaceComparison:
    """Register ``cloud`` (mm) to one surface of ``lens``, map its form deviation, and simulate the lens with it.

    Deviations are along the normal, positive away from the origin: too much material on the outer surface, too little
    on the inner one. The motion that ``registration`` allows is removed, the rest is form; the other surface is the
    design's. Raises :class:`InputError` for points that cannot be registered, and for an unknown ``registration``.
    """
    if registration not in get_args(Registration):
        raise InputError(f"registration = {registration!r}: must be one of {', '.join(get_args(Registration))}")
    patch = fit_patch(getattr(lens, side))
    form = measure_form(patch, lens.basis, cloud, registration)
    count = rays or default_rays(lens, preset)
    design = TracedLens.of(lens, preset.evaluate_nodes_per_sigma)
    measured = _with_deviation(design, side, form.deviation.surface)
    before, after = (evaluate_traced(lens_, lens.spec, source, count, lens.seed) for lens_ in (design, measured))
    chart, height = _map(patch, form.deviation.surface)
    return SurfaceComparison(
        inputs={"lens": lens.sha256},
        surface=side,
        registration=registration,
        point_count=len(cloud),
        used_share=form.used,
        covered_share=form.covered,
        pose=pose_of(form.motion),
        point_deviation_um=_extent(1e3 * form.distances),
        form_deviation_um=_extent(height[np.isfinite(height)]),
        residual_rms_um=1e3 * form.deviation.residual_rms_mm,
        rays=count,
        receiver=before.first.name,
        far_field=before.first.kind == "far_field",
        width=before.first.width,
        height=before.first.height,
        design=LightMetrics.of(before),
        measured=LightMetrics.of(after),
        nmse_between=relative_square(np.stack([after.map, before.map])),
        criteria=surface_criteria(form.used, form.covered),
        points=form.points,
        distance_um=1e3 * form.distances,
        chart=chart,
        deviation_um=height,
        irradiance_design=before.map,
        irradiance_measured=after.map,
    )


def measure_form(
    patch: Patch, basis: SrbfBasis, cloud: Float[np.ndarray, "k 3"], registration: Registration = "rigid"
) -> Form:
    """Register ``cloud`` (mm) to the surface of ``patch``, and fit its radial deviation by ``basis``."""
    motion = register(patch, cloud, registration)
    placed = motion.apply(cloud)
    over = over_surface(placed)
    points = placed[over]
    radius = np.linalg.norm(points, axis=1)
    directions = points / radius[:, None]
    return Form(
        motion=motion,
        points=points,
        distances=distances(patch, points)[0],
        deviation=fit_deviation(basis, directions, radius - patch.radius(directions)),
        used=float(over.mean()),
        covered=coverage(directions, float(basis.sigmas.min())),
    )


def default_rays(lens: Lens, preset: Preset) -> int:
    """Number of rays where the caller names none: those of the evaluation, at most 2^20."""
    return min(lens.spec.evaluate.rays or preset.evaluate_rays, _MOST_RAYS)


def _with_deviation(design: TracedLens, side: Side, deviation: SrbfSurface) -> TracedLens:
    """The design with the deviation added to one table: tables are linear in the radius."""
    tables = {"inner": design.inner, "outer": design.outer}
    tables[side] = tables[side] + torch.from_numpy(tabulate(design.scene.grid, deviation))
    return TracedLens(design.scene, tables["inner"], tables["outer"], design.table_error_nm)


def _map(patch: Patch, deviation: SrbfSurface) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
    """Deviation along the normal (um) over the chart's disc, [Y, X], NaN outside; and the chart's axis."""
    axis = np.linspace(-1.0, 1.0, _MAP_PIXELS)
    chart = np.stack(np.meshgrid(axis, axis), axis=-1)
    inside = np.sum(chart**2, axis=-1) <= 1.0
    directions = to_sphere(chart[inside])
    cosine = np.sum(patch.normals(chart[inside]) * directions, axis=1)
    height = np.full(inside.shape, np.nan)
    height[inside] = 1e3 * deviation.radius(directions) * cosine
    return axis, height


def pose_of(motion: RigidMotion) -> Pose:
    """The record of a motion."""
    return Pose(
        rotation_deg=_triple(np.degrees(motion.rotation_rad)),
        rotation_standard_error_deg=_triple(np.degrees(motion.rotation_error_rad)),
        translation_mm=_triple(motion.translation_mm),
        translation_standard_error_mm=_triple(motion.translation_error_mm),
    )


def _triple(vector: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])


def _extent(values: Float[np.ndarray, " n"]) -> DeviationExtent:
    return DeviationExtent(
        pv=float(np.ptp(values)),
        rms=float(np.sqrt(np.mean(values**2))),
        min=float(values.min()),
        max=float(values.max()),
    )
