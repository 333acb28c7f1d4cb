"""Files that not every folder has, with numbers that are easy to recognise: stray light, a photograph, a surface."""

import copy
import json

import numpy as np
from result_folders import CONTENT, PIXELS, evaluate_arrays, gate

NODES = 31
_AGREEMENT = {"compared": 1016, "rms": 0.0015, "p99": 0.0058, "max": 0.0175, "flux": 5e-7, "fates": 0, "fates_flux": 0}
STRAY = {
    "rays": 4096,
    "base": "black",
    "absorption_per_mm": 0.002,
    "cut_off": 1e-4,
    "depth": 32,
    "flux": {
        "detected_direct": 0.8475, "detected_stray": 0.0125, "outside_direct": 0.01, "outside_stray": 0.02,
        "backward": 0.07, "absorbed": 0.03, "base": 0.01, "too_dim": 0.0, "leaked": 0.0,
    },
    "balance_error": 0.0,
    "detected_stray_by_cause": {"inner_reflection": 0.0025, "outer_reflection": 0.01, "met_again": 0.0},
    "misjudged_flux": 0.0135,
    "nmse_vs_sequential": 0.00325,
    "stray": {"centroid_mm": [1.0, -2.0], "rms_radius_mm": 62.5, "peak_w_m2": 3.5, "peak_of_mean": 0.085},
    "efficiency": 0.86,
    "efficiency_sequential": 0.875,
    "seconds": 6.5,
    "gates": [gate("stray_balance", 0.0, 1e-9)],
}  # fmt: skip
PHOTO = {
    "on": "on.png",
    "off": "off.png",
    "corners": [[10.0, 10.0], [90.0, 12.0], [88.0, 95.0], [9.0, 91.0]],
    "corners_located": {"seen_in": "--off", "lit": False, "edge_rms_px": 0.125, "edge_bow_px": 0.25},
    "target_mm": 300.0,
    "gamma": 1.0,
    "pixels": PIXELS,
    "ssim": 0.925,
    "nmse": 0.0375,
    "displacement_mm": [1.25, -0.75],
    "aligned": {"ssim": 0.975, "nmse": 0.0125},
    "measured": {"uniformity": 0.625, "rsd": 0.05},
    "simulated": {"uniformity": 0.75, "rsd": 0.04},
    "clipped": 0.0,
    "gates": [gate("photo_clipped", 0.0, 0.01)],
}
_EXTENT = {"pv": 12.5, "rms": 2.25, "min": -5.0, "max": 7.5}
_JUDGED = {"nmse": 0.0125, "uniformity": None, "rsd": None, "efficiency": 0.85}
SURFACE = {
    "surface": "outer",
    "registration": "rigid",
    "points": 12345,
    "used_share": 1.0,
    "covered_share": 0.95,
    "pose": {"rotation_deg": [0.1, 0.2, 0.3]},
    "point_deviation_um": _EXTENT,
    "form_deviation_um": _EXTENT,
    "residual_rms_um": 0.75,
    "rays": 8192,
    "design": _JUDGED,
    "measured": {**_JUDGED, "nmse": 0.0175, "efficiency": 0.8375},
    "nmse_between": 0.00225,
    "gates": [gate("points_used", 1.0, 0.9, ">=")],
}
EXTRAS = {"stray": STRAY, "compare": PHOTO, "compare_outer": SURFACE}


def verified():
    """verify.json with all referees."""
    content = copy.deepcopy(CONTENT["verify"])
    content["brep"] = {"rays": 1024, "seconds": 1.0, "against_design": _AGREEMENT, "against_mesh": _AGREEMENT}
    content["mitsuba"] = {
        "version": "3.9.1", "rays": 4096, "seconds": 1.0, "nmse_vs_design": 0.0065, "noise_floor_nmse": 0.0085,
        "nmse_same_rays": 1e-4, "against_design": {**_AGREEMENT, "rms": 0.0575},
    }  # fmt: skip
    content["gates"] = [*content["gates"], gate("brep_deviation_rms", 0.0015, 0.0075)]
    content["gates"].append(gate("mitsuba_nmse_vs_design", 0.0065, 0.02))
    return content


def add_part_files(folder):
    """Into a whole folder: all referees, stray light, a photograph, and the measured outer surface."""
    (folder / "verify.json").write_text(json.dumps(verified()), encoding="utf-8")
    light, quantiles = evaluate_arrays(), np.linspace(1e-4, 0.1, 501)
    np.savez(
        folder / "verify.npz",
        irradiance=light["raw"],
        design_irradiance=light["irradiance"],
        gaps_mesh_mm=quantiles,
        gaps_step_mm=0.1 * quantiles,
        gaps_mitsuba_mm=5.0 * quantiles,
    )
    for stage, content in EXTRAS.items():
        (folder / f"{stage}.json").write_text(json.dumps(content), encoding="utf-8")
    np.savez(folder / "stray.npz", sequential=light["raw"], direct=light["raw"], stray=0.02 * light["target"] + 0.1)
    np.savez(folder / "compare.npz", measured=light["raw"], simulated=light["irradiance"])
    axis = np.linspace(-1.0, 1.0, NODES)
    x, y = np.meshgrid(axis, axis)
    form = np.where(x**2 + y**2 <= 1.0, 7.5 * x, np.nan)  # indexed [Y, X]
    np.savez(
        folder / "compare_outer.npz",
        deviation_um=form,
        irradiance_design=light["irradiance"],
        irradiance_measured=light["raw"],
    )
    return folder
