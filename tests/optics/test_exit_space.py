"""Étendue from the space that light leaves: view factors of Howell's catalogue, lines one by one, and sums."""

import math

import numpy as np
import pytest

from lensforge.optics.exit_space import ExitBall, ExitColumn
from lensforge.optics.fundamental_limits import cell_solid_angles


def level(side_mm: float, cells: int, height_mm: float, x_mm: float = 0.0) -> np.ndarray:
    """Corners of the cells of a square across the axis, its middle at ``x_mm``."""
    x, y = np.meshgrid(*(np.linspace(-0.5 * side_mm, 0.5 * side_mm, cells + 1),) * 2)
    return np.stack([x + x_mm, y, np.full_like(x, height_mm)], axis=-1)


def within(corners: np.ndarray, radius_mm: float) -> np.ndarray:
    middles = 0.5 * (corners[:-1, :-1] + corners[1:, 1:])
    return np.hypot(middles[..., 0], middles[..., 1]) <= radius_mm


@pytest.mark.parametrize(
    ("mouth_mm", "apart_mm", "disc_mm"), [(18.0, 10.0, 2.0), (8.5, 9.0, 2.5), (5.0, 1.0, 8.0), (10.0, 100.0, 50.0)]
)
def test_between_coaxial_discs_it_is_that_of_their_view_factor(mouth_mm, apart_mm, disc_mm) -> None:
    """Howell's catalogue, C-41; the disc's area by pixels, to their squares."""
    first = mouth_mm / apart_mm
    second = disc_mm / apart_mm
    x = 1.0 + (1.0 + second**2) / first**2
    factor = 0.5 * (x - math.sqrt(x**2 - 4.0 * (second / first) ** 2))
    corners = level(2.0 * disc_mm, 300, 7.0 + apart_mm)
    for upward in (True, False):
        space = ExitColumn(mouth_mm, ((7.0, 7.0),), upward)
        etendue = float((space.etendues(corners, far=False)[0] * within(corners, disc_mm)).sum())
        assert etendue == pytest.approx(math.pi * math.pi * mouth_mm**2 * factor, rel=1e-3)


def lines_that_meet(space: ExitColumn, point: np.ndarray, normal: np.ndarray) -> float:
    """Projected solid angle by 400,000 lines of a hemisphere: where each crosses the cylinder, and the ends."""
    rng = np.random.default_rng(3)
    along = rng.normal(size=(400_000, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    along *= np.sign(along @ normal)[:, None]  # light goes away from the side on which the lens is
    (low, high) = space.slabs_mm[0]
    flat = along[:, :2]
    square = (flat**2).sum(1)
    half = flat @ point[:2]
    root = half**2 - square * (point[:2] @ point[:2] - space.radius_mm**2)
    reach = np.sqrt(np.maximum(root, 0.0))
    ends = np.sort([(low - point[2]) / along[:, 2], (high - point[2]) / along[:, 2]], axis=0)
    first = np.maximum((-half - reach) / square, ends[0])
    last = np.minimum((-half + reach) / square, ends[1])
    met = (root > 0.0) & (last >= first) & ((along[:, 2] > 0.0) | (not space.upward))
    return float(2.0 * math.pi * (np.abs(along @ normal) * met).mean())


@pytest.mark.parametrize("upward", [False, True])
@pytest.mark.parametrize(
    ("slab", "point", "normal"),
    [
        ((3.0, 25.0), (9.0, -14.0, 12.0), (0.3, -0.8, 0.5)),  # beside it, between its ends
        ((3.0, 25.0), (2.0, 3.0, 31.0), (0.4, 0.1, 0.9)),  # over its end
        ((3.0, 25.0), (-30.0, 8.0, 40.0), (-0.9, 0.4, -0.2)),  # a ceiling that leans over it
        ((3.0, 3.0), (0.0, 40.0, 20.0), (0.0, 1.0, 0.0)),  # a wall beside a disc
        ((0.0, 25.0), (5.0, 2.0, 20.0), (0.0, 0.0, 1.0)),  # inside: every line
    ],
)
def test_lines_through_a_point_that_meet_a_column(slab, point, normal, upward) -> None:
    space = ExitColumn(7.0, (slab,), upward)
    unit = np.array(normal) / np.linalg.norm(normal)
    projected = float(space.projected_sr(np.array([point]), unit[None])[0, 0])
    assert projected == pytest.approx(lines_that_meet(space, np.array(point), unit), rel=0.02, abs=1e-3)


def test_a_level_plane_and_a_tilted_one_that_is_level_again_get_the_same() -> None:
    space = ExitColumn(7.0, ((2.0, 9.0), (9.0, 16.0)), True)
    corners = level(60.0, 12, 30.0, 11.0)
    hair = corners + np.array([0.0, 0.0, 1e-6]) * corners[..., :1]  # not level to its bits
    np.testing.assert_allclose(space.etendues(corners, far=False), space.etendues(hair, far=False), rtol=2e-3)


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_a_crooked_cell_is_seen_from_its_middle(tilt: float) -> None:
    """Against 16 x 16 parts of it; no two sides are parallel, so that each of its corners counts."""
    space = ExitColumn(7.0, ((2.0, 16.0),), True)
    places = np.array([[[9.0, -3.0], [13.0, -2.0]], [[9.5, 1.0], [14.5, 3.0]]])
    whole = np.concatenate([places, 24.0 + tilt * places[..., :1]], axis=-1)
    share = np.linspace(0.0, 1.0, 17)
    sides = whole[:1] + share[:, None, None] * (whole[1:] - whole[:1])
    parts = sides[:, :1] + share[:, None] * (sides[:, 1:] - sides[:, :1])
    etendue = float(space.etendues(whole, far=False)[0, 0, 0])
    assert etendue == pytest.approx(float(space.etendues(parts, far=False)[0].sum()), rel=0.005)


@pytest.mark.parametrize(
    "space", [ExitBall(7.0), ExitColumn(7.0, ((3.0, 3.0),), True), ExitColumn(7.0, ((0.0, 20.0),))]
)
def test_all_light_crosses_an_endless_plane(space) -> None:
    """Half of all lines of a ball; of a column by its projection over a hemisphere, pi^2 r (r + h)."""
    total = float(space.flux_upwards_mm2_sr[0])
    assert float(space.etendues(level(2e4, 500, 300.0), far=False).sum()) == pytest.approx(total, rel=0.05)
    ring = np.cos(np.linspace(0.0, 0.5 * math.pi, 2001))
    polar = np.arccos(ring)
    directions = np.stack([np.sin(polar), np.zeros_like(polar), ring], axis=-1)
    shown = np.full(len(polar), math.pi * 49.0) if isinstance(space, ExitBall) else space._shown(directions[None])[0, 0]
    assert float(2.0 * math.pi * np.trapezoid(shown * np.sin(polar), polar)) == pytest.approx(total, rel=1e-4)


def test_in_the_far_field_a_column_shows_its_end_and_its_side() -> None:
    """A cell at 50 degrees from the axis; of a mouth the end alone, and none of it from below."""
    polar = np.radians([[49.9], [50.1]])
    azimuth = np.radians([[29.9, 30.1]])
    corners = np.stack(
        np.broadcast_arrays(np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), axis=-1
    )
    solid = float(cell_solid_angles(corners)[0, 0])
    at = math.radians(50.0)
    end = math.pi * 49.0 * math.cos(at)
    side = 2.0 * 7.0 * 20.0 * math.sin(at)
    column = ExitColumn(7.0, ((0.0, 20.0),))
    mouth = ExitColumn.of_mouth(7.0, 20.0)
    assert float(column.etendues(corners, far=True)[0, 0, 0]) == pytest.approx((end + side) * solid, rel=1e-4)
    assert float(mouth.etendues(corners, far=True).max()) == pytest.approx(end * solid, rel=1e-4)
    down = corners * np.array([1.0, 1.0, -1.0])
    assert float(column.etendues(down, far=True)[0, 0, 0]) == pytest.approx((end + side) * solid, rel=1e-4)
    assert not mouth.etendues(down, far=True).any()


def test_a_mouth_at_any_height_has_the_most_of_all_heights_and_a_little_more() -> None:
    corners = level(6.0, 24, 30.0, 25.0)
    most = max(
        float(ExitColumn(7.0, ((height, height),), True).etendues(corners, far=False).sum())
        for height in np.linspace(0.1, 20.0, 60).tolist()
    )
    etendue = float(ExitColumn.of_mouth(7.0, 20.0).etendues(corners, far=False).sum(axis=(1, 2)).max())
    assert most <= etendue < 1.3 * most
