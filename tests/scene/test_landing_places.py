"""Where rays land, pixels lie and windows end, by hand; and receivers of a spec: pose, size and window of each kind."""

import math

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.kernels.landing import LEAST_RISE
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import PixelGrid, Window, bin_flux, flux_in, gaussian3, splat_flux
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import Cylinder, FarField, Plane, SphericalReceiver, chart_radius, receivers_of

AWRY = (0.3, -0.5, 0.8)
CENTRE = (4.0, -7.0, 9.0)
POSE = Pose.facing(AWRY, CENTRE, 33.0)
GRID = PixelGrid(90.0, 40.0, 6, 4)
UPRIGHT = Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))


def by_hand(receiver: PosedReceiver, x: float, y: float) -> np.ndarray:
    """The point of space at a place on the chart, by arcs and angles."""
    along_x, along_y, along_z = np.array(receiver.pose.axes)
    if receiver.is_flat:
        return np.array(CENTRE) + x * along_x + y * along_y
    if isinstance(receiver, Cylinder):
        arc = x / receiver.radius_mm
        return np.array(CENTRE) + receiver.radius_mm * (math.sin(arc) * along_x + math.cos(arc) * along_z) + y * along_y
    radius = receiver.radius_mm if isinstance(receiver, SphericalReceiver) else 1.0
    polar = 2.0 * math.asin(math.hypot(x, y) / (2.0 * radius))
    azimuth = math.atan2(y, x)
    across = math.cos(azimuth) * along_x + math.sin(azimuth) * along_y
    unit = math.cos(polar) * along_z + math.sin(polar) * across
    return unit if receiver.is_far else np.array(CENTRE) + radius * unit


EVERY = {
    "plane": Plane(POSE, GRID),
    "cylinder": Cylinder(POSE, GRID, radius_mm=50.0),
    "sphere": SphericalReceiver(POSE, GRID, radius_mm=50.0),
    "far field": FarField(Pose.facing(AWRY, (0.0, 0.0, 0.0), 33.0), PixelGrid(1.8, 0.8, 6, 4)),
}
each_receiver = pytest.mark.parametrize("receiver", EVERY.values(), ids=list(EVERY))


@each_receiver
def test_corners_of_pixels_lie_on_the_surface_in_rows_from_below(receiver: PosedReceiver) -> None:
    corners = receiver.corners()
    assert corners.shape == (5, 7, 3)
    width, height = receiver.grid.size
    for row, column in np.ndindex(5, 7):
        wanted = by_hand(receiver, width * (column / 6 - 0.5), height * (row / 4 - 0.5))
        np.testing.assert_allclose(corners[row, column], wanted, atol=1e-12)


def rays(points: np.ndarray, directions: np.ndarray) -> ExitRays:
    fates = np.full(len(points), int(Fate.LEFT_LENS), dtype=np.int8)
    flux = np.ones(len(points))
    return ExitRays(*(np.ascontiguousarray(array) for array in (points, directions, flux, 0.0 * flux, fates)))


def both_landings(receiver: PosedReceiver, points: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hits and whether they landed; the compiled landing and that by arrays agree."""
    exits = rays(points, directions)
    landings = receiver.land(exits)
    by_arrays = receiver.land_by_arrays(exits)
    assert np.array_equal(landings.landed, by_arrays.landed) and np.array_equal(
        landings.missed_receiver, by_arrays.missed_receiver
    )
    assert np.array_equal(landings.missed_receiver, ~landings.landed) and np.array_equal(landings.flux, by_arrays.flux)
    assert np.array_equal(landings.arrived, landings.landed), "all have flux"
    np.testing.assert_allclose(landings.hits, by_arrays.hits, rtol=1e-9, atol=1e-9)
    return landings.hits, landings.landed


def unit(x: float, y: float, z: float) -> np.ndarray:
    return np.array([x, y, z]) / math.sqrt(x * x + y * y + z * z)


def test_a_sphere_is_reached_from_inside_and_from_outside_ahead_but_not_at_its_pole() -> None:
    dome = SphericalReceiver(UPRIGHT, GRID, radius_mm=10.0)
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 30.0], [0.0, 0.0, -30.0], [2.0, 0.0, 9.0], [0.0, 3.0, 0.0]]
    ways = [unit(0.0, 0.0, -1.0), unit(0.0, 1e-3, -1.0), unit(0.0, 0.0, 1.0), unit(0.0, 0.0, 1.0), unit(-1.0, 0.0, 0.0),
            unit(0.0, 0.0, 1.0)]  # fmt: skip
    hits, landed = both_landings(dome, np.array(points), np.array(ways))
    assert landed.tolist() == [False, True, False, True, True, True]
    z = math.sqrt(10.0**2 - 3.0**2)
    assert hits[5] == pytest.approx([0.0, 2.0 * 10.0 * math.sin(0.5 * math.acos(z / 10.0))])
    assert hits[4] == pytest.approx([-2.0 * 10.0 * math.sin(0.5 * math.acos(0.9)), 0.0])


def test_a_cylinder_is_reached_across_its_axis_and_not_along_it() -> None:
    screen = Cylinder(UPRIGHT, GRID, radius_mm=10.0)
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 2.0, 30.0], [3.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    ways = np.array([unit(0.0, 1.0, 0.0), unit(0.0, 1.0, 0.5 * LEAST_RISE), unit(0.0, 0.0, 1.0), unit(0.0, 1.0, 1.0),
                     unit(0.0, 1.0, 1e-6)])  # fmt: skip
    hits, landed = both_landings(screen, points, ways)
    assert landed.tolist() == [False, False, False, True, True]
    z = math.sqrt(10.0**2 - 3.0**2)
    assert hits[3] == pytest.approx([10.0 * math.atan2(3.0, z), 1.0 + z])
    assert hits[4] == pytest.approx([0.0, 1e7])


def test_angles_of_the_far_field_are_those_of_its_chart_and_back() -> None:
    far = EVERY["far field"]
    angles = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, -30.0], [20.0, 40.0], [-120.0, 60.0], [180.0, 0.0]])
    x, y = far.chart_coordinates(*angles.T)
    for (angle_x, angle_y), a, b in zip(angles, x, y, strict=True):
        gamma = math.hypot(angle_x, angle_y)
        assert math.hypot(a, b) == pytest.approx(2.0 * math.sin(math.radians(0.5 * gamma)), abs=1e-15)
        assert a * angle_y == pytest.approx(b * angle_x) and a * angle_x >= 0.0 and b * angle_y >= 0.0
        assert math.hypot(a, b) == pytest.approx(chart_radius(gamma), abs=1e-15)
    np.testing.assert_allclose(np.column_stack(far.target_coordinates(x, y)), angles, atol=1e-6)
    assert far.target_coordinates(np.array([5.0]), np.zeros(1))[0] == pytest.approx(180.0), "the rim, and beyond it"
    for receiver in (EVERY["plane"], EVERY["cylinder"], EVERY["sphere"]):
        np.testing.assert_array_equal(receiver.chart_coordinates(x, y), [x, y])
        np.testing.assert_array_equal(receiver.target_coordinates(x, y), [x, y])


@pytest.mark.parametrize("variance", [0.3, 1.0, 2.5])
def test_pictures_are_filtered_one_by_one_with_their_edges_repeated(variance: float) -> None:
    images = np.random.default_rng(2).random((2, 3, 4))
    filtered = gaussian3(images, variance)
    for image, smooth in zip(images, filtered, strict=True):
        padded = np.pad(image, 1, mode="edge")
        for row, column in np.ndindex(3, 4):
            weights = np.exp(-np.add.outer(np.arange(-1, 2) ** 2, np.arange(-1, 2) ** 2) / (2.0 * variance))
            wanted = np.sum(weights * padded[row : row + 3, column : column + 3]) / weights.sum()
            assert smooth[row, column] == pytest.approx(wanted, rel=1e-12)
    assert gaussian3(images, 0.0) is images


SQUARE = PixelGrid.square(300.0, 32)
WIDE = PixelGrid(400.0, 150.0, 48, 10)  # pixels of 8.33 x 15 mm


def _hits(count: int, reach: float | tuple[float, float] = 140.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.uniform(-1.0, 1.0, (count, 2)) * reach, rng.random(count)


@pytest.mark.parametrize(("grid", "reach"), [(SQUARE, 140.0), (WIDE, (195.0, 67.0))])
def test_splat_keeps_flux_and_its_centroid(grid: PixelGrid, reach: float | tuple[float, float]) -> None:
    hits, flux = _hits(500, reach)
    image = splat_flux(hits, flux, grid)
    assert image.shape == grid.shape
    assert image.sum() == pytest.approx(flux.sum(), rel=1e-13)
    assert image.sum(0) @ grid.x() == pytest.approx((flux * hits[:, 0]).sum(), rel=1e-10)
    assert image.sum(1) @ grid.y() == pytest.approx((flux * hits[:, 1]).sum(), rel=1e-10)


@pytest.mark.parametrize("grid", [SQUARE, WIDE])
def test_bins_agree_with_numpy(grid: PixelGrid) -> None:
    hits, flux = _hits(5000, reach=210.0)
    columns, rows = (np.linspace(-0.5, 0.5, count + 1) for count in (grid.columns, grid.rows))
    edges = grid.height * rows, grid.width * columns
    expected, _, _ = np.histogram2d(hits[:, 1], hits[:, 0], bins=edges, weights=flux)
    assert np.allclose(bin_flux(hits, flux, grid), expected, atol=1e-12)
    assert flux_in(hits, flux, Window(*grid.size)) == pytest.approx(expected.sum(), rel=1e-12)
    assert 0.0 < expected.sum() < flux.sum()


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


KINDS = {"plane": Plane, "cylinder": Cylinder, "sphere": SphericalReceiver, "far_field": FarField}


@pytest.mark.parametrize("kind", list(SECTIONS))
def test_a_receiver_of_a_spec_stands_where_it_says(kind: str) -> None:
    section = SECTIONS[kind]
    (receiver,) = receivers_of(small_spec(target=None, receivers=[section]), 32)
    centre = tuple(section.get("centre_mm", (0.0, 0.0, 0.0)))
    assert type(receiver) is KINDS[kind] and receiver.pose == Pose.facing((0.1, 0.2, 1.0), centre, 25.0)
    side = 2.0 * math.sin(math.radians(20.0)) * (70.0 if kind == "sphere" else 1.0)
    flat = kind in ("plane", "cylinder")
    assert receiver.grid.size == pytest.approx((80.0, 40.0) if flat else (2.0 * side, 2.0 * side))
    window = receiver.window
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
    (receiver,) = receivers_of(small_spec(evaluate__window_mm=60.0), 8)
    assert receiver.window == Window(60.0, 60.0)
    wall = {"kind": "plane", "centre_mm": [0.0, 0.0, 60.0], "width_mm": 80.0, "height_mm": 40.0, "targets": [DISC]}
    (other,) = receivers_of(small_spec(target=None, receivers=[{**wall, "window_mm": [20.0, 10.0]}]), 8)
    assert other.window == Window(20.0, 10.0)
