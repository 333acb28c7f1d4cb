"""A measured surface against the design's: registration, form deviation, and the light of the lens with it.

The lens with the changed face and the design are simulated with the same rays.
"""

from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Float

from lensforge.cad.patch import Patch, fit_patch
from lensforge.errors import InputError
from lensforge.light.metrics import relative_square
from lensforge.light.simulation import TracedLens, TracedLight, traced_light
from lensforge.light.table_trace import Scene
from lensforge.made.form_deviation import FacePixels, FormDeviation, coverage, fit_deviation
from lensforge.made.measurement_result import (
    DeviationExtent,
    Pose,
    Registration,
    Side,
    SurfaceComparison,
    surface_criteria,
)
from lensforge.made.registration import RigidMotion, distances, registered
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.ray_bundle import Source
from lensforge.spec.accuracy import Preset
from lensforge.surfaces.bicubic_table import grid_for, tabulate
from lensforge.surfaces.srbf import SrbfBasis
from lensforge.surfaces.surface import Surface

# A change is a thousandth of the radius: five nodes for its shortest wave keep its slopes to some hundredths.
_WIDER = 2.0


@dataclass(frozen=True)
class ChangedLens:
    """Simulation of a lens with changed radii on one ``side``, always with the same rays."""

    lens: Lens
    side: Side
    source: Source
    nodes_per_sigma: float
    rays: int

    def lights(self, *changes: Surface | None) -> list[TracedLight]:
        """Light of the lens with each of ``changes`` (mm) added to the radius; None: the design."""
        details = [_WIDER * change.detail_rad for change in changes if change is not None]
        grid = grid_for(min(self.lens.detail_rad, *details), self.nodes_per_sigma)
        tables = {name: tabulate(grid, getattr(self.lens, name)) for name in ("inner", "outer")}
        scene, found = Scene(self.lens.media, grid), []
        for change in changes:
            own = dict(tables)
            if change is not None:
                own[self.side] = own[self.side] + tabulate(grid, change)  # tables are linear in the radius
            traced = TracedLens(scene, own["inner"], own["outer"], {})
            found.append(traced_light(traced, self.lens.spec, self.source, self.rays, self.lens.seed))
        return found


_MOST_RAYS = 2**20


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
    rays: int,
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
    traced = ChangedLens(lens, side, source, preset.evaluate_nodes_per_sigma, rays)
    before, after = traced.lights(None, form.deviation.surface)
    section, receiver = lens.spec.all_receivers[0], receivers_of(lens.spec, lens.spec.evaluate.pixels)[0]
    pixels = FacePixels.of(patch)
    form_um = pixels.map_um(form.deviation.surface)
    inside = np.isfinite(form_um)
    return SurfaceComparison(
        inputs={"lens": lens.sha256},
        surface=side,
        registration=registration,
        point_count=len(cloud),
        used_share=form.used,
        covered_share=form.covered,
        pose=pose_of(form.motion),
        point_deviation_um=DeviationExtent.of(1e3 * form.distances),
        form_deviation_um=DeviationExtent.of(form_um[inside], pixels.area_mm2[inside]),
        residual_rms_um=1e3 * form.deviation.residual_rms_mm,
        rays=rays,
        receiver=section.name or section.kind,
        far_field=section.kind == "far_field",
        width=receiver.grid.width,
        height=receiver.grid.height,
        design=before.metrics,
        measured=after.metrics,
        change=after.replicates.change_from(before.replicates, rays),
        nmse_between=relative_square(np.stack([after.map, before.map])),
        criteria=surface_criteria(form.used, form.covered),
        points=form.points,
        distance_um=1e3 * form.distances,
        chart=pixels.axis,
        deviation_um=form_um,
        area_mm2=pixels.area_mm2,
        irradiance_design=before.map,
        irradiance_measured=after.map,
    )


def measure_form(
    patch: Patch, basis: SrbfBasis, cloud: Float[np.ndarray, "k 3"], registration: Registration = "rigid"
) -> Form:
    """Register ``cloud`` (mm) to the surface of ``patch``, and fit its radial deviation by ``basis``."""
    placed = registered(patch, cloud, registration)
    radius = np.linalg.norm(placed.points, axis=1)
    directions = placed.points / radius[:, None]
    return Form(
        motion=placed.motion,
        points=placed.points,
        distances=distances(patch, placed.points)[0],
        deviation=fit_deviation(basis, directions, radius - patch.radius(directions)),
        used=placed.share,
        covered=coverage(directions, float(basis.sigmas.min())),
    )


def default_rays(lens: Lens, preset: Preset) -> int:
    """Number of rays where the caller names none: those of the evaluation, at most 2^20."""
    return min(lens.spec.evaluate.rays or preset.evaluate_rays, _MOST_RAYS)


def pose_of(motion: RigidMotion) -> Pose:
    """The record of a motion."""
    rotation = np.degrees([motion.rotation_rad, motion.rotation_error_rad])
    translation = np.array([motion.translation_mm, motion.translation_error_mm])
    return Pose(
        **{f"rotation_{axis}_deg": _fitted(pair, "deg") for axis, pair in zip("xyz", rotation.T, strict=True)},
        **{f"translation_{axis}_mm": _fitted(pair, "mm") for axis, pair in zip("xyz", translation.T, strict=True)},
    )


def _fitted(pair: Float[np.ndarray, "2"], unit: str) -> Metric:
    """Parameter of the motion and its error, left out where it is 0 (not fitted) or infinite (not determined)."""
    value, error = pair
    known = 0.0 < error < np.inf
    return Metric(value=float(value), unit=unit, standard_error=float(error) if known else None)
