"""Results that not every lens has, with numbers that are easy to recognise: stray light, a photograph, a surface."""

import numpy as np
from result_folders import (
    MAKERS,
    PIXELS,
    STAGES,
    criterion,
    divided,
    evaluate_arrays,
    light_images,
    make_folder,
    make_results,
)

from lensforge.light.evaluation_result import LightMetrics
from lensforge.made.measurement_result import (
    Alignment,
    DeviationExtent,
    Evenness,
    Located,
    PhotoComparison,
    Pose,
    Similarity,
    SurfaceComparison,
)
from lensforge.proof.proof_result import Agreement, BrepCast, MitsubaCast
from lensforge.proof.stray_result import ReceiverStray, StrayFlux, StrayLight
from lensforge.results import Metric
from lensforge.scene.receiver_shapes import build_receiver

NODES = 31
_AGREEMENT = Agreement(compared=1016, rms=0.0015, p99=0.0058, max=0.0175, flux=5e-7, fates=0, fates_flux=0.0)


def make_receiver_stray(section, **changes):
    """The stray light on one receiver."""
    light = light_images(*build_receiver(section, PIXELS).grid.shape)
    content = {
        "name": section.name,
        "width": section.size[0],
        "height": section.size[1],
        "far_field": section.kind == "far_field",
        "flux": StrayFlux(
            detected_direct=0.8475, detected_stray=0.0125, outside_direct=0.01, outside_stray=0.02, backward=0.07,
            absorbed=0.03, base=0.01, too_dim=0.0, leaked=0.0,
        ),
        "balance_error": 0.0,
        "detected_stray_by_cause": dict.fromkeys(("total_reflection", "base", "met_again"), 0.0)
        | {"inner_reflection": 0.0025, "outer_reflection": 0.01},
        "misplaced_flux": 0.0135,
        "nmse_vs_sequential": 0.00325,
        "peak_of_mean": 0.085,
        "efficiency": 0.86,
        "efficiency_sequential": 0.875,
        "sequential": light["raw_map"],
        "direct": light["raw_map"],
        "stray": 0.02 * light["target_map"] + 0.1,
    }  # fmt: skip
    return ReceiverStray(**{**content, **changes})


def make_stray(lens, **changes):
    """The stray light of ``lens``; ``changes``: of the record, or of the light on its first receiver."""
    first, *others = lens.spec.all_receivers
    of_first, of_record = divided(changes, ReceiverStray)
    content = {
        "inputs": {"lens": lens.sha256},
        "receivers": (make_receiver_stray(first, **of_first), *map(make_receiver_stray, others)),
        "rays": 4096,
        "base": "black",
        "absorption_per_mm": 0.002,
        "cut_off": 1e-4,
        "depth": 32,
        "seconds": 6.5,
        "criteria": (criterion("stray_balance", 0.0, 1e-9),),
    }
    return StrayLight(**{**content, **of_record})


def make_photo(lens, **changes):
    light = evaluate_arrays()
    content = {
        "inputs": {"lens": lens.sha256},
        "on": "on.png",
        "off": "off.png",
        "corners": ((10.0, 10.0), (90.0, 12.0), (88.0, 95.0), (9.0, 91.0)),
        "corners_located": Located(seen_in="off", lit=False, edge_rms_px=0.125, edge_bow_px=0.25),
        "target_mm": (300.0, 300.0),
        "width_mm": 300.0,
        "height_mm": 300.0,
        "gamma": 1.0,
        "pixels": PIXELS,
        "ssim": 0.925,
        "nmse": 0.0375,
        "alignment": Alignment(
            displacement_x_mm=Metric(value=1.25, unit="mm", standard_error=0.125),
            displacement_y_mm=Metric(value=-0.75, unit="mm", standard_error=0.5),
            scale=Metric(value=1.02, standard_error=0.0025),
            rotation_deg=None,
        ),
        "aligned": Similarity(ssim=0.975, nmse=0.0125),
        "measured_evenness": Evenness(uniformity=0.625, rsd=0.05),
        "simulated_evenness": Evenness(uniformity=0.75, rsd=0.04),
        "clipped": 0.0,
        "criteria": (criterion("photo_clipped", 0.0, 0.01),),
        "measured": light["raw_map"],
        "simulated": light["map"],
    }
    return PhotoComparison(**{**content, **changes})


def make_surface(lens, **changes):
    light, axis = evaluate_arrays(), np.linspace(-1.0, 1.0, NODES)
    x, y = np.meshgrid(axis, axis)
    extent = DeviationExtent(pv=12.5, rms=2.25, min=-5.0, max=7.5)
    metrics = LightMetrics(nmse=Metric(value=0.0125), uniformity=None, rsd=None, efficiency=Metric(value=0.85))
    content = {
        "inputs": {"lens": lens.sha256},
        "surface": "outer",
        "registration": "rigid",
        "point_count": 12345,
        "used_share": 1.0,
        "covered_share": 0.95,
        "pose": Pose(
            rotation_x_deg=Metric(value=0.1, unit="deg", standard_error=0.01),
            rotation_y_deg=Metric(value=0.2, unit="deg", standard_error=0.02),
            rotation_z_deg=Metric(value=0.3, unit="deg"),
            translation_x_mm=Metric(value=0.4, unit="mm", standard_error=0.04),
            translation_y_mm=Metric(value=0.5, unit="mm", standard_error=0.05),
            translation_z_mm=Metric(value=0.6, unit="mm", standard_error=0.06),
        ),
        "point_deviation_um": extent,
        "form_deviation_um": extent,
        "residual_rms_um": 0.75,
        "rays": 8192,
        "receiver": "light",
        "far_field": False,
        "width": 300.0,
        "height": 300.0,
        "design": metrics,
        "measured": LightMetrics(
            nmse=Metric(value=0.0175), uniformity=None, rsd=None, efficiency=Metric(value=0.8375)
        ),
        "change": LightMetrics(nmse=Metric(value=0.005), uniformity=None, rsd=None, efficiency=Metric(value=-0.0125)),
        "nmse_between": 0.00225,
        "criteria": (criterion("points_used", 1.0, 0.9, ">="),),
        "points": np.array([[0.0, 0.0, 10.0], [1.0, 0.0, 9.875]]),
        "distance_um": np.array([2.5, -2.5]),
        "chart": axis,
        "deviation_um": np.where(x**2 + y**2 <= 1.0, 7.5 * x, np.nan),  # indexed [Y, X]
        "area_mm2": np.where(x**2 + y**2 <= 1.0, 4.0 / (1.0 + x**2 + y**2) ** 2, np.nan),
        "irradiance_design": light["map"],
        "irradiance_measured": light["raw_map"],
    }  # fmt: skip
    return SurfaceComparison(**{**content, **changes})


def verified():
    """What the proof holds where all referees were asked."""
    quantiles = np.linspace(1e-4, 0.1, 501)
    mitsuba = MitsubaCast(
        version="3.9.1", rays=4096, seconds=1.0, nmse_vs_design=0.0065, noise_floor_nmse=0.0085, nmse_same_rays=1e-4,
        against_design=_AGREEMENT.model_copy(update={"rms": 0.0575}),
    )  # fmt: skip
    return {
        "brep": BrepCast(rays=1024, seconds=1.0, against_design=_AGREEMENT, against_mesh=_AGREEMENT),
        "mitsuba": mitsuba,
        "criteria": (
            criterion("deviation_rms", 0.0125, 0.015),
            criterion("brep_deviation_rms", 0.0015, 0.0075),
            criterion("mitsuba_nmse_vs_design", 0.0065, 0.02),
        ),
        "gaps_step_mm": 0.1 * quantiles,
        "gaps_mitsuba_mm": 5.0 * quantiles,
    }


MAKERS |= {"stray": make_stray, "compare": make_photo, "compare_outer": make_surface}
EXTRAS = ("stray", "compare", "compare_outer")


def whole_results(**records):
    """All stages, all referees, stray light, a photograph, and the measured outer surface."""
    return make_results((*STAGES, *EXTRAS), **{"verify": verified(), **records})


def whole_folder(folder, **records):
    """The files of :func:`whole_results`."""
    return make_folder(folder, (*STAGES, *EXTRAS), **{"verify": verified(), **records})
