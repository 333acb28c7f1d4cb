"""The small results of :mod:`result_folders` with figures that agree with their own pictures, and with their lens."""

import numpy as np

from lensforge.cad.part_limits import mesh_volume_limit, part_criteria
from lensforge.light.evaluation_result import LightMetrics, light_criteria
from lensforge.light.receiver_light import WindowSize
from lensforge.made.measurement_result import DeviationExtent, photo_criteria, surface_criteria
from lensforge.proof.acceptance import proof_criteria, stray_criteria
from lensforge.proof.proof_inputs import screens_of
from lensforge.proof.proof_result import SizedFile, Sizes
from lensforge.results import Metric
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.design_result import Margins, constraint_criteria
from lensforge.shop.check_result import BallClearance, OuterClearance
from lensforge.shop.findings import check_findings, wall_criteria
from lensforge.surfaces.srbf import fibonacci_hemisphere


def squares(image, reference):
    return float(np.sum((image - reference) ** 2) / np.sum(reference**2))


def agreeing(stem, result, lens):
    """``result`` with criteria, findings and figures that follow from its own values."""
    change = MAKERS[stem.partition("_")[0] if stem.startswith("compare") else stem](result, lens)
    changed = result.model_copy(update=change)
    judged = CRITERIA.get(type(changed).__name__)
    return changed if judged is None else changed.model_copy(update=judged(changed, lens))


def design(result, lens):
    u, limits = fibonacci_hemisphere(60_000), lens.spec.constraints
    inner, outer = lens.inner.radius(u), lens.outer.radius(u)
    cavity = limits.cavity_height_mm / limits.cavity_radius_mm**2 * inner**2 * (1.0 - u[:, 2] ** 2) + inner * u[:, 2]
    margins = Margins(
        cavity_clearance_mm=float(cavity.min()) - limits.cavity_height_mm,
        wall_margin_mm=float((outer - inner).min()) - limits.min_thickness_mm,
        radius_margin_mm=limits.max_radius_mm - float(outer.max()),
    )
    return {"constraints": margins, "max_radius_mm": float(outer.max()), "height_mm": float((outer * u[:, 2]).max())}


def light(result, lens):
    built = receivers_of(lens.spec, result.pixels)
    return {"receivers": tuple(map(on_receiver, result.receivers, built))}


def on_receiver(result, receiver):
    """The light on one receiver, whose window is all of it."""
    target = result.target_map * result.map.sum() / result.target_map.sum()
    lit = result.raw_map[target > 0.1 * target.max()].sum() / result.raw_map.sum()
    share = result.share_in_target.model_copy(update={"value": float(lit) * result.flux.detected})
    raw = result.raw.model_copy(update={"nmse": squares(result.map, target)})
    sides = {name: getattr(receiver.window, name) for name in ("width", "height", "radius")}
    change = {
        "efficiency": result.efficiency.model_copy(update={"value": result.flux.detected}),
        "window": WindowSize(**{name: side if np.isfinite(side) else None for name, side in sides.items()}),
        "share_in_target": share,
        "target_map": target,
        "raw": raw,
        "nmse_of_noise": max(raw.nmse - result.nmse.value, 1e-4),
    }
    return result.model_copy(update=change)


def corners_of(stl):
    """The corners of the triangles of a binary STL."""
    rows = np.frombuffer(stl, np.uint8, offset=84).reshape(-1, 50)
    return rows[:, 12:48].copy().view("<f4").reshape(-1, 3, 3).astype(float)


def area_of(corners):
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(crossed, axis=1).sum()) / 2


def part(result, lens):
    corners = corners_of(result.stl)
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = float(np.sum(corners[:, 0] * crossed)) / 6.0
    extent = result.form_error_nm.model_copy(update={"max": 0.75})
    mesh = result.triangulation.model_copy(update={"triangles": len(corners), "chord_error_um": 100.0})
    area = area_of(corners)
    bounds = (tuple(corners.min(axis=(0, 1)).tolist()), tuple(corners.max(axis=(0, 1)).tolist()))
    return {
        "volume_mm3": volume + 1.0, "volume_mesh_mm3": volume, "area_mm2": area, "area_mesh_mm2": area,
        "bounds_mm": bounds, "form_error_nm": extent, "triangulation": mesh,
    }  # fmt: skip


def files(result, lens):
    area = area_of(corners_of(result.stl))
    measured = {
        "form_error": result.form_error_nm.max, "normal_error": result.normal_error_mrad.max, "step_valid": 1.0,
        "step_volume_change": 0.0, "watertight": float(result.watertight), "watertight_3mf": 1.0,
        "genus_difference": 0.0, "mesh_volume_change": abs(result.volume_mesh_mm3 / result.volume_mm3 - 1.0),
    }  # fmt: skip
    limit = mesh_volume_limit(area, 1e-3 * result.triangulation.chord_error_um, result.volume_mm3)
    return {"criteria": part_criteria(measured, limit)}


def check(result, lens):
    change = {}
    for name in ("inner", "outer"):
        face = getattr(result, name)
        sag, kappa, left = (getattr(result, f"{name}_{each}") for each in ("sag_mm", "kappa_max", "residual_mm"))
        curvature, concave = face.curvature, -1.0 / face.curvature.kappa_min_per_mm
        highest = max(curvature.kappa_max_per_mm, float(np.nanmax(kappa)))
        change[name] = face.model_copy(
            update={
                "best_fit_sphere": face.best_fit_sphere.model_copy(
                    update={"pv_mm": float(np.nanmax(sag) - np.nanmin(sag))}
                ),
                "curvature": curvature.model_copy(
                    update={"smallest_concave_radius_mm": concave, "kappa_max_per_mm": highest}
                ),
                "cutter": face.cutter.model_copy(
                    update={"largest_radius_mm": 0.99 * concave, "residual_mm": float(np.nanmax(left))}
                ),
            }
        )
    clear = OuterClearance(smallest_step_mm=0.0, step_clearance_mm=0.0, flange_clearance_mm=0.0, flush_fraction=1.0)
    return change | {"relief": BallClearance(outer=clear, inner=None)}


def findings(result, lens):
    found = check_findings(lens.spec, result.inner, result.outer, result.min_wall_mm, result.relief, result.tools)
    return {"verdicts": found, "criteria": (*wall_criteria(lens.spec, result.wall),)}


def proof(result, lens):
    return {"receivers": tuple(map(proof_on_receiver, result.receivers, screens_of(lens.spec)))}


def proof_of(result, exported, lit):
    """The verification of the part ``exported``, of the size that its record states, under the light ``lit``."""
    receivers = tuple(
        each.model_copy(
            update={
                "own_rays": each.own_rays.model_copy(
                    update={
                        "efficiency_design": seen.efficiency,
                        "nmse_less_noise": None if seen.nmse_of_noise is None else each.own_rays.nmse_less_noise,
                    }
                )
            }
        )
        for each, seen in zip(result.receivers, lit.receivers, strict=True)
    )
    file = SizedFile(size=exported.size)
    chord_mm = 1e-3 * exported.triangulation.chord_error_um
    sizes = Sizes(exported=exported.size, chord_mm=chord_mm, mesh=file, step=file)
    changed = result.model_copy(update={"receivers": receivers, "sizes": sizes, "volume_mm3": exported.volume_mm3})
    return changed.model_copy(update={"criteria": proof_criteria(changed)})


def proof_on_receiver(result, screen):
    seen = squares(result.irradiance, result.design_irradiance)
    limit_mm = 1e-4 * screen.reach_mm(result.design_irradiance)
    change = {"nmse_vs_design": seen, "noise_floor_nmse": seen, "deviation_limit_mm": limit_mm}
    for name, gaps in (
        ("mesh", result.gaps_mesh_mm),
        ("brep", result.gaps_step_mm),
        ("mitsuba", result.gaps_mitsuba_mm),
    ):
        if gaps is None:
            continue
        extent = {"rms": float(np.sqrt(np.mean(gaps**2))), "p99": float(gaps[495]), "max": float(gaps[-1])}
        if name == "mesh":
            change["against_design"] = result.against_design.model_copy(update=extent)
        else:
            cast = getattr(result, name)
            against = cast.against_design.model_copy(
                update=extent | ({} if cast.against_design.fates else {"fates_flux": 0.0})
            )
            change[name] = cast.model_copy(update={"against_design": against})
    return result.model_copy(update=change)


def stray(result, lens):
    return {"receivers": tuple(map(stray_on_receiver, result.receivers))}


def stray_on_receiver(result):
    flux = result.flux
    causes = result.detected_stray_by_cause.model_dump()
    flux = flux.model_copy(update={"detected_stray": sum(causes.values())})
    rest = 1.0 - sum(value for name, value in flux.model_dump().items() if name != "backward")
    flux = flux.model_copy(update={"backward": rest})
    off = abs(sum(flux.model_dump().values()) - 1.0)
    change = {"flux": flux, "balance_error": off, "efficiency": flux.detected_direct + flux.detected_stray}
    return result.model_copy(update=change)


def compare(result, lens):
    if hasattr(result, "simulated"):
        return {"nmse": squares(result.measured, result.simulated)}
    inside = np.isfinite(result.deviation_um)
    form, areas = result.deviation_um[inside], result.area_mm2[inside]
    extents = {
        name: DeviationExtent(
            pv=float(np.ptp(each)),
            rms=float(np.sqrt(np.sum(weights * each**2) / np.sum(weights))),
            min=float(each.min()),
            max=float(each.max()),
        )
        for name, each, weights in (
            ("point_deviation_um", result.distance_um, np.ones(len(result.distance_um))),
            ("form_deviation_um", form, areas),
        )
    }
    between = squares(result.irradiance_measured, result.irradiance_design)
    return extents | {"nmse_between": between, "change": difference(result.measured, result.design)}


def difference(after, before):
    """The change of every metric that both lights have, without errors."""
    pairs = {name: (getattr(after, name), getattr(before, name)) for name in type(after).model_fields}
    changes = {name: None if None in pair else pair[0].value - pair[1].value for name, pair in pairs.items()}
    return LightMetrics(**{name: None if value is None else Metric(value=value) for name, value in changes.items()})


MAKERS = {
    "design": design, "evaluate": light, "export": part, "check": check, "verify": proof, "stray": stray,
    "compare": compare, "photometry": lambda result, lens: {},
}  # fmt: skip
CRITERIA = {
    "Design": lambda each, lens: {"criteria": constraint_criteria(lens.spec, each.constraints)},
    "Light": lambda each, lens: {"criteria": light_criteria(each.flux)},
    "Part": files,
    "Check": findings,
    "Proof": lambda each, lens: {"criteria": proof_criteria(each)},
    "StrayLight": lambda each, lens: {"criteria": stray_criteria(each)},
    "PhotoComparison": lambda each, lens: {"criteria": photo_criteria(each.clipped)},
    "SurfaceComparison": lambda each, lens: {"criteria": surface_criteria(each.used_share, each.covered_share)},
}
