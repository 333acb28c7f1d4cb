"""Places at which limits read the light, and their weights: by loops on oblong pixels, at edges, and along cuts."""

import numpy as np
import pytest
from addon_rows import needs_addon
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.optics.efficacy import Efficacy
from lensforge.optics.pose import Pose
from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.pixel_grid import PixelGrid, bilinear
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import Plane, receivers_of
from lensforge.spec.quantities import BeamAngle, FluxShare, LeastOverMean, LeastOverMost, PlaceLight, RelativeLight

AXIAL = Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0))
WALL = {"kind": "plane", "centre_mm": [0.0, 0.0, 100.0], "width_mm": 120.0, "height_mm": 80.0,
        "targets": [{"kind": "disc", "diameter_mm": 20.0}]}  # fmt: skip
FAR = {"kind": "far_field", "name": "sky", "half_angle_deg": 50.0, "targets": [{"kind": "beam", "fwhm_deg": 30.0}]}


def limits_on(
    *limits: dict, receivers: tuple = (WALL,), pixels: int = 12, lumens: float | None = 250.0
) -> tuple[tuple[LightLimit, ...], list[PosedReceiver]]:
    spec = small_spec(target=None, receivers=list(receivers)).replace(limits=limits)
    built = receivers_of(spec, pixels)
    return light_limits(spec, built, Efficacy(lumens), 2.0), list(built)


def reading(image: np.ndarray, x: float, y: float, size: tuple[float, float]) -> float:
    """Light at a place, linear between the centres of four pixels, and as in the last one beyond it."""
    rows, columns = image.shape
    place = [min(max((value / length + 0.5) * count - 0.5, 0.0), count - 1.0)
             for value, length, count in ((x, size[0], columns), (y, size[1], rows))]  # fmt: skip
    total = 0.0
    for row in range(rows):
        for column in range(columns):
            share = max(0.0, 1.0 - abs(place[0] - column)) * max(0.0, 1.0 - abs(place[1] - row))
            total += share * image[row, column]
    return total


@pytest.mark.parametrize(("columns", "rows"), [(6, 4), (1, 5), (5, 1), (2, 2), (1, 1)])
def test_light_between_pixels_is_bilinear_and_beyond_the_last_that_of_the_last(columns: int, rows: int) -> None:
    receiver = Plane(AXIAL, PixelGrid(120.0, 80.0, columns, rows))
    image = np.random.default_rng(0).random((rows, columns))
    x, y = (
        coordinates.ravel()
        for coordinates in np.meshgrid([-70.0, -60.0, -49.0, 3.0, 50.0, 60.0, 61.0], [-41.0, -33.0, 1.0, 30.0, 40.0])
    )
    read = bilinear(receiver.grid, x, y) @ image.ravel()
    by_hand = [reading(image, place_x, place_y, (120.0, 80.0)) for place_x, place_y in zip(x, y, strict=True)]
    np.testing.assert_allclose(read, by_hand, atol=1e-12)


def test_a_line_is_read_twice_per_pixel_of_either_direction_and_at_both_ends() -> None:
    """Pixels of 10 mm: 3 of them along x and 4 along y are 5 along the line; a point has two places."""
    wall = {**WALL, "height_mm": 160.0}
    for start, end, places in (
        ((-5.0, 2.0), (25.0, 42.0), 11),
        ((3.0, 3.0), (3.0, 3.0), 2),
        ((3.0, 3.0), (3.1, 3.0), 2),
    ):
        line = {"kind": "line", "from_mm": start, "to_mm": end, "unit": "w_per_m2", "at_least": 1.0}
        (limit,), (receiver,) = limits_on(line, receivers=(wall,), pixels=16)
        assert receiver.grid.pixel == (10.0, 10.0)
        x, y = np.meshgrid(receiver.grid.x(), receiver.grid.y())
        light = 7.0 + 0.02 * x - 0.03 * y
        read = limit.of((light * receiver.pixel_measure)[None])[0]
        assert len(read) == places
        xs, ys = (np.linspace(a, b, places) for a, b in zip(start, end, strict=True))
        np.testing.assert_allclose(read, 7.0 + 0.02 * xs - 0.03 * ys, rtol=1e-9)


def test_a_cut_goes_from_rim_to_rim_in_half_pixels() -> None:
    limit = {"kind": "beam_angle", "azimuth_deg": 30.0, "level": 0.25, "at_least_deg": 10.0, "at_most_deg": 90.0}
    (least, most), (receiver,) = limits_on(limit, receivers=(FAR,), pixels=40)
    assert (least.sense, least.bound, most.sense, most.bound) == (">=", 10.0, "<=", 90.0)
    for angle in (least, most):
        assert isinstance(angle.quantity, BeamAngle)
        assert (angle.unit, angle.quantity.level) == ("°", 0.25)
        np.testing.assert_allclose(angle.quantity.angles_deg, np.linspace(-50.0, 50.0, 81), atol=1e-9)
    x, y = receiver.target_coordinates(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    light = 90.0 + x + 0.5 * y
    read = least.of((light * receiver.pixel_measure)[None])[0]
    turn = np.radians(30.0)
    expected = 90.0 + np.linspace(-50.0, 50.0, 81) * (np.cos(turn) + 0.5 * np.sin(turn))
    np.testing.assert_allclose(read[8:-8], expected[8:-8], rtol=3e-3)


def test_zones_and_glare_are_the_pixels_whose_centres_lie_in_them() -> None:
    disc = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 20.0, "centre_mm": [10.0, 0.0]}
    (light, share), (receiver,) = limits_on(
        {"kind": "zone", "zone": disc, "unit": "lx", "at_most": 5.0, "at_most_share": 0.5}
    )
    x, y = np.meshgrid(receiver.grid.x(), receiver.grid.y())
    inside = (np.abs(x - 10.0) <= 30.0) & (np.abs(y) <= 10.0)
    pixels = np.flatnonzero(inside)
    np.testing.assert_allclose(light.readings.toarray(), 250.0 / 1e-4 * np.eye(96)[pixels])
    np.testing.assert_allclose(share.readings.toarray(), inside.ravel()[None] / 2.0)
    assert light.light_per_flux == pytest.approx(250.0 / 1e-4)
    assert (light.unit, light.quantity, share.unit, share.quantity) == ("lx", PlaceLight(), "", FluxShare())
    assert (light.name, light.receiver) == ("limits.0", 0)
    glare = {"kind": "glare", "name": "dazzle", "from_deg": 30.0, "receiver": "sky", "unit": "cd", "at_most": 4.0}
    (dazzle,), both = limits_on(glare, receivers=(WALL, FAR))
    gx, gy = both[1].target_coordinates(*np.meshgrid(both[1].grid.x(), both[1].grid.y()))
    gamma = np.hypot(gx, gy)
    pixels = np.flatnonzero((gamma >= 30.0) & (gamma <= 50.0))
    np.testing.assert_allclose(dazzle.readings.toarray(), 250.0 / both[1].pixel_measure * np.eye(144)[pixels])
    assert (dazzle.name, dazzle.receiver) == ("dazzle", 1)


def test_points_of_the_far_field_read_the_intensity_there_in_candela() -> None:
    """Of 3 + x/10 - y/20 W/sr, x and y in degrees."""
    points = {"kind": "points", "at_deg": [[0, 0], [10, 0], [-12.3, 20]], "unit": "cd", "at_least": 1.0, "at_most": 1e9}
    (least, most), (receiver,) = limits_on(points, receivers=(FAR,), pixels=64)
    x, y = receiver.target_coordinates(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    flux = (3.0 + 0.1 * x - 0.05 * y) * receiver.pixel_measure
    for limit in (least, most):
        np.testing.assert_allclose(limit.of(flux[None])[0], 250.0 * np.array([3.0, 4.0, 3.0 - 1.23 - 1.0]), rtol=1e-3)
    assert (least.sense, most.sense, least.unit, least.quantity) == (">=", "<=", "cd", PlaceLight())
    with pytest.raises(InputError, match=r"limits\.0.*lumens are not known; give source\.flux_lm"):
        limits_on(points, receivers=(FAR,), lumens=None)


def test_a_zone_between_pixels_is_refused() -> None:
    tiny = {"kind": "disc", "diameter_deg": 0.01, "centre_deg": [0.3, 0.3]}
    with pytest.raises(InputError, match="no pixel of the receiver lies in it"):
        limits_on({"kind": "zone", "zone": tiny, "unit": "cd", "at_most": 1.0}, receivers=(FAR,))


@pytest.mark.parametrize(
    ("quantity", "unit", "kind", "scale"),
    [
        ("w_per_m2", "W/m²", PlaceLight(), 1.0),
        ("lx", "lx", PlaceLight(), 250.0),
        ("relative", "", RelativeLight(), 1.0),
        ("min_over_mean", "", LeastOverMean(), 1.0),
        ("min_over_max", "", LeastOverMost(), 1.0),
    ],
)
def test_each_quantity_has_its_unit_and_only_photometric_ones_the_lumens(quantity, unit, kind, scale) -> None:
    light = kind in (PlaceLight(), RelativeLight())
    bound = {"unit": quantity, "at_least": 0.5} if light else {f"at_least_{quantity}": 0.5}
    (limit,), _ = limits_on({"kind": "zone", **bound})
    assert (limit.unit, limit.quantity, limit.sense, limit.bound) == (unit, kind, ">=", 0.5)
    assert limit.light_per_flux == pytest.approx(scale / 1e-4)
    if light:
        (between,), _ = limits_on({"kind": "points", "at_mm": [[1.0, 2.0], [7.0, 3.0]], **bound})
        assert between.light_per_flux == pytest.approx(scale / 1e-4), "bilinear weights add up to 1"


@needs_addon("road")
def test_a_limit_reads_the_receiver_that_it_names_and_a_road_the_lamp_of_all_lenses() -> None:
    """A wall and a far field, 250 lm/W and 2 W; the road's lamp has 24 such LEDs, or the lumens that it states."""
    point = {"kind": "points", "receiver": "sky", "at_deg": [[10.0, 5.0]], "unit": "cd", "at_least": 1.0}
    (limit,), (_, sky) = limits_on(point, receivers=(WALL, FAR))
    assert limit.receiver == 1
    assert limit.of(np.full((1, *sky.grid.shape), 2e-3))[0] == pytest.approx(250.0 * 2e-3 / sky.pixel_measure)
    far = {"kind": "far_field", "half_angle_deg": 90.0, "targets": [{"kind": "beam", "fwhm_deg": 60.0}]}
    road = {"lighting_class": "M3", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0}
    lamps = {"kind": "table", "places_mm": [[0.0, 0.0], [60.0, 0.0], [0.0, 60.0]]}
    light = []
    for fields, more in (({}, {}), ({}, {"photometry": {"lenses": 24}}), ({"lamp_lm": 6000.0}, {"lamps": lamps})):
        spec = small_spec(target=None, receivers=[WALL, far], base={"kind": "none"}, **more).replace(
            roads=[road | fields]
        )
        built = receivers_of(spec, 24)
        first = next(
            limit for limit in light_limits(spec, built, Efficacy(250.0), 2.0) if limit.quantity == PlaceLight()
        )
        assert first.receiver == 1
        light.append(float(first.of(np.ones((1, 24, 24)))[0].mean()))
    assert light[1] == pytest.approx(24.0 * light[0]) and light[2] == pytest.approx(6000.0 / 500.0 * light[0])
