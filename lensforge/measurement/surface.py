"""``lensforge compare --points``: a measured surface against the design's, and the light that it would make."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float

from lensforge.accuracy import Preset
from lensforge.evaluation.evaluate import Evaluation, evaluate_traced
from lensforge.evaluation.simulate import TracedLens
from lensforge.files import replacing, write_json
from lensforge.gates import Gate
from lensforge.geometry.patch import Patch, fit_patch
from lensforge.lens import Lens
from lensforge.measurement.deviation import Deviation, coverage, fit_deviation
from lensforge.measurement.registration import Freedom, Pose, distances, over_surface, register
from lensforge.measurement.surface_figure import draw_surface
from lensforge.sources.bundle import Source
from lensforge.surfaces.chart import to_sphere
from lensforge.surfaces.spline import tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

Side = Literal["inner", "outer"]

_MOST_RAYS = 2**20
_MAP_PIXELS = 201
USED_SHARE = 0.9  # of the points must lie over the surface once registered
COVERED_SHARE = 0.8  # of the surface must be measured: elsewhere the design is assumed
_JUDGED = ("nmse", "uniformity", "rsd", "efficiency")


@dataclass(frozen=True)
class Form:
    """The measured surface in lens coordinates: pose, registered points (mm), their distance (mm), the smooth fit."""

    pose: Pose
    points: Float[np.ndarray, "n 3"]
    distances: Float[np.ndarray, " n"]
    deviation: Deviation
    used: float
    covered: float


def compare_surface(
    cloud: Float[np.ndarray, "k 3"],
    directory: Path,
    *,
    lens: Lens,
    side: Side,
    source: Source,
    preset: Preset,
    rays: int | None = None,
    freedom: Freedom = "rigid",
) -> dict[str, Any]:
    """Register ``cloud`` (mm) to one surface of ``lens``, map its form deviation, and simulate the lens with it.

    Writes compare_<side>.json, .npz and .png. Deviations are along the normal, positive away from the origin: too much
    material on the outer surface, too little on the inner one. What ``freedom`` registers is taken out, and the rest is
    form; the other surface is the design's. Raises :class:`InputError` for points that cannot be registered.
    """
    patch = fit_patch(getattr(lens, side))
    form = measure_form(patch, lens.basis, cloud, freedom)
    count = rays or min(lens.spec.evaluate.rays or preset.evaluate_rays, _MOST_RAYS)
    design = TracedLens.of(lens, preset.judge_nodes_per_sigma)
    measured = _with_deviation(design, side, form.deviation.surface)
    before, after = (evaluate_traced(lens_, lens.spec, source, count, lens.seed) for lens_ in (design, measured))
    chart, height = _map(patch, form.deviation.surface)
    content = {
        "surface": side,
        "registration": freedom,
        "points": len(cloud),
        **_describe(form, height),
        "rays": count,
        "design": _judged(before),
        "measured": _judged(after),
        "nmse_between": float(np.sum((after.irradiance - before.irradiance) ** 2) / np.sum(before.irradiance**2)),
        "gates": [gate.to_json() for gate in _gates(form)],
    }
    arrays = {
        "points": form.points,
        "distance_um": 1e3 * form.distances,
        "chart": chart,
        "deviation_um": height,
        "irradiance_design": before.irradiance,
        "irradiance_measured": after.irradiance,
        "axis_mm": before.axis_mm,
    }
    stem = Path(directory) / f"compare_{side}"
    with replacing(stem.with_suffix(".npz")) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)
    with replacing(stem.with_suffix(".png")) as temporary:
        draw_surface(temporary, arrays, side)
    write_json(stem.with_suffix(".json"), content)
    return content


def measure_form(patch: Patch, basis: SrbfBasis, cloud: Float[np.ndarray, "k 3"], freedom: Freedom = "rigid") -> Form:
    """Register ``cloud`` (mm) to the surface of ``patch``, and fit its radial deviation by ``basis``."""
    pose = register(patch, cloud, freedom)
    placed = pose.apply(cloud)
    over = over_surface(placed)
    points = placed[over]
    radius = np.linalg.norm(points, axis=1)
    directions = points / radius[:, None]
    return Form(
        pose=pose,
        points=points,
        distances=distances(patch, points)[0],
        deviation=fit_deviation(basis, directions, radius - patch.radius(directions)),
        used=float(over.mean()),
        covered=coverage(directions, float(basis.sigmas.min())),
    )


def _with_deviation(design: TracedLens, side: Side, deviation: SrbfSurface) -> TracedLens:
    """The design's tables, one of them with the deviation on it: tables are linear in the radius."""
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


def _describe(form: Form, height: Float[np.ndarray, "m m"]) -> dict[str, Any]:
    known = height[np.isfinite(height)]
    return {
        "used_share": form.used,
        "covered_share": form.covered,
        "pose": {
            "rotation_deg": np.degrees(form.pose.rotation_rad).tolist(),
            "rotation_standard_error_deg": np.degrees(form.pose.rotation_error_rad).tolist(),
            "translation_mm": form.pose.translation_mm.tolist(),
            "translation_standard_error_mm": form.pose.translation_error_mm.tolist(),
        },
        "point_deviation_um": _extent(1e3 * form.distances),
        "form_deviation_um": _extent(known),
        "residual_rms_um": 1e3 * form.deviation.residual_rms_mm,
    }


def _extent(values: Float[np.ndarray, " n"]) -> dict[str, float]:
    return {
        "pv": float(np.ptp(values)),
        "rms": float(np.sqrt(np.mean(values**2))),
        "min": float(values.min()),
        "max": float(values.max()),
    }


def _judged(evaluation: Evaluation) -> dict[str, Any]:
    keys = [key for name in _JUDGED for key in (name, f"{name}_standard_error")]
    return {key: evaluation.report[key] for key in keys}


def _gates(form: Form) -> list[Gate]:
    other = "give the points of this surface alone, near to lens coordinates"
    more = "measure more of the surface"
    return [
        Gate("points_used", form.used, ">=", USED_SHARE, "of the points", other),
        Gate("surface_covered", form.covered, ">=", COVERED_SHARE, "of the surface", more),
    ]
