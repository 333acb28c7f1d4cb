"""Results that not every lens has, easy to recognise: stray light, a photograph, a surface, a second cut."""

import numpy as np
from filled import filled
from result_folders import (
    MAKERS,
    PIXELS,
    STAGES,
    divided,
    evaluate_arrays,
    light_images,
    make_folder,
    make_results,
)

from lensforge.cad.part import stamp_of
from lensforge.made.measurement_result import (
    Alignment,
    Correction,
    DeviationExtent,
    Evenness,
    Located,
    PhotoComparison,
    SurfaceComparison,
)
from lensforge.proof.cast_results import Agreement, BrepCast, MitsubaCast
from lensforge.proof.proof_result import ReceiverStray, StrayFlux, StrayLight
from lensforge.results import Extent, Metric
from lensforge.scene.receiver_shapes import build_receiver

NODES = 31


def make_receiver_stray(section, **changes):
    """The stray light on one receiver."""
    light = light_images(*build_receiver(section, PIXELS).grid.shape)
    content = {
        "name": section.name,
        "width": section.size[0],
        "height": section.size[1],
        "far_field": section.kind == "far_field",
        "flux": filled(StrayFlux, detected_direct=0.8475, too_dim=0.0, leaked=0.0),
        "balance_error": 0.0,
        "nmse_vs_sequential": 0.00325,
        "peak_of_mean": 0.085,
        "sequential": light["raw_map"],
        "direct": light["raw_map"],
        "stray": 0.02 * light["target_map"] + 0.1,
    }
    return filled(ReceiverStray, **{**content, **changes})


def make_stray(lens, **changes):
    """The stray light of ``lens``; ``changes``: of the record, or of the light on its first receiver."""
    first, *others = lens.spec.all_receivers
    of_first, of_record = divided(changes, ReceiverStray)
    content = {
        "inputs": {"lens": lens.sha256},
        "receivers": (make_receiver_stray(first, **of_first), *map(make_receiver_stray, others)),
    }
    return filled(StrayLight, **{**content, **of_record})


def make_photo(lens, **changes):
    light = evaluate_arrays()
    content = {
        "inputs": {"lens": lens.sha256},
        "on": "on.png",
        "off": "off.png",
        "corners": ((10.0, 10.0), (90.0, 12.0), (88.0, 95.0), (9.0, 91.0)),
        "corners_located": filled(Located, seen_in="off", lit=False),
        "target_mm": (300.0, 300.0),
        "width_mm": 300.0,
        "height_mm": 300.0,
        "alignment": Alignment(
            displacement_x_mm=Metric(value=1.25, unit="mm", standard_error=0.125),
            displacement_y_mm=Metric(value=-0.75, unit="mm", standard_error=0.5),
            scale=Metric(value=1.02, standard_error=0.0025),
            rotation_deg=None,
        ),
        "measured_evenness": Evenness(uniformity=0.625, rsd=0.05),
        "simulated_evenness": Evenness(uniformity=0.75, rsd=0.04),
        "clipped": 0.0025,
        "measured": light["raw_map"],
        "simulated": light["map"],
    }
    return filled(PhotoComparison, **{**content, **changes})


def make_surface(lens, **changes):
    light, axis = evaluate_arrays(), np.linspace(-1.0, 1.0, NODES)
    x, y = np.meshgrid(axis, axis)
    content = {
        "inputs": {"lens": lens.sha256},
        "surface": "outer",
        "point_count": 12345,
        "form_deviation_um": filled(DeviationExtent, pv=12.5),
        "far_field": False,
        "width": 300.0,
        "height": 300.0,
        "used_share": 0.9375,
        "covered_share": 0.875,
        "points": np.array([[0.0, 0.0, 10.0], [1.0, 0.0, 9.875]]),
        "distance_um": np.array([2.5, -2.5]),
        "chart": axis,
        "deviation_um": np.where(x**2 + y**2 <= 1.0, 7.5 * x, np.nan),  # indexed [Y, X]
        "area_mm2": np.where(x**2 + y**2 <= 1.0, 4.0 / (1.0 + x**2 + y**2) ** 2, np.nan),
        "irradiance_design": light["map"],
        "irradiance_measured": light["raw_map"],
    }
    return filled(SurfaceComparison, **{**content, **changes})


def make_correction(lens):
    """A correction of the inner face."""
    surface = make_surface(lens)
    maps = {f"{name}_map_um": surface.deviation_um for name in ("deviation", "correction", "expected")}
    return filled(
        Correction,
        **{name: getattr(surface, name) for name in ("inputs", "pose", "chart", "area_mm2")},
        **maps,
        surface="inner",
        used_share=0.9375,
        covered_share=0.875,
        form_error_nm=Extent(max=0.75, rms=0.25),
        normal_error_mrad=Extent(max=0.015, rms=0.005),
        step_volume_change=1e-13,
        scale=1.0,
        wavelength_given=False,
        nodes={"inner": 33, "outer": 65},
        file=stamp_of(b"a STEP"),
        step=b"a STEP",
    )


def verified():
    """What the proof holds where all referees were asked."""
    quantiles = np.linspace(1e-4, 0.1, 501)
    alike = filled(Agreement, rms=0.0015, flux=0.00005, fates=1, fates_flux=0.000375)
    return {
        "brep": filled(BrepCast, against_design=alike),
        "mitsuba": filled(
            MitsubaCast, version="3.9.1", against_design=alike, nmse_vs_design=0.0065, noise_floor_nmse=0.0085
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
