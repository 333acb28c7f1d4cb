"""A small result folder for tests: every stage's files with numbers that are easy to recognise."""

import json

import numpy as np
import trimesh

from lensforge.gates import Gate
from lensforge.lens import Lens
from lensforge.spec import parse_spec
from lensforge.surfaces import chart
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

STAGES = ("design", "evaluate", "export", "check", "verify")
PIXELS, NODES = 16, 21


def small_lens(text="+", inner_mm=4.0, outer_mm=10.0, bump_mm=0.3, lumens_per_watt=None):
    basis = SrbfBasis((9,), 1.75)
    weights = bump_mm * np.linspace(-1.0, 1.0, basis.size)
    content = {
        "name": "small",
        "source": {"kind": "square", "side_mm": 2.0, "luminous_efficacy_lm_per_w": lumens_per_watt},
        "lens": {"inner_offset_mm": inner_mm, "outer_offset_mm": outer_mm, "levels": [9]},
        "constraints": {
            "cavity_height_mm": 1.0,
            "cavity_radius_mm": 1.5,
            "min_thickness_mm": 1.0,
            "max_radius_mm": 11.0,
        },
        "target": {"kind": "text", "text": text, "width_mm": 50.0, "distance_mm": 150.0, "receiver_mm": 300.0},
    }
    surfaces = (SrbfSurface(basis, weights, inner_mm), SrbfSurface(basis, weights[::-1].copy(), outer_mm))
    return Lens(*surfaces, parse_spec(content, "test"), seed=7, accuracy="draft")


def gate(name, value, limit, sense="<="):
    return Gate(name, value, sense, limit, "mm", "try something else").to_json()


def make_folder(folder, stages=STAGES, stl=False, lens=None):
    """Write lens.json and the files of ``stages`` into ``folder``; return it."""
    folder.mkdir(parents=True, exist_ok=True)
    (lens or small_lens()).save(folder / "lens.json")
    for stage in stages:
        (folder / f"{stage}.json").write_text(json.dumps(CONTENT[stage]), encoding="utf-8")
    if "evaluate" in stages:
        np.savez(folder / "evaluate.npz", **evaluate_arrays())
    if "check" in stages:
        np.savez(folder / "check.npz", **check_arrays())
    if "verify" in stages:
        images = evaluate_arrays()
        np.savez(folder / "verify.npz", irradiance=images["raw"], design_irradiance=images["irradiance"])
    if stl:
        trimesh.creation.icosphere(subdivisions=2, radius=5.0).export(folder / "lens.stl")
    return folder


def evaluate_arrays():
    axis = ((np.arange(PIXELS) + 0.5) / PIXELS - 0.5) * 300.0
    target = np.zeros((PIXELS, PIXELS))
    target[4:12, 5:11] = 40.0
    ripple = 1.0 + 0.05 * np.sin(axis)[:, None] * np.cos(axis)
    return {"target": target, "irradiance": target * ripple + 0.5, "raw": target * ripple**2 + 0.5, "axis_mm": axis}


def check_arrays():
    nodes = np.linspace(-1.0, 1.0, NODES)
    points = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1)
    outside = np.sum(points**2, axis=-1) > 1.0
    maps = {"chart_axis": nodes}
    for face in ("inner", "outer"):
        for name, values in (
            ("sag_mm", 0.1 * points[..., 0]),
            ("kappa_min", -0.8 + 0.5 * points[..., 1]),
            ("kappa_max", 0.2 + 0.1 * points[..., 1]),
            ("residual_mm", np.maximum(0.0, points[..., 0] - 0.5)),
            ("reachable", (points[..., 0] < 0.5).astype(float)),
        ):
            maps[f"{face}_{name}"] = np.where(outside, np.nan, values)
        maps[f"{face}_xyz"] = 5.0 * chart.to_sphere(points)
    return maps


_SPHERE = {"variant": "least_squares", "radius_mm": 8.25, "centre_mm": [0.0, 0.0, 1.5], "pv_mm": 0.4, "rms_mm": 0.1}
_FACE = {
    "best_fit_sphere": _SPHERE,
    "other_spheres": [{**_SPHERE, "variant": "enclosing"}],
    "curvature": {"kappa_min_per_mm": -1.3, "kappa_max_per_mm": 0.3},
    "cutter": {"radius_mm": 1.0, "reachable_fraction": 0.75, "largest_radius_mm": 0.77, "residual_mm": 0.5},
    "draft_deg": {"min": -3.25, "area_fraction_below_2": 0.125},
    "area_mm2": 321.5,
}
CONTENT = {
    "design": {
        "steps": 7,
        "forward_evaluations": 7,
        "rays_per_step": 4096,
        "seconds": 1.25,
        "history": [
            {
                "level": 0,
                "functions": 9,
                "nmse": [0.9, 0.5, 0.3],
                "efficiency": [0.5, 0.6, 0.7],
                "g1_mm": [2.0, 1.5, 1.25],
                "g2_mm": [3.0, 2.0, 1.0],
                "g3_mm": [0.75, -0.375, -0.0625],
            },
            {
                "level": 1,
                "functions": 34,
                "nmse": [0.2, 0.1, 0.05, 0.025],
                "efficiency": [0.75, 0.8, 0.85, 0.875],
                "g1_mm": [1.0, 0.875, 0.625, 0.5],
                "g2_mm": [0.5, 0.375, 0.3125, 0.25],
                "g3_mm": [-0.03125, 0.0, 0.0625, 0.125],
            },
        ],
        "constraints": {"g1_mm": 0.5, "g2_mm": 0.25, "g3_mm": 0.125},
        "max_radius_mm": 10.75,
        "height_mm": 10.5,
        "gates": [gate("constraint g1", 0.5, -0.001, ">=")],
    },
    "evaluate": {
        "uniformity": None,
        "uniformity_standard_error": None,
        "rsd": None,
        "rsd_standard_error": None,
        "nmse": 0.0123,
        "nmse_standard_error": 0.0004,
        "efficiency": 0.85,
        "efficiency_standard_error": 0.0002,
        "flux": {
            "detected": 0.85,
            "outside": 0.02,
            "missed": 0.03,
            "total_reflection": 0.01,
            "not_converged": 0.0,
            "absorbed_fresnel": 0.09,
        },
        "missed_by_cause": {"backward": 0.0, "base": 0.01, "averted": 0.02},
        "rays": 65536,
        "pixels": PIXELS,
        "filter": "3x3 Gaussian, variance 1 pixel^2",
        "receiver_mm": 300.0,
        "window_mm": 280.0,
        "replicates": 16,
        "seconds": 2.5,
        "table_error_nm": {"inner": 0.75, "outer": 1.75},
        "gates": [gate("flux not converged", 0.0, 0.0)],
    },
    "export": {
        "form_error_nm": {"max": 1.75, "rms": 0.25},
        "normal_error_mrad": {"max": 0.0075, "rms": 0.0025},
        "volume_mm3": 3833.5,
        "watertight": True,
        "genus": 0,
        "faces": {"count": 2, "names": ["OPTICAL_INNER", "OPTICAL_OUTER"]},
        "files": {"lens.step": {"bytes": 1234567, "sha256": "ab" * 32}},
        "seconds": 3.5,
        "gates": [gate("form_error", 1.75, 10.0)],
    },
    "check": {
        "inner": _FACE,
        "outer": _FACE,
        "min_wall_mm": 1.875,
        "verdicts": [{"name": "wall", "surface": "body", "holds": True, "reason": "the wall is thick enough"}],
        "seconds": 4.5,
        "gates": [gate("radial wall", 1.9, 0.999, ">=")],
    },
    "verify": {
        "rays": 20000,
        "seconds": 5.5,
        "nmse_vs_design": 0.0225,
        "nmse_same_rays": 0.000225,
        "noise_floor_nmse": 0.0325,
        "efficiency": 0.8475,
        "deviation_mm": {"rms": 0.0125, "max": 0.25, "p99": 0.05},
        "flux": {"detected": 0.8475},
        "referee": {"rays": 200, "casts": 390, "disagreements": 0, "rate": 120.5},
        "gates": [gate("deviation_rms", 0.0125, 0.015)],
    },
}
