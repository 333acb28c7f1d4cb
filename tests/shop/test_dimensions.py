"""Dimensions of a lens between two spheres, in closed form; those of its base are the spec's."""

from math import hypot, sqrt

import numpy as np
import pytest
from known_shapes import sphere
from nightly import first_by_day
from presets import CHECKED
from shop_lenses import BASE, OfSpheres, small_lens

from lensforge.shop.dimensions import dimensions, highest_point_mm

INNER = sphere(3.0, (0.3, -0.2, 0.4))
OUTER = sphere(7.0, (-0.5, 0.4, 0.8))


def sizes(lens):
    return {dimension.name: dimension.value_mm for dimension in dimensions(lens)}


def apex(ball):
    x, y, z = ball.centre
    return z + sqrt(ball.axes[0] ** 2 - x**2 - y**2)


def rim(ball):
    """Distance from the axis, and radius, of the circle in which a sphere meets z = 0."""
    x, y, z = ball.centre
    return hypot(x, y), sqrt(ball.axes[0] ** 2 - z**2)


def test_the_sizes_of_two_spheres_are_in_closed_form():
    lengths = sizes(OfSpheres({"inner": INNER, "outer": OUTER}, small_lens({"kind": "none"}).spec, 0, CHECKED))
    inner, outer = (apex(ball) for ball in (INNER, OUTER))
    assert lengths.pop("outer apex above z = 0") == pytest.approx(outer, abs=1e-12)
    assert lengths.pop("apex of the cavity above z = 0") == pytest.approx(inner, abs=1e-12)
    assert lengths.pop("thickness on the axis") == pytest.approx(outer - inner, abs=1e-12)
    assert lengths.pop("highest point above z = 0") == pytest.approx(0.8 + 7.0, abs=1e-9)
    widest = 2.0 * (rim(OUTER)[0] + 7.0)
    assert lengths.pop("width of the dome") == pytest.approx(widest, abs=1e-6)
    assert lengths.pop("largest width") == pytest.approx(widest, abs=1e-6)
    assert lengths.pop("overall length") == pytest.approx(0.8 + 7.0, abs=1e-9)
    for name, ball in (("outer rim", OUTER), ("opening of the cavity", INNER)):
        _, radius = rim(ball)
        assert lengths.pop(f"{name} in z = 0, along x") == pytest.approx(2.0 * sqrt(radius**2 - ball.centre[1] ** 2))
        assert lengths.pop(f"{name} in z = 0, along y") == pytest.approx(2.0 * sqrt(radius**2 - ball.centre[0] ** 2))
    assert not lengths


def test_a_size_that_is_drawn_ends_where_the_part_does():
    """Ends (z, x) of the rims and of the apexes in the section at y = 0 of two spheres off the axis."""
    lens = OfSpheres({"inner": INNER, "outer": OUTER}, small_lens({"kind": "none"}).spec, 0, CHECKED)
    ends = {dimension.name: dimension.ends for dimension in dimensions(lens) if dimension.ends is not None}
    for name, ball in (("outer rim", OUTER), ("opening of the cavity", INNER)):
        half = sqrt(rim(ball)[1] ** 2 - ball.centre[1] ** 2)
        wanted = ((0.0, ball.centre[0] - half), (0.0, ball.centre[0] + half))
        assert np.array(ends[f"{name} in z = 0, along x"]) == pytest.approx(np.array(wanted)), name
    wanted = ((apex(INNER), 0.0), (apex(OUTER), 0.0))
    assert np.array(ends["thickness on the axis"]) == pytest.approx(np.array(wanted))


@pytest.mark.parametrize(
    ("base", "wanted"),
    first_by_day(2, [
        (
            BASE | {"diameter_mm": 20.0, "height_mm": 3.0, "flange_diameter_mm": 24.0, "flange_height_mm": 1.25}
            | {"pocket_depth_mm": 0.75},
            {"height of the base below z = 0": 3.0, "depth of the relief step below z = 0": 0.4,
             "depth of the pocket": 0.75, "height of the flange": 1.25, "diameter of the base": 20.0,
             "diameter of the pocket": 7.0, "diameter of the flange": 24.0},
        ),
        ({"kind": "square", "side_mm": 18.0}, {"side of the base across x": 18.0, "side of the base across y": 18.0}),
        ({"diameter_mm": 20.0, "flat_mm": 9.5}, {"clocking flat across +x, from the axis": 9.5}),
    ]),
)  # fmt: skip
def test_the_sizes_of_the_base_are_those_of_the_spec(base, wanted):
    drawn = {dimension.name: dimension for dimension in dimensions(small_lens(base))}
    assert {name: drawn[name].value_mm for name in wanted} == pytest.approx(wanted)
    for name, width in (("depth of the pocket", "pocket"), ("height of the flange", "flange")):
        if name in wanted:  # at its wall, on the far side of the axis
            assert {across for _, across in drawn[name].ends} == {-0.5 * wanted[f"diameter of the {width}"]}


@pytest.mark.parametrize(
    ("base", "below", "width"),
    first_by_day(
        2,
        [
            ({"kind": "square", "side_mm": 18.0, "height_mm": 3.0}, 3.0, 18.0 * sqrt(2.0)),
            ({"diameter_mm": 20.0, "flange_diameter_mm": 24.0}, 2.0, 24.0),
            ({"diameter_mm": 11.0}, 2.0, None),
        ],
    ),
)
def test_length_and_width_are_those_of_the_whole_part(base, below, width):
    lengths = sizes(small_lens(base))
    assert lengths["overall length"] == pytest.approx(lengths["highest point above z = 0"] + below)
    assert lengths["largest width"] == pytest.approx(lengths["width of the dome"] if width is None else width)


@pytest.mark.parametrize("ball", [sphere(5.0, (0.7, -0.4, 0.3)), sphere(5.0, (0.0, 0.0, 0.3))])
def test_the_highest_point_is_found_off_the_apex_and_between_the_samples(ball):
    """A sphere is highest above its centre."""
    assert highest_point_mm(ball) == pytest.approx((*ball.centre[:2], 5.3), abs=1e-5)
    assert highest_point_mm(ball)[2] == pytest.approx(5.3, abs=1e-10)
