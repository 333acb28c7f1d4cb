"""What a spec of a road states twice must agree: the lumens of a lamp, and how high it hangs over the plane below."""

from collections.abc import Sequence

import pytest
from scenes import small_spec

from lensforge.spec import Spec
from lensforge.spec.application import application_warnings

ROAD = {"lighting_class": "M4", "width_m": 7.0, "pole_height_m": 8.0, "pole_spacing_m": 30.0}


def _spec(height_mm: float = 8000.0, **changes: object) -> Spec:
    plane = {"kind": "plane", "name": "ground", "centre_mm": [0.0, 0.0, height_mm], "width_mm": 4e4, "height_mm": 4e4}
    disc = {"kind": "rectangle", "width_mm": 3e4, "height_mm": 7e3}
    wide = {"kind": "disc", "diameter_deg": 150.0}
    receivers = [{**plane, "targets": [disc]}, {"kind": "far_field", "half_angle_deg": 90.0, "targets": [wide]}]
    return small_spec().replace(target=None, receivers=receivers, roads=[{**ROAD, **changes}])


def _said(spec: Spec, lenses: int = 16, source_lm: float | None = 250.0) -> Sequence[str]:
    return [*application_warnings(spec.applications, spec.all_receivers, lenses, source_lm)]


@pytest.mark.parametrize(("lamp_lm", "count"), [(4000.0, 0), (4039.0, 0), (4041.0, 1), (9000.0, 1), (None, 0)])
def test_lumens_that_are_stated_twice_agree_within_a_hundredth(lamp_lm: float | None, count: int) -> None:
    messages = _said(_spec(lamp_lm=lamp_lm))
    assert len(messages) == count
    if count:
        assert f"lamp_lm = {lamp_lm:g}, but 16 lenses over 250 lm have 4000 lm" in messages[0]


def test_where_one_is_not_stated_nothing_is_said() -> None:
    assert not _said(_spec(lamp_lm=9000.0), source_lm=None)
    assert not _said(_spec(lamp_lm=9000.0), lenses=1), "as many lenses as the lumens take"


@pytest.mark.parametrize(("height_mm", "count"), [(8000.0, 0), (8079.0, 0), (9000.0, 1)])
def test_the_plane_below_lies_as_far_as_the_poles_are_high(height_mm: float, count: int) -> None:
    messages = _said(_spec(height_mm))
    assert len(messages) == count
    if count:
        assert "receivers: ground lies 9 m below the lamps, pole_height_m of roads is 8" in messages[0]
        assert "z = 8000" in messages[0]
