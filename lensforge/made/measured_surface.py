"""A measured surface against the design's: registration, form deviation, and the light of the lens with it.

The lens with the changed face and the design are simulated with the same rays.
"""

from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.cad.patch import Patch, fit_patch
from lensforge.errors import InputError
from lensforge.light.metrics import relative_square
from lensforge.light.simulation import TracedLens, TracedLight, traced_light
from lensforge.light.table_trace import Scene
from lensforge.made.measurement_result import (
    DeviationExtent,
    Pose,
    Registration,
    Side,
    SurfaceComparison,
    area_extent,
    surface_criteria,
)
from lensforge.made.registration import RigidMotion, distances, registered
from lensforge.results import Extent, Metric
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.ray_bundle import Source
from lensforge.spec.accuracy import Preset
from lensforge.surfaces.bicubic_table import grid_for, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface, to_sphere

_CHUNK = 8192
_RIDGES = np.logspace(-12, 2, 57)  # of the largest eigenvalue
_COVERAGE_DIRECTIONS = 2000


@dataclass(frozen=True)
class FormDeviation:
    """Radial deviation (mm) over direction as an SRBF sum of offset 0, and the rms residual (mm) of the fit."""

    surface: SrbfSurface
    residual_rms_mm: float


def fit_deviation(
    basis: SrbfBasis, directions: Float[np.ndarray, "n 3"], deviations: Float[np.ndarray, " n"]
) -> FormDeviation:
    """Fit radial ``deviations`` (mm) at unit ``directions`` by the functions of ``basis``, without its symmetry.

    Ridge regression, its strength by generalised cross-validation (Golub, Heath and Wahba, Technometrics 21, 1979):
    the noise of the points decides how much of the detail is kept.
    """
    free = SrbfBasis(basis.levels, basis.sigma_c)
    moments, load, total = np.zeros((free.size, free.size)), np.zeros(free.size), float(np.sum(deviations**2))
    for rows in np.split(np.arange(len(directions)), range(_CHUNK, len(directions), _CHUNK)):
        values = free.evaluate(directions[rows])
        moments += values.T @ values
        load += values.T @ deviations[rows]
    eigenvalues, vectors = np.linalg.eigh(moments)
    eigenvalues, turned = np.maximum(eigenvalues, 0.0), vectors.T @ load
    ridge = _best_ridge(eigenvalues, turned, total, len(directions))
    weights = vectors @ (turned / (eigenvalues + ridge))
    surface = SrbfSurface(free, weights, 0.0)
    residual = deviations - surface.radius(directions)
    return FormDeviation(surface, float(np.sqrt(np.mean(residual**2))))


def _best_ridge(
    eigenvalues: Float[np.ndarray, " m"], turned: Float[np.ndarray, " m"], total: float, count: int
) -> float:
    """Ridge with the least ``RSS / (n - degrees of freedom)^2``."""
    ridges = _RIDGES[:, None] * eigenvalues.max()
    kept = eigenvalues / (eigenvalues + ridges)
    explained = turned**2 / (eigenvalues + ridges)
    rss = np.maximum(total - np.sum(explained * (2.0 - kept), axis=1), 1e-14 * total)
    freedom = count - kept.sum(axis=1)
    score = np.where(freedom > 0.0, rss / np.maximum(freedom, 1.0) ** 2, np.inf)
    return float(ridges[np.argmin(score), 0])


def coverage(directions: Float[np.ndarray, "n 3"], reach_rad: float) -> float:
    """Share of the hemisphere that has a measured point within ``reach_rad``; elsewhere the design is assumed."""
    chord = 2.0 * np.sin(0.5 * reach_rad)
    nearest, _ = cKDTree(directions).query(fibonacci_hemisphere(_COVERAGE_DIRECTIONS), distance_upper_bound=chord)
    return float(np.isfinite(nearest).mean())


_MAP_PIXELS = 201


@dataclass(frozen=True)
class FacePixels:
    """Pixels of the chart inside the rim: their area (mm^2), and maps of radial changes along the normal (um)."""

    axis: Float[np.ndarray, " m"]
    area_mm2: Float[np.ndarray, "m m"]
    directions: Float[np.ndarray, "k 3"]
    cosine: Float[np.ndarray, " k"]

    @staticmethod
    def of(patch: Patch) -> "FacePixels":
        """Pixels of the face of ``patch``."""
        axis = np.linspace(-1.0, 1.0, _MAP_PIXELS)
        chart = np.stack(np.meshgrid(axis, axis), axis=-1)
        inside = np.sum(chart**2, axis=-1) <= 1.0
        jet, directions = patch.jet(chart[inside]), to_sphere(chart[inside])
        area = np.full(inside.shape, np.nan)
        area[inside] = jet.area_element * (axis[1] - axis[0]) ** 2
        return FacePixels(axis, area, directions, np.sum(jet.normal * directions, axis=1))

    def map_um(self, change: Surface) -> Float[np.ndarray, "m m"]:
        """A radial change along the normal (um), [Y, X], NaN outside the rim."""
        values = np.full(self.area_mm2.shape, np.nan)
        values[np.isfinite(self.area_mm2)] = 1e3 * self.cosine * change.radius(self.directions)
        return values

    def extent_um(self, change: Surface) -> Extent:
        """Largest absolute value and rms over the area of a radial change, along the normal (um)."""
        return area_extent(self.map_um(change), self.area_mm2)


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
