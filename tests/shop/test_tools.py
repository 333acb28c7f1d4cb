import numpy as np
import pytest
from known_shapes import sampled, sphere
from scenes import sphere as hemisphere
from test_check import lens

from lensforge.shop.check import check_lens
from lensforge.shop.face_samples import AirSide
from lensforge.shop.tool_reach import tool_reach
from lensforge.spec import ManufactureSection, Tool


def mill(radius, shank, length):
    return Tool(name="mill", radius_mm=radius, shank_radius_mm=shank, length_mm=length, holder_half_angle_deg=45.0)


def checked(**manufacture):
    part = lens(hemisphere(0.8), hemisphere(2.45), base="none")
    section = ManufactureSection(cutter_radius_mm=1.0, **manufacture)
    spec = part.spec.model_copy(update={"manufacture": section})
    return check_lens(type(part)(part.surfaces, spec, 0, "draft"))


def test_every_tool_has_its_verdict():
    found = checked(tools=(mill(0.5, 0.4, 8.0), mill(1.0, 1.0, 8.0)), max_tilt_deg=60.0)
    small, large = found.tools
    assert small.faces["inner"].reachable_fraction == 1.0
    assert large.faces["inner"].reachable_fraction == 0.0
    verdicts = [v for v in found.verdicts if v.name == "tool"]
    assert [v.holds for v in verdicts if v.surface == "inner"] == [True, False]
    tilt = next(v for v in found.verdicts if (v.name, v.surface) == ("tilt", "outer"))
    assert not tilt.holds
    assert "90 deg" in tilt.reason


def test_a_mould_insert_swaps_hollow_and_bump():
    found = checked(make="insert")
    assert found.inner.cutter.reachable_fraction == 1.0
    assert found.inner.curvature.kappa_min_per_mm == pytest.approx(1.0 / 0.8, abs=1e-5)
    assert found.outer.cutter.largest_radius_mm == pytest.approx(2.45, abs=1e-5)
    assert found.inner.undercut_fraction == 0.0


def test_a_thick_shank_stops_where_it_meets_the_wall():
    # In a cavity of radius a, a ball of radius R touches at polar angle t with its centre (a - R) sin t off the axis;
    # the shank of radius s > R meets the wall at once where (a - R) sin t + s exceeds the radius at that height.
    a, ball, shank = 3.0, 0.5, 1.5
    samples = sampled(sphere(a), AirSide.INSIDE, nodes=81)
    polar = np.arccos(np.minimum(samples.points[:, 2] / a, 1.0))
    off, height = (a - ball) * np.sin(polar), (a - ball) * np.cos(polar)
    clear = off + shank <= np.sqrt(a**2 - height**2)
    assert 0.0 < samples.fraction(clear) < 1.0
    everywhere, down = np.ones(len(samples.points), dtype=bool), np.array([0.0, 0.0, -1.0])
    found = tool_reach(samples, everywhere, mill(ball, shank, 50.0), down, 0.0, samples.points)
    assert found.reachable_fraction_untilted == pytest.approx(samples.fraction(clear), abs=0.02)
