import numpy as np
import pytest
from known_shapes import exported, sampled, sphere

from lensforge.cad.plan import lay_out
from lensforge.shop.ball_clearance import check_ball_clearance, wall_retreat_mm
from lensforge.shop.face_check import check_face
from lensforge.shop.face_samples import AirSide
from lensforge.shop.findings import clearance_findings
from lensforge.spec import BaseSection

DOME, BALL = 2.45, 1.0
DEEP = 10.0  # mm: deeper than any ball reaches


def test_a_step_s_wall_stands_back_from_an_undercut_rim_by_the_versine_of_its_draft():
    # Of a sphere about (0, 0, c) the rim leans by asin(c/r): the ball's centre is R cos of it away from the wall.
    radius, up, ball = 3.0, 1.0, 0.5
    clearance = wall_retreat_mm(sampled(sphere(radius, (0.0, 0.0, up)), AirSide.OUTSIDE), ball, DEEP)
    assert clearance.max() == pytest.approx(ball * (1.0 - np.sqrt(1.0 - (up / radius) ** 2)), rel=1e-4)
    assert (wall_retreat_mm(sampled(sphere(radius, (0.0, 0.0, -up)), AirSide.OUTSIDE), ball, DEEP) == 0.0).all()


def outer_relief(outer, **sizes):
    """Relief and its finding on a base below ``outer`` and a cavity of 0.8 mm, for the ball of 1 mm."""
    base = BaseSection(**sizes)
    inner, outer = exported(sphere(0.8), AirSide.INSIDE), exported(outer, AirSide.OUTSIDE)
    faces = {"inner": check_face(inner, BALL, 31), "outer": check_face(outer, BALL, 31)}
    relief = check_ball_clearance(lay_out(inner.patch, outer.patch, base), None, faces)
    return relief.faces["outer"], clearance_findings(relief, base)[1]


def test_a_flange_in_the_way_wants_a_higher_base_not_a_step():
    """The ball beside the rim reaches 1 mm down; the flange's top is at 0.7 mm."""
    sizes = {"height_mm": 1.2, "flange_diameter_mm": 10.0, "flange_height_mm": 0.5}
    relief, finding = outer_relief(sphere(DOME), diameter_mm=2.0 * DOME - 0.1, **sizes)
    assert relief.smallest_step_mm == 0.0
    assert relief.flange_clearance_mm == pytest.approx(0.3, abs=1e-6)
    assert "base.height_mm = 1.5" in finding.reason
    assert "relief_step_mm" not in finding.reason and not finding.holds
    assert finding.reason.endswith("a smaller base.flange_diameter_mm may clear it")
    relief, finding = outer_relief(sphere(DOME), diameter_mm=6.0, **sizes)
    assert relief.smallest_step_mm == pytest.approx(np.sqrt(1.0 - (DOME + BALL - 3.0) ** 2), abs=1e-6)
    assert "base.relief_step_mm = 0.8931 and base.height_mm = 1.5" in finding.reason


def test_below_an_undercut_dome_on_a_narrower_base_only_the_step_has_a_wall():
    """A rim of 2.83 mm that leans outwards, on a base of 2 mm radius."""
    undercut = sphere(3.0, (0.0, 0.0, 1.0))
    clearance = BALL * (1.0 - np.sqrt(1.0 - (1.0 / 3.0) ** 2))
    for base, wall_mm in (({}, 0.0), ({"relief_step_mm": 0.5}, clearance)):
        relief, _ = outer_relief(undercut, diameter_mm=4.0, height_mm=2.0, **base)
        assert relief.step_clearance_mm == pytest.approx(wall_mm, abs=1e-4)
    wide, _ = outer_relief(undercut, diameter_mm=25.4, height_mm=2.0)
    assert wide.step_clearance_mm == pytest.approx(clearance, abs=1e-4)
