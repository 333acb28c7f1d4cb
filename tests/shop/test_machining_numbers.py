"""Tools, and shares of an area by closed forms and by loops over points; walls of a larger mould."""

from itertools import pairwise

import numpy as np
import pytest
from known_shapes import exported, sampled, sphere
from presets import CHECKED
from scenes import sphere as hemisphere
from test_check import lens

from lensforge.cad.boundary import as_pair
from lensforge.cad.plan import base_corners, lay_out
from lensforge.shop.check import _walls, check_lens
from lensforge.shop.face_samples import AirSide, area_rule
from lensforge.shop.tool_reach import _across, _is_clear, points_on_base, tool_axes, tool_reach
from lensforge.spec import BaseSection, ManufactureSection, Tool


@pytest.mark.parametrize(
    ("most_deg", "tilts"), [(0.0, []), (10.0, [10]), (15.0, [15]), (15.1, [15, 15.1]), (40.0, [15, 30, 40])]
)
def test_axes_are_tried_every_15_degrees_of_tilt_and_30_of_azimuth(most_deg: float, tilts: list[float]) -> None:
    for away in (1.0, -1.0):
        expected = [[0.0, 0.0, away]]
        for tilt in np.deg2rad(tilts):
            for turn in np.deg2rad(30.0) * np.arange(12):
                expected.append([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), away * np.cos(tilt)])
        axes = tool_axes(np.array([0.0, 0.0, away]), np.deg2rad(most_deg))
        np.testing.assert_allclose(axes, expected, atol=1e-12)


TOOL = Tool(name="mill", radius_mm=0.5, shank_radius_mm=0.6, length_mm=2.0, holder_half_angle_deg=30.0)


def clear_by_hand(centre: np.ndarray, axis: np.ndarray, obstacles: np.ndarray) -> bool:
    for point in obstacles:
        along = float((point - centre) @ axis)
        across = float(np.linalg.norm(point - centre - along * axis))
        radius = 0.6 + np.tan(np.deg2rad(30.0)) * max(along - 2.0, 0.0)
        if along > 0.0 and across < radius - 1e-9:
            return False
    return True


@pytest.mark.parametrize(
    "axis", [[0.0, 0.0, 1.0], [0.6, 0.0, -0.8], [2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0], [0.8, 0.6, 0.0]]
)
def test_a_tool_is_clear_where_no_obstacle_is_in_its_shank_or_holder(axis: list[float]) -> None:
    """For 600 ball centres, which are taken in several parts."""
    random = np.random.default_rng(4)
    centres = random.uniform(-3.0, 3.0, (600, 3))
    obstacles = random.uniform(-4.0, 4.0, (12, 3))
    clear = _is_clear(centres, np.array(axis), TOOL, obstacles)
    assert clear.tolist() == [clear_by_hand(centre, np.array(axis), obstacles) for centre in centres]
    assert 50 < clear.sum() < 550
    frame = np.stack([np.array(axis), *_across(np.array(axis))])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("point", "clear"),
    [
        ([0.6, 0.0, 1.0], True), ([0.6 - 1e-6, 0.0, 1.0], False), ([0.0, 0.0, 0.0], True), ([0.0, 0.0, 1e-6], False),
        ([0.6 + np.tan(np.pi / 6.0), 0.0, 3.0], True), ([0.59 + np.tan(np.pi / 6.0), 0.0, 3.0], False),
    ],
)  # fmt: skip
def test_a_tool_that_touches_is_clear(point: list[float], clear: bool) -> None:
    assert _is_clear(np.zeros((1, 3)), np.array([0.0, 0.0, 1.0]), TOOL, np.array([point])).tolist() == [clear]


def test_a_tool_reaches_what_any_of_its_axes_reaches_and_its_ball_fits() -> None:
    samples = sampled(sphere(3.0), AirSide.INSIDE, 15)
    fits = samples.points[:, 0] > -1.0
    down = np.array([0.0, 0.0, -1.0])
    most = np.deg2rad(20.0)
    ceiling = np.random.default_rng(1).uniform(-2.5, 2.5, (40, 3)) * [1.0, 1.0, 0.1] - [0.0, 0.0, 1.0]
    reach = tool_reach(samples, fits, TOOL, down, most, ceiling)
    centres = samples.points + 0.5 * samples.normals
    clear = np.array([[clear_by_hand(centre, axis, ceiling) for centre in centres] for axis in tool_axes(down, most)])
    areas = samples.areas / samples.areas.sum()
    assert reach.ball_reachable_fraction == pytest.approx(areas[fits].sum())
    assert reach.reachable_fraction_untilted == pytest.approx(areas[fits & clear[0]].sum())
    assert reach.reachable_fraction == pytest.approx(areas[fits & clear.any(axis=0)].sum())
    assert 0.0 < reach.reachable_fraction_untilted < reach.reachable_fraction < reach.ball_reachable_fraction


@pytest.mark.parametrize("limit", [0.1, 0.5, 0.77])
def test_the_share_below_a_limit_is_that_of_the_disc_inside_a_circle(limit: float) -> None:
    """Values that rise with the radius, and fall with it; and that are the same all over."""
    rule = area_rule(40, 8)
    radius = np.hypot(*rule.chart.T)
    assert rule.share_below(radius, limit, rule.weights) == pytest.approx(limit**2, abs=2e-3)
    assert rule.share_below(-3.0 * radius, -3.0 * limit, rule.weights) == pytest.approx(1.0 - limit**2, abs=2e-3)
    same = np.full(len(radius), 0.3)
    assert rule.share_below(same, limit, rule.weights) == (1.0 if limit > 0.3 else 0.0)
    half = np.where(rule.chart[:, 1] > 1e-9, 1.0, 0.0) * rule.weights
    assert rule.share_below(rule.chart[:, 0], 0.0, half) == pytest.approx(1.0 / 3.0), "one of three azimuths"


@pytest.mark.parametrize(
    "make", [{"kind": "cylinder", "height_mm": 3.0}, {"height_mm": 2.0, "flange_diameter_mm": 30.0}]
)
def test_the_base_is_an_obstacle_by_rings_between_its_corners(make: dict) -> None:
    """Nine rings of 96 points from each corner of its section to the next, the first one at the azimuth of +x."""
    inner = exported(sphere(1.0), AirSide.INSIDE)
    outer = exported(sphere(2.5), AirSide.OUTSIDE)
    plan = lay_out(inner.patch, outer.patch, BaseSection(**make))
    corners = base_corners(plan)
    turn = np.deg2rad(3.75) * np.arange(96)
    expected = []
    for corner, following in pairwise(corners):
        for ring in range(9):
            for angle in turn:
                start, end = (float(edge.radius(np.array([angle]))[0]) for edge in (corner, following))
                radius = start + (end - start) * ring / 8.0
                depth = corner.depth_mm + (following.depth_mm - corner.depth_mm) * ring / 8.0
                expected.append([radius * np.cos(angle), radius * np.sin(angle), -depth])
    np.testing.assert_allclose(points_on_base(plan), expected, atol=1e-9)
    assert len(points_on_base(plan)) == 9 * 96 * (len(corners) - 1)
    assert points_on_base(plan)[:, 2].min() == pytest.approx(-make["height_mm"])


def test_the_wall_of_a_lens_is_its_own_whatever_is_cut() -> None:
    """Of two spheres, the second 0.1 mm lower: it is thinnest on the axis, thickest in z = 0."""
    spheres = sphere(1.3), sphere(2.6, (0.0, 0.0, -0.1))
    walls = _walls(as_pair(*(exported(ball, AirSide.OUTSIDE).patch for ball in spheres)))
    assert walls.thinnest.thickness_mm == pytest.approx(1.2, abs=1e-8)
    assert walls.thinnest.cavity_point_mm == pytest.approx((0.0, 0.0, 1.3), abs=1e-4)
    assert walls.thinnest.envelope_point_mm == pytest.approx((0.0, 0.0, 2.5), abs=1e-4)
    assert walls.thickest.thickness_mm == pytest.approx(np.sqrt(2.6**2 - 0.01) - 1.3, abs=1e-8)


def mill(radius, shank, length):
    return Tool(name="mill", radius_mm=radius, shank_radius_mm=shank, length_mm=length, holder_half_angle_deg=45.0)


def checked(**manufacture):
    part = lens(hemisphere(0.8), hemisphere(2.45), base="none")
    section = ManufactureSection(**{"process": "milled", "cutter_radius_mm": 1.0, **manufacture})
    spec = part.spec.model_copy(update={"manufacture": section})
    return check_lens(type(part)(part.surfaces, spec, 0, CHECKED))


def test_every_tool_has_its_verdict():
    check = checked(tools=(mill(0.5, 0.4, 8.0), mill(1.0, 1.0, 8.0)), max_tilt_deg=60.0)
    small, large = check.tools
    assert small.faces["inner"].reachable_fraction == 1.0
    assert large.faces["inner"].reachable_fraction == 0.0
    verdicts = [v for v in check.verdicts if v.key == "tool"]
    assert [v.holds for v in verdicts if v.place == "inner"] == [True, False]
    tilt = next(v for v in check.verdicts if (v.key, v.place) == ("tilt", "outer"))
    assert tilt.holds and tilt.value == pytest.approx(0.0, abs=1e-3), "a ball cuts a hemisphere up to its equator"


def test_a_mould_insert_swaps_hollow_and_bump():
    check = checked(process="moulded")
    assert check.inner.cutter.reachable_fraction == 1.0
    assert check.inner.curvature.kappa_min_per_mm == pytest.approx(1.0 / 0.8, abs=1e-5)
    assert check.outer.cutter.largest_radius_mm == pytest.approx(2.45, abs=2e-5)
    assert check.inner.undercut_fraction == 0.0


def test_a_thick_shank_stops_where_it_meets_the_wall():
    # In a cavity of radius a, a ball of radius R touches at polar angle t with its centre (a - R) sin t off the axis;
    # the shank of radius s > R meets the wall at once where (a - R) sin t + s exceeds the radius at that height.
    a = 3.0
    ball = 0.5
    shank = 1.5
    samples = sampled(sphere(a), AirSide.INSIDE, nodes=81)
    polar = np.arccos(np.minimum(samples.points[:, 2] / a, 1.0))
    off = (a - ball) * np.sin(polar)
    height = (a - ball) * np.cos(polar)
    clear = off + shank <= np.sqrt(a**2 - height**2)
    assert 0.0 < samples.fraction(clear) < 1.0
    everywhere = np.ones(len(samples.points), dtype=bool)
    down = np.array([0.0, 0.0, -1.0])
    reach = tool_reach(samples, everywhere, mill(ball, shank, 50.0), down, 0.0, samples.points)
    assert reach.reachable_fraction_untilted == pytest.approx(samples.fraction(clear), abs=0.02)
