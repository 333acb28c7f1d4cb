"""Records of the machined part, easy to recognise: a photograph, a measured surface, a second cut."""

import numpy as np
from filled import filled
from result_folders import evaluate_arrays

from lensforge.addons.measure.inference_result import FurtherPicture, Inference, InferredError
from lensforge.addons.measure.measurement_result import (
    Alignment,
    Correction,
    DeviationExtent,
    Evenness,
    Located,
    PhotoComparison,
    SurfaceComparison,
)
from lensforge.cad.part import stamp_of
from lensforge.results import Extent, Metric

NODES = 31


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
    light = evaluate_arrays()
    axis = np.linspace(-1.0, 1.0, NODES)
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


def make_inference(lens, **changes):
    content = {
        "inputs": {"lens": lens.sha256},
        "pictures": ("a.png", "b.png"),
        "led_mm": ((0.0, 0.0, 0.0), (0.25, 0.0, 0.0)),
        "corners": ((10.0, 10.0), (90.0, 12.0), (88.0, 95.0), (9.0, 91.0)),
        "corners_located": filled(Located, seen_in="off", lit=False),
        "inner_form_um": Metric(value=2.5, unit="µm", standard_error=0.125),
        "outer_form_um": Metric(value=3.5, unit="µm", standard_error=0.25),
        "errors": (
            InferredError(
                name="decentre x",
                value=Metric(value=7.5, unit="µm", standard_error=0.75),
                expected=10.0,
                remaining=0.0625,
            ),
            InferredError(
                name="index", value=Metric(value=0.5, unit="1e-4", standard_error=1.75), expected=2.0, remaining=0.875
            ),
        ),
        "further": FurtherPicture(led_mm=(0.0, 0.25, 0.0), error="index", remaining_before=0.875, remaining=0.75),
        "covariance": np.diag([0.005625, 0.765625]),
        "clipped": 0.0025,
        "chi_square": 1.125,
    }
    return filled(Inference, **{**content, **changes})
