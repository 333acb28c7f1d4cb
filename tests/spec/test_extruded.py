"""What a linear lens takes and what it refuses, each in one line."""

from typing import Any

import numpy as np
import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.surfaces.drawn_profile import DrawnFace

LENS = {"kind": "extruded", "length_mm": 50.0}
ALONE = {"lens": LENS, "optimise__steps_per_level": [1], "base": {"kind": "none"}}
ROW = {"kind": "grid", "columns": 1, "rows": 5, "pitch_mm": 6.0}


def test_a_row_closer_than_a_lens_is_wide_lies_below_one_lens() -> None:
    spec = small_spec(**ALONE | {"lens": LENS | {"ends": "free"}, "lamps": ROW})
    assert len(spec.all_lamps) == 5 and spec.lens.apart(spec.all_lamps).places_mm == ((0.0, 0.0),)


def test_without_a_base_of_its_own_it_has_none() -> None:
    spec = small_spec(**ALONE)
    assert (
        lf.Spec(
            name="x", source=spec.source, lens=spec.lens, constraints=spec.constraints, target=spec.target
        ).base.kind
        == "none"
    )


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"lamps": ROW}, 'lens.ends = "capped": each of 5 lamps would see other ends'),
        ({"lens": LENS | {"ends": "free"}, "lamps": ROW | {"pitch_mm": 60.0}}, "lens.length_mm = 50: below the pitch"),
        ({"lens": LENS | {"ends": "free"}, "lamps": ROW | {"columns": 2}}, "the nearest two stand 6 mm apart"),
        ({"base": {"diameter_mm": 20.0}}, "base: does not go with lens.kind = 'extruded'"),
        ({"constraints__keep_out": "none.step"}, "constraints.keep_out"),
        ({"lens": LENS | {"symmetry": "square"}}, "a linear lens has no diagonal"),
        ({"lens": LENS | {"levels": [9]}}, "levels"),
        ({"lens": LENS | {"outer": {"fixed": {"kind": "sphere", "radius_mm": 6.0}}}}, "outer.fixed: a given surface"),
        ({"lens": {"kind": "extruded"}}, "length_mm"),
    ],
)
def test_it_is_refused_in_a_line(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(lf.InputError) as refused:
        small_spec(**ALONE | changes)
    assert line in str(refused.value) and "\n" not in str(refused.value)


def test_the_extent_of_a_half_cylinder_reaches_its_corners() -> None:
    """A half cylinder of radius R and length 50 mm holds the lens; a plane sees as much of it as its normal does."""
    spec = small_spec(**ALONE)
    radius_mm = spec.constraints.max_radius_mm
    corner_mm = float(np.hypot(radius_mm, 25.0))
    assert spec.lens.extent_mm(spec.constraints) == pytest.approx(corner_mm, rel=1e-12)
    for rise, widest_mm in ((1.0, 1.001 * radius_mm), (0.0, 1.001 * corner_mm), (0.6, 0.8 * corner_mm + radius_mm)):
        extent_mm = spec.lens.extent_mm(spec.constraints, rise)
        assert rise * radius_mm + np.sqrt(1.0 - rise**2) * 25.0 <= extent_mm <= widest_mm


@pytest.mark.parametrize("low", [slice(0, 1), slice(3, 6), slice(8, 9)], ids=["first", "middle", "last"])
def test_a_profile_that_meets_itself_is_refused(low: slice) -> None:
    coefficients = np.full(9, 0.2)
    DrawnFace(10.0, tuple(coefficients.tolist()))
    coefficients[low] = -40.0 if low.stop != 6 else -0.3
    with pytest.raises(lf.InputError, match="meets itself"):
        DrawnFace(10.0, tuple(coefficients.tolist()))
