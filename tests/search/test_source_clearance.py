"""The source against the cavity that the limits keep clear, by the closed form of the paraboloid."""

import numpy as np
import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.search.scene_check import source_clearance_warnings
from lensforge.search.searches import design
from lensforge.sources.build_source import build_source

# cavity_height_mm = 0.5, cavity_radius_mm = 1: z = 0.5 (1 - s^2) is the highest place at s from the axis
HIGH = 0.5 * (1.0 - 0.08)  # where the corners of a square of 0.4 mm are


def _warnings(source: dict[str, object]) -> tuple[str, ...]:
    spec = small_spec(source={"kind": "square", "side_mm": 0.4} | source)
    return source_clearance_warnings(spec, build_source(spec.source))


@pytest.mark.parametrize(
    "source",
    [
        {"side_mm": 1.4},
        {"position_mm": [0.0, 0.0, HIGH - 1e-3]},
        {"position_mm": [np.sqrt(1.0 - 0.2**2) - 0.2 - 1e-3, 0.0, 0.0]},
        {"position_mm": [5.0, 0.0, -0.1]},  # below the plane no limit applies: its rays tell
        {"side_mm": 1.3, "tilt_deg": [0.0, 30.0], "position_mm": [0.0, 0.0, -0.2]},
    ],
)
def test_a_source_inside_the_cavity_is_left_alone(source):
    assert _warnings(source) == ()


@pytest.mark.parametrize(
    ("source", "reaches"),
    [
        ({"position_mm": [0.0, 0.0, HIGH + 1e-3]}, r"0\.461\) mm, 0\.2828 mm from the axis"),
        ({"position_mm": [np.sqrt(1.0 - 0.2**2) - 0.2 + 1e-3, 0.0, 0.0]}, r"0\) mm, 1\.001 mm from"),
        ({"side_mm": 1.3, "tilt_deg": [0.0, 30.0]}, r"0\.325\) mm"),
        # the corners above the plane are inside, the edge that passes the plane is not
        ({"kind": "rectangle", "side_mm": None, "width_mm": 2.04, "height_mm": 0.1, "tilt_deg": [0.0, 11.31],
          "position_mm": [1.2, 0.0, 0.05]}, r"\(1\.45, 0?-?0\.05, .*1\.451 mm from the axis"),
    ],
)  # fmt: skip
def test_a_placed_source_that_the_lens_may_touch_is_refused(source, reaches):
    given = {name: value for name, value in ({"side_mm": 0.4} | source).items() if value is not None}
    spec = small_spec(source={"kind": "square"} | given)
    with pytest.raises(lf.InputError, match=reaches) as refusal:
        source_clearance_warnings(spec, build_source(spec.source))
    assert "raise the limits, or change source.position_mm" in str(refusal.value)


def test_a_source_too_large_for_the_cavity_is_a_warning_where_it_was_not_placed():
    (warning,) = _warnings({"side_mm": 2.0})
    assert "1.414 mm from the axis, outside the paraboloid of constraints.cavity_height_mm = 0.5" in warning


def test_a_source_that_reaches_beyond_the_largest_lens_is_refused():
    """One of three chips lies at 7.01 mm; the largest lens has 7 mm."""
    chip = {"width_mm": 0.02, "height_mm": 0.02}
    chips = [{"x_mm": x, "y_mm": y} | chip for x, y in ((0.0, 0.2), (0.0, -6.995), (0.3, 0.0))]
    limits = {"cavity_height_mm": 0.5, "cavity_radius_mm": 1.0, "max_radius_mm": 7.0}
    spec = small_spec(source={"kind": "chips", "chips": chips}, constraints=limits)
    with pytest.raises(lf.InputError, match=r"reaches \(-?0\.01, -7\.005, 0\) mm, beyond .*max_radius_mm = 7; correct"):
        source_clearance_warnings(spec, build_source(spec.source))
    larger = spec.replace({"constraints.max_radius_mm": 7.1})
    (warning,) = source_clearance_warnings(larger, build_source(larger.source))
    assert "only that is kept clear" in warning


def test_a_fixed_inner_surface_is_the_cavity():
    spec = small_spec(
        source={"kind": "square", "side_mm": 0.4, "position_mm": [0.0, 0.0, 2.97]},
        lens={"levels": [9, 25], "inner": {"fixed": {"kind": "sphere", "radius_mm": 3.0}}, "outer": {"offset_mm": 6.0}},
    )
    assert source_clearance_warnings(spec, build_source(spec.source)) == ()
    higher = spec.replace({"source.position_mm": [0.0, 0.0, 2.99]})
    with pytest.raises(lf.InputError, match=r"outside lens\.inner\.fixed"):
        source_clearance_warnings(higher, build_source(higher.source))


def test_rays_of_a_file_need_not_start_on_the_source():
    rows = np.column_stack([np.full((4, 3), 2.0), np.tile([0.0, 0.0, 1.0], (4, 1)), np.ones(4)])
    spec = small_spec().replace(source=lf.RaySource(rows, position_mm=(1.0, 0.0, 1.0)))
    assert source_clearance_warnings(spec, build_source(spec.source)) == ()


def test_the_design_refuses_before_its_search():
    spec = small_spec(source={"kind": "square", "side_mm": 0.4, "position_mm": [0.0, 0.0, 0.6]})
    with pytest.raises(lf.InputError, match="the lens may touch the source"):
        design(spec, accuracy="draft")
