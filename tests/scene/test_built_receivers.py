"""Receivers of a spec: pose, size and window of each kind, behind a cover glass, and the window of the evaluation."""

import math

import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.scene.pixel_grid import Window
from lensforge.scene.receiver import ReceiverPose
from lensforge.scene.receiver_shapes import receivers_of

DISC = {"kind": "disc", "diameter_mm": 20.0}
SECTIONS = {
    "plane": {"kind": "plane", "centre_mm": [10.0, 20.0, 60.0], "normal": [0.1, 0.2, 1.0], "rotation_deg": 25.0,
              "width_mm": 80.0, "height_mm": 40.0, "targets": [DISC]},
    "cylinder": {"kind": "cylinder", "centre_mm": [1.0, 2.0, 3.0], "facing": [0.1, 0.2, 1.0], "rotation_deg": 25.0,
                 "radius_mm": 70.0, "width_mm": 80.0, "height_mm": 40.0, "targets": [DISC]},
    "sphere": {"kind": "sphere", "centre_mm": [1.0, 2.0, 3.0], "facing": [0.1, 0.2, 1.0], "rotation_deg": 25.0,
               "radius_mm": 70.0, "half_angle_deg": 40.0, "targets": [DISC]},
    "far_field": {"kind": "far_field", "axis": [0.1, 0.2, 1.0], "rotation_deg": 25.0, "half_angle_deg": 40.0,
                  "targets": [{"kind": "beam", "fwhm_deg": 20.0}]},
}  # fmt: skip


@pytest.mark.parametrize("kind", list(SECTIONS))
def test_a_receiver_of_a_spec_stands_where_it_says(kind: str) -> None:
    section = SECTIONS[kind]
    (found,) = receivers_of(small_spec(target=None, receivers=[section]), 32)
    centre = tuple(section.get("centre_mm", (0.0, 0.0, 0.0)))
    assert found.kind == kind and found.pose == ReceiverPose.facing((0.1, 0.2, 1.0), centre, 25.0)
    side = 2.0 * math.sin(math.radians(20.0)) * (70.0 if kind == "sphere" else 1.0)
    flat = kind in ("plane", "cylinder")
    assert found.grid.size == pytest.approx((80.0, 40.0) if flat else (2.0 * side, 2.0 * side))
    window = found.window
    assert (window.width, window.height) == ((80.0, 40.0) if flat else (math.inf, math.inf))
    assert window.radius == (math.inf if flat else pytest.approx(side))


@pytest.mark.parametrize(("distance", "behind"), [(30.0, True), (31.0, True), (29.9, False)])
def test_receivers_stand_behind_the_cover_glass_and_the_far_field_always_does(distance: float, behind: bool) -> None:
    glass = {"distance_mm": 20.0, "thickness_mm": 10.0, "refractive_index": 1.5}
    faces = {"inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}}
    lens = {"levels": [9, 25], **faces, "symmetry": "none", "cover_glass": glass}
    wall = {"kind": "plane", "centre_mm": [0.0, 0.0, distance], "width_mm": 80.0, "height_mm": 40.0, "targets": [DISC]}
    spec = small_spec(target=None, receivers=[wall, {**SECTIONS["far_field"], "name": "sky"}], lens=lens)
    if behind:
        assert len(receivers_of(spec, 8)) == 2
    else:
        with pytest.raises(InputError, match="put all of it behind the glass"):
            receivers_of(spec, 8)


def test_the_window_of_the_evaluation_is_that_of_the_target_s_own_receiver() -> None:
    (found,) = receivers_of(small_spec(evaluate__window_mm=60.0), 8)
    assert found.window == Window(60.0, 60.0)
    wall = {"kind": "plane", "centre_mm": [0.0, 0.0, 60.0], "width_mm": 80.0, "height_mm": 40.0, "targets": [DISC]}
    (other,) = receivers_of(small_spec(target=None, receivers=[{**wall, "window_mm": [20.0, 10.0]}]), 8)
    assert other.window == Window(20.0, 10.0)
