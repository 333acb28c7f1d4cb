"""A correction of the inner face for its second cut, with numbers that are easy to recognise."""

from part_files import make_surface

from lensforge.cad.part import stamp_of
from lensforge.made.measurement_result import Correction
from lensforge.results import Extent


def make_correction(lens):
    """The record of a correction of ``lens``."""
    surface = make_surface(lens)
    shared = ("inputs", "point_count", "used_share", "covered_share", "pose", "rays")
    maps = {f"{name}_map_um": surface.deviation_um for name in ("deviation", "correction", "expected")}
    return Correction(
        **{name: getattr(surface, name) for name in (*shared, "design", "change", "chart", "area_mm2")},
        **maps,
        surface="inner",
        registration="rigid",
        make="part",
        scale=1.0,
        point_spacing_mm=0.5,
        gain=0.95,
        wavelength_mm=1.5,
        wavelength_given=False,
        noise_rms_um=0.35,
        residual_rms_um=0.45,
        deviation_um=Extent(max=6.5, rms=2.5),
        correction_um=Extent(max=6.25, rms=2.25),
        expected_um=Extent(max=1.5, rms=0.5),
        cutter={
            "cutter_radius_mm": 1.0, "concave_radius_before_mm": 1.75, "concave_radius_mm": 1.5,
            "smoothed_more_share": 0.125, "cut_back_um": {"max": 0.75, "rms": 0.25},
        },
        nodes={"inner": 33, "outer": 65},
        step_schema="AP214",
        step_volume_change=1e-9,
        form_error_nm=Extent(max=1.25, rms=0.75),
        normal_error_mrad=Extent(max=0.0085, rms=0.0035),
        first_cut=surface.measured,
        second_cut=surface.measured,
        criteria=(),
        file=stamp_of(b"a STEP"),
        step=b"a STEP",
    )  # fmt: skip
