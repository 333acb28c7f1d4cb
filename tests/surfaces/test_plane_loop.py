"""Loops of lines and arcs: areas by hand, and distances against points set close together along them."""

from math import pi, tan

import numpy as np
import pytest

from lensforge.surfaces.plane_loop import (
    area_mm2,
    box_of_loop,
    circle_at,
    circle_of,
    inside_by_mm,
    loop_of,
    points_on,
    reversed_corners,
)

QUARTER = tan(pi / 8.0)
# An L, off the origin: its inner corner is rounded by 4 mm, which a way around it runs clockwise, an outer one by 6.
L_SHAPE = [
    (-12.0, -10.0, 0.0), (40.0, -10.0, 0.0), (40.0, 8.0, 0.0), (14.0, 8.0, -QUARTER), (10.0, 12.0, 0.0),
    (10.0, 36.0, 0.0), (-6.0, 36.0, QUARTER), (-12.0, 30.0, 0.0),
]  # fmt: skip
SECTOR = [(5.0, 1.0, tan(1.5 * pi / 4.0)), (2.0, -2.0, 0.0), (2.0, 1.0, 0.0)]  # three quarters of a disc about (2, 1)


def test_areas_and_boxes_are_those_by_hand() -> None:
    loop = loop_of(L_SHAPE)
    area = 52.0 * 18.0 + 22.0 * 28.0 + (4.0**2 - 6.0**2) * (1.0 - pi / 4.0)
    assert area_mm2(loop) == pytest.approx(area, rel=1e-14)
    assert area_mm2(loop_of(reversed_corners(L_SHAPE))) == pytest.approx(-area, rel=1e-14)
    assert box_of_loop(loop) == ((-12.0, -10.0), (40.0, 36.0))
    assert area_mm2(loop_of(SECTOR)) == pytest.approx(0.75 * pi * 9.0, rel=1e-14)
    np.testing.assert_allclose(box_of_loop(loop_of(SECTOR)), [(-1.0, -2.0), (5.0, 4.0)], atol=1e-14)
    disc = [(6.0, -2.0, 1.0), (4.0, -2.0, 1.0)]
    assert circle_of(disc) == ((5.0, -2.0), 1.0) and circle_of(SECTOR) is None
    assert area_mm2(loop_of(disc)) == pytest.approx(pi) == area_mm2(circle_at((5.0, -2.0), 1.0))


@pytest.mark.parametrize("corners", [L_SHAPE, reversed_corners(L_SHAPE), SECTOR], ids=["L", "clockwise", "sector"])
def test_distances_are_those_of_many_points_along_the_loop(corners: list[tuple[float, float, float]]) -> None:
    loop = loop_of(corners)
    random = np.random.default_rng(3)
    chain = points_on(loop, 1e-3)
    chain = np.concatenate([np.linspace(a, b, 300) for a, b in zip(chain, np.roll(chain, -1, axis=0), strict=True)])
    low, high = (np.array(corner) for corner in box_of_loop(loop))
    for place in random.uniform(low - 3.0, high + 3.0, (60, 2)):
        ways = (chain - place) @ [1.0, 1.0j]
        turned = np.angle(np.roll(ways, -1) / ways).sum()
        distance = inside_by_mm(loop, (float(place[0]), float(place[1])))
        assert abs(distance) == pytest.approx(np.abs(ways).min(), abs=0.1)
        assert abs(distance) <= np.abs(ways).min() + 1e-3  # the chords are within a micrometre
        assert (distance > 0.0) == (abs(turned) > 1.0)
