"""Balls around the triangles of a keep-out: bounds, without which a ray would pass by a triangle that it hits."""

import numpy as np
import pytest

from lensforge.search.keep_out_extent import _GROUP, _in_groups

GROWTH_MM = 0.3


@pytest.mark.parametrize("count", [1, 70])
def test_each_ball_touches_the_farthest_corner_and_each_group_holds_its_balls(count):
    chance = np.random.default_rng(4)
    triangles = chance.uniform(-1.0, 1.0, (count, 1, 3)) + chance.uniform(-2.0, 2.0, (count, 3, 3))
    corners, balls, groups = _in_groups(triangles, GROWTH_MM)
    assert {each.tobytes() for each in corners} == {each.tobytes() for each in triangles}
    distances = np.linalg.norm(corners - balls[:, None, :3], axis=2)
    np.testing.assert_allclose(distances.max(axis=1) + GROWTH_MM, balls[:, 3], rtol=1e-12)
    of_group = np.repeat(groups, _GROUP, axis=0)
    reached = np.linalg.norm(balls[:, :3] - of_group[:, :3], axis=1) + balls[:, 3]
    np.testing.assert_allclose(reached.reshape(-1, _GROUP).max(axis=1), groups[:, 3], rtol=1e-12)
    furthest = np.linalg.norm(groups[:, :3], axis=1) + groups[:, 3]
    assert (np.diff(furthest) <= 0.0).all(), "groups that reach furthest come first"
