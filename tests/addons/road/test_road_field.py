"""Roads: luminance, glare and edges against plain loops, and in closed form; tables of surfaces as published."""

from math import atan2, ceil, cos, degrees, hypot, radians, sin, sqrt, tan

import numpy as np
import pytest

from lensforge.addons.road.road_classes import THRESHOLD_INCREMENT, VEILING_RATIO, requirements_of
from lensforge.addons.road.road_field import DriverView, RoadReadings
from lensforge.addons.road.road_section import STANDARD_SURFACES, RoadSection
from lensforge.addons.road.road_surface import RoadSurface, read_surface
from lensforge.errors import InputError
from lensforge.scene.intensity_limit import CandelaSum, IntensityLimit
from lensforge.spec.quantities import LeastOverMean, LeastOverMost, MeanOverLeast, MostOverLeast, PlaceLight

ROAD = {"lighting_class": "M3", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 33.0}
# Specular factors S1 as published: CIE 144:2001; of W4 that of its table, within the limits of its class, 9.8 and 12.
_S1 = {"R1": 0.25, "R2": 0.58, "R3": 1.11, "R4": 1.55, "C1": 0.24, "C2": 0.97, "W4": 10.84}


def _candela(azimuth_deg, gamma_deg):
    """A lamp without any symmetry, down to 0 at 95 degrees."""
    turn = np.radians(azimuth_deg)
    gamma = np.radians(gamma_deg)
    wide = 1.0 + 0.6 * np.cos(turn - 0.4) * np.sin(gamma) + 0.3 * np.sin(2.0 * turn + 0.2) * np.sin(gamma) ** 2
    return 1000.0 * wide * np.clip((95.0 - gamma_deg) / 95.0, 0.0, None) ** 0.4


def _of(light: CandelaSum, mirror: float = 1.0) -> np.ndarray:
    """Light by that lamp, or by its mirror image."""
    return light.of(_candela(mirror * light.azimuth_deg, light.gamma_deg)[None])[0]


def _lamps(road: RoadSection):
    """(x, y, +1 or -1) of all lamps near the field, one after the other."""
    width = road.width_m
    over = road.overhang_m
    spacing = road.pole_spacing_m
    for k in range(-25, 40):
        if road.arrangement in ("right", "opposite", "staggered"):
            yield k * spacing, over, 1
        if road.arrangement in ("left", "opposite", "median"):
            yield k * spacing, width - over, -1
        if road.arrangement == "staggered":
            yield (k + 0.5) * spacing, width - over, -1
        if road.arrangement == "median":
            yield k * spacing, width + road.median_m + over, 1


def _intensity(road: RoadSection, lamp, x: float, y: float, z: float) -> float:
    """By the three axes of a lamp: to its street, along the road, and its own."""
    lx, ly, facing = lamp
    to = np.array([x - lx, y - ly, z - road.pole_height_m])
    t = radians(road.tilt_deg)
    street = np.array([0.0, facing * cos(t), sin(t)])
    axis = np.array([0.0, facing * sin(t), -cos(t)])
    along = np.cross(axis, street)
    a = to @ street
    b = to @ along
    c = to @ axis
    return float(_candela(degrees(atan2(b, a)), degrees(atan2(hypot(a, b), c))))


def _r(surface: RoadSurface, beta: float, tan_gamma: float) -> float:
    if tan_gamma > surface.tan_gamma[-1]:
        return 0.0
    rows = [np.interp(tan_gamma, surface.tan_gamma, column) for column in surface.r.T]
    return float(np.interp(beta, surface.beta_deg, rows))


def _plain_luminance(road: RoadSection, surface: RoadSurface, eye_y: float) -> list[float]:
    count = max(10, ceil(road.pole_spacing_m / 3.0))
    luminances = []
    for row in range(3 * road.lanes):
        y = (row + 0.5) * road.width_m / (3 * road.lanes)
        for step in range(count):
            luminances.append(_plain_luminance_at(road, surface, eye_y, (step + 0.5) * road.pole_spacing_m / count, y))
    return luminances


def _plain_luminance_at(road: RoadSection, surface: RoadSurface, eye_y: float, x: float, y: float) -> float:
    total = 0.0
    high = road.pole_height_m
    for lamp in _lamps(road):
        dx, dy = lamp[0] - x, lamp[1] - y
        if not (-5.0 * high <= dx <= 12.0 * high and abs(dy) <= 5.0 * high):
            continue
        view = np.array([x + 60.0, y - eye_y])
        cosine = view @ [dx, dy] / (np.linalg.norm(view) * hypot(dx, dy))
        beta = degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        total += _intensity(road, lamp, x, y, 0.0) * _r(surface, beta, hypot(dx, dy) / high) / high**2
    return total


def _plain_veil(road: RoadSection, eye_y: float) -> list[float]:
    count = max(10, ceil(road.pole_spacing_m / 3.0))
    veils = []
    for step in range(count):
        x = step * road.pole_spacing_m / count - 2.75 * (road.pole_height_m - 1.5)
        total = 0.0
        for lamp in _lamps(road):
            to = np.array([lamp[0] - x, lamp[1] - eye_y, road.pole_height_m - 1.5])
            if not 0.0 < to[0] <= 500.0 or to[2] > tan(radians(20.0)) * to[0]:
                continue
            away = sqrt(to @ to)
            cosine = to @ [cos(radians(1.0)), 0.0, -sin(radians(1.0))] / away
            theta = degrees(np.arccos(cosine))
            eye_lx = _intensity(road, lamp, x, eye_y, 1.5) * cosine / away**2
            if theta >= 1.5:
                total += 9.86 * (1.0 + (23.0 / 66.4) ** 4) * eye_lx / theta**2 if theta <= 60.0 else 0.0
            else:
                total += eye_lx * (10.0 / theta**3 + 5.0 / theta**2 * (1.0 + (23.0 / 62.5) ** 4))
        veils.append(total)
    return veils


def _plain_mean_lux(road: RoadSection, low: float, high: float, step_m: float = 3.0) -> float:
    along = max(10, ceil(road.pole_spacing_m / step_m))
    across = max(3, ceil((high - low) / 1.5 - 1e-9))
    total = 0.0
    up = road.pole_height_m
    for x in (np.arange(along) + 0.5) * road.pole_spacing_m / along:
        for y in low + (np.arange(across) + 0.5) * (high - low) / across:
            for lamp in _lamps(road):
                away = hypot(lamp[0] - x, lamp[1] - y)
                if away <= 5.0 * up:
                    total += _intensity(road, lamp, x, y, 0.0) * up / hypot(away, up) ** 3
    return total / (along * across)


@pytest.mark.parametrize(
    ("arrangement", "overhang_m", "tilt_deg", "lanes", "surface", "more"),
    [
        ("right", 0.0, 0.0, 2, "R3", {}),
        ("left", 1.2, 10.0, 3, "C2", {}),
        ("opposite", -0.5, 5.0, 2, "R1", {}),
        ("staggered", 0.7, -4.0, 1, "R4", {"pole_height_m": 4.0}),  # far lamps within 1.5 degrees of the line of sight
        ("median", -1.5, 15.0, 2, "R2", {"median_m": 4.0}),
        ("right", 0.0, 0.0, 1, "R1", {"pole_height_m": 5.0, "pole_spacing_m": 20.0}),  # a lamp just 5 heights before
    ],
)
def test_a_road_as_plain_loops_have_it(arrangement, overhang_m, tilt_deg, lanes, surface, more) -> None:
    fields = {"arrangement": arrangement, "overhang_m": overhang_m, "tilt_deg": tilt_deg, "lanes": lanes} | more
    road = RoadSection(**ROAD | fields, surface=surface, surface_q0=0.085)
    readings = RoadReadings.of(road)
    table = RoadSurface.of(surface, q0=0.085)
    for lane in range(lanes):
        eye_y = (lane + 0.5) * road.lane_m
        np.testing.assert_allclose(_of(readings.luminance[lane]), _plain_luminance(road, table, eye_y), rtol=1e-9)
        np.testing.assert_allclose(_of(readings.veiling[lane]), _plain_veil(road, eye_y), rtol=1e-9)
    middle = np.repeat((np.arange(3 * lanes) + 0.5) * road.lane_m / 3, readings.along)[readings.middle(lanes - 1)]
    np.testing.assert_allclose(middle, (lanes - 0.5) * road.lane_m)
    lane_m = road.lane_m
    pairs = (((-lane_m, 0.0), (0.0, lane_m)), ((7.0, 7.0 + lane_m), (7.0 - lane_m, 7.0)))
    for edge, strips in zip(readings.edges, pairs, strict=True):
        np.testing.assert_allclose(_of(edge), [_plain_mean_lux(road, *ends) for ends in strips], rtol=1e-9)
    assert _of(readings.illuminance.mean()).item() == pytest.approx(_plain_mean_lux(road, 0.0, 7.0), rel=1e-9)


@pytest.mark.parametrize(
    "more",
    [
        {"surface": "R3"},
        {"arrangement": "left", "overhang_m": 1.2, "tilt_deg": 10.0, "lanes": 3, "surface": "C2"},
        {"arrangement": "opposite", "overhang_m": -0.5, "tilt_deg": 5.0, "surface": "R1", "oncoming_lanes": 1},
        {"arrangement": "staggered", "overhang_m": 0.7, "tilt_deg": -4.0, "surface": "R4", "driving_side": "left"},
        {"arrangement": "median", "overhang_m": -1.5, "tilt_deg": 15.0, "surface": "R2", "median_m": 4.0},
        {"lighting_class": "collector low", "lanes": 3, "oncoming_lanes": 1, "tilt_deg": 6.0, "overhang_m": 0.8},
        {"lighting_class": "P3", "tilt_deg": 6.0, "overhang_m": 0.8, "arrangement": "staggered"},
    ],
)
def test_the_mean_of_a_field_is_the_sum_over_directions(more) -> None:
    """Both are one integral: by points of the standard, and by directions of a lamp whose street is at 40 degrees."""
    road = RoadSection(**ROAD | {"lanes": 2, "maintenance_factor": 0.7, "pole_spacing_m": 12.0} | more)
    z = (np.arange(1000) + 0.5) / 1000
    turn = 2.0 * np.pi * (np.arange(2000) + 0.5) / 2000
    z, turn = (coordinates.ravel() for coordinates in np.meshgrid(z, turn))
    units = np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=1)
    lumens = _candela(np.degrees(turn) - 40.0, np.degrees(np.arccos(z))) * 2.0 * np.pi / len(z)
    asks = [ask for ask in requirements_of(RoadReadings.of(road)) if ask.most is not None]
    assert len(asks) == {"P3": 2, "collector low": 2}.get(road.lighting_class, road.lanes)
    for ask in asks:
        assert lumens @ ask.most.per_lumen(units, 40.0) == pytest.approx(_of(ask.light).mean(), rel=0.02), ask.name


# The luminance method of RP-8 as loops: angles from the vectors of sight and light, veiling luminance for each edition.
_VEIL = {
    "RP-8-00": lambda theta: 10.0 / (theta * theta + 1.5 * theta),
    "RP-8-14": lambda theta: 10.0 / theta ** (2.3 - 0.7 * np.log10(theta) if theta < 2.0 else 2.0),
}


def _by_rp8(road: RoadSection, ways) -> list[tuple[np.ndarray, np.ndarray]]:
    """Luminance and veiling luminance of all points of each direction, (heading, lanes from the right)."""
    table = RoadSurface.of(road.surface)
    readings = []
    count = max(10, ceil(road.pole_spacing_m / 5.0))
    for heading, lanes in ways:
        light = []
        veil = []
        for y in [(lane + quarter) * road.lane_m for lane in lanes for quarter in (0.25, 0.75)]:
            for x in (np.arange(count) + 0.5) * road.pole_spacing_m / count:
                total = 0.0
                high = road.pole_height_m
                for lamp in _lamps(road):
                    ahead = heading * (lamp[0] - x)
                    aside = lamp[1] - y
                    r = _r(table, degrees(abs(atan2(aside, ahead))), hypot(ahead, aside) / high)
                    total += _intensity(road, lamp, x, y, 0.0) * r / high**2
                light.append(total)
                veil.append(_rp8_veil(road, heading, x - 83.07 * heading, y))
        readings.append((np.array(light), np.array(veil)))
    return readings


def _rp8_veil(road: RoadSection, heading: float, x: float, y: float) -> float:
    total = 0.0
    for lamp in _lamps(road):
        to = np.array([heading * (lamp[0] - x), lamp[1] - y, road.pole_height_m - 1.45])
        if not 0.0 < to[0] <= 500.0:
            continue
        cosine = to @ [cos(radians(1.0)), 0.0, -sin(radians(1.0))] / np.linalg.norm(to)
        theta = degrees(np.arccos(cosine))
        if theta <= 90.0:
            total += _intensity(road, lamp, x, y, 1.45) * cosine / (to @ to) * _VEIL[road.standard](theta)
    return total


@pytest.mark.parametrize(
    ("fields", "ways"),
    [
        ({"lanes": 2}, [(1.0, [0, 1])]),
        ({"lanes": 3, "arrangement": "opposite", "edition": "RP-8-00", "oncoming_lanes": 1}, [(1, [0, 1]), (-1, [2])]),
        ({"lanes": 3, "pole_spacing_m": 62.0, "driving_side": "left", "oncoming_lanes": 1}, [(1, [1, 2]), (-1, [0])]),
        ({"lanes": 2, "pole_height_m": 4.0, "surface": "R2"}, [(1.0, [0, 1])]),  # far lamps within 2 degrees
        # lamps 5 to 5.5 heights before a point, and beside it: the table ends only there
        ({"lanes": 2, "pole_height_m": 5.2, "oncoming_lanes": 1}, [(1, [0]), (-1, [1])]),
        ({"lanes": 2, "pole_height_m": 4.0, "arrangement": "median", "median_m": 13.5}, [(1.0, [0, 1])]),
    ],
)  # fmt: skip
def test_a_road_by_rp_8_as_plain_loops_have_it(fields, ways) -> None:
    road = RoadSection(**ROAD | {"lighting_class": "collector low", "overhang_m": 0.8, "tilt_deg": 6.0} | fields)
    readings = RoadReadings.of(road)
    wanted = _by_rp8(road, ways)
    assert len(readings.luminance) == len(readings.veiling) == len(ways)
    for seen, veiling, lux, rows, (light, veil), (_, lanes) in zip(
        readings.luminance, readings.veiling, readings.seen_lux, readings.rows, wanted, ways, strict=True
    ):
        ends = lanes[0] * road.lane_m, (lanes[-1] + 1) * road.lane_m
        assert _of(lux).item() == pytest.approx(_plain_mean_lux(road, *ends, step_m=5.0), rel=1e-9)
        np.testing.assert_allclose(_of(seen), light, rtol=1e-9)
        np.testing.assert_allclose(_of(veiling), veil, rtol=1e-9)
        np.testing.assert_allclose(rows, [(lane + part) * road.lane_m for lane in lanes for part in (0.25, 0.75)])
    assert readings.wet == ()


# The bounds typed a second time: Lavg (cd/m²), Lavg/Lmin, Lmax/Lmin, Lv/Lavg.
_RP8 = {
    "freeway A": (0.6, 3.5, 6, 0.3), "freeway B": (0.4, 3.5, 6, 0.3), "expressway": (1.0, 3, 5, 0.3),
    "major high": (1.2, 3, 5, 0.3), "major medium": (0.9, 3, 5, 0.3), "major low": (0.6, 3.5, 6, 0.3),
    "collector high": (0.8, 3, 5, 0.4), "collector medium": (0.6, 3.5, 6, 0.4), "collector low": (0.4, 4, 8, 0.4),
    "local high": (0.6, 6, 10, 0.4), "local medium": (0.5, 6, 10, 0.4), "local low": (0.3, 6, 10, 0.4),
}  # fmt: skip


@pytest.mark.parametrize("name", _RP8)
def test_a_class_of_rp_8_asks_for_its_ratios(name: str) -> None:
    asks = list(
        requirements_of(RoadReadings.of(RoadSection(**ROAD | {"lighting_class": name, "maintenance_factor": 0.7})))
    )
    assert [(requirement.quantity, requirement.sense) for requirement in asks] == [
        (PlaceLight(), ">="), (MeanOverLeast(), "<="), (MostOverLeast(), "<="), (VEILING_RATIO, "<=")
    ]  # fmt: skip
    assert tuple(requirement.bound for requirement in asks) == _RP8[name]
    assert _of(asks[0].light).item() == pytest.approx(0.7 * _of(asks[1].light).mean())
    road = RoadSection(**ROAD | {"lighting_class": name, "uniformity": 0.5, "mean_cd_per_m2": 2.0, "oncoming_lanes": 1})
    both = list(requirements_of(RoadReadings.of(road.model_copy(update={"luminance_per_lux": 0.07}))))
    assert (
        [requirement.bound for requirement in both[:2]] == [2.0, 2.0]
        and both[3].bound == 0.07
        and road.standard == "RP-8-14"
    )
    assert [requirement.name for requirement in both[5:]] == [
        f"oncoming: {requirement.name}" for requirement in both[:5]
    ]


def test_a_driver_sees_by_a_pinhole_60_m_before_the_field() -> None:
    """Straight ahead at d the road lies 1.5/d below the horizon; lines along it meet there; what is aside is y/d."""
    road = RoadSection(**ROAD, lanes=2)
    ahead = np.array([20.0, 60.0, 93.0, 1e9])
    for lane, eye_y in ((0, 1.75), (1, 5.25)):
        view = DriverView(road, lane)
        straight = view.seen(ahead - 60.0, np.full(4, eye_y), np.zeros(4))
        np.testing.assert_allclose(straight, np.stack([np.zeros(4), -1.5 / ahead], axis=1), atol=1e-15)
        lamps = view.seen(ahead - 60.0, np.zeros(4), np.full(4, 9.0))
        np.testing.assert_allclose(lamps, np.stack([eye_y / ahead, 7.5 / ahead], axis=1))  # of the right edge
    x, y = np.array([-45.0, -20.0, 10.0, 140.0]), np.array([0.4, 3.0, 6.9, 2.0])  # nearer than the field, in it, beyond
    wanted = [_plain_luminance_at(road, RoadSurface.of("R3"), 5.25, *place) for place in zip(x, y, strict=True)]
    np.testing.assert_allclose(_of(DriverView(road, 1).luminance(x, y)), wanted, rtol=1e-9)


@pytest.mark.parametrize(
    ("fields", "lamp_y", "foot_y"),
    [
        ({"overhang_m": 1.0}, [1.0], [0.0]),
        ({"overhang_m": -1.0, "arrangement": "left"}, [8.0], [8.0]),
        ({"overhang_m": 1.0, "arrangement": "opposite"}, [1.0, 6.0], [0.0, 7.0]),
        ({"overhang_m": 0.5, "arrangement": "median", "median_m": 3.0}, [6.5, 10.5], [8.5, 8.5]),
    ],
)
def test_poles_stand_beside_the_road(fields, lamp_y, foot_y) -> None:
    x, y, foot = DriverView(RoadSection(**ROAD, **fields), 0).lamps(59.0, 61.0)
    assert (list(x), list(y), list(foot)) == ([0.0] * len(lamp_y), lamp_y, foot_y)


@pytest.mark.parametrize(
    ("arrangement", "image", "more"),
    [
        ("right", "left", {"oncoming_lanes": 1}),
        ("opposite", "opposite", {"overhang_m": -0.5, "oncoming_lanes": 2}),
        ("staggered", "staggered", {"tilt_deg": 5.0}),
        ("median", "median", {"median_m": 3.0, "overhang_m": 0.4}),
    ],
)
def test_the_mirror_image_of_a_road_has_the_mirror_image_of_its_figures(arrangement, image, more) -> None:
    """With lamps that are mirror images, too, each driver sees in the same lane what the other does, left for right."""
    fields = ROAD | {"width_m": 9.6, "lanes": 3} | more
    original = RoadReadings.of(RoadSection(**fields, arrangement=arrangement))
    mirror = RoadReadings.of(RoadSection(**fields, arrangement=image, driving_side="left"))
    for lane in range(3):
        seen = _of(original.luminance[lane]).reshape(9, -1)
        mirrored = _of(mirror.luminance[lane], -1.0).reshape(9, -1)
        np.testing.assert_allclose(mirrored[::-1], seen, rtol=1e-9)
        np.testing.assert_allclose(_of(mirror.veiling[lane], -1.0), _of(original.veiling[lane]), rtol=1e-9)
        middle, wanted = (readings.luminance[lane].places(readings.middle(lane)) for readings in (mirror, original))
        np.testing.assert_allclose(_of(middle, -1.0), _of(wanted), rtol=1e-9)
    np.testing.assert_allclose(_of(mirror.illuminance, -1.0).reshape(7, -1)[::-1].ravel(), _of(original.illuminance))
    for edge, wanted in zip(mirror.edges, original.edges[::-1], strict=True):
        np.testing.assert_allclose(_of(edge, -1.0), _of(wanted), rtol=1e-9)
    poles = [DriverView(readings.road, 0).lamps(59.0, 61.0)[2] for readings in (original, mirror)]
    np.testing.assert_allclose(np.sort(9.6 - poles[1]), np.sort(poles[0]))


@pytest.mark.parametrize("driving_side", ["right", "left"])
def test_who_comes_the_other_way_sees_the_road_turned_by_half_a_turn(driving_side) -> None:
    """Their driver, in the last lane, has the lamps of the right edge at the left; the lamps stay as they are."""
    fields = ROAD | {"overhang_m": 0.6, "tilt_deg": 5.0, "driving_side": driving_side}
    road = RoadSection(**fields, arrangement="right", oncoming_lanes=1)
    both = RoadReadings.of(road)
    turned = RoadReadings.of(RoadSection(**fields, arrangement="left"))
    np.testing.assert_allclose(_of(both.luminance[1])[::-1], _of(turned.luminance[0]), rtol=1e-9)
    np.testing.assert_allclose(_of(both.veiling[1]), _of(turned.veiling[0]), rtol=1e-9)
    alone = RoadReadings.of(RoadSection(**fields, arrangement="right"))
    np.testing.assert_array_equal(_of(both.luminance[0]), _of(alone.luminance[0]))
    assert abs(_of(both.veiling[1]).max() / _of(alone.veiling[1]).max() - 1.0) > 0.01
    x, y, z = np.array([20.0]), np.array([2.0]), np.array([6.0])
    there = DriverView(road, 1)
    here = DriverView(turned.road, 0)
    np.testing.assert_allclose(there.seen(33.0 - x, 7.0 - y, z), here.seen(x, y, z))
    np.testing.assert_allclose(_of(there.luminance(33.0 - x, 7.0 - y)), _of(here.luminance(x, y)))
    for one, other in zip(there.lamps(10.0, 100.0)[1:], here.lamps(10.0, 100.0)[1:], strict=True):
        np.testing.assert_allclose(7.0 - one, other)


def test_an_even_lamp_over_a_surface_that_looks_alike_from_everywhere(tmp_path) -> None:
    """r = q cos^3: the luminance is q times the illuminance, here of lamps of 500 cd in all directions."""
    tan_gamma = np.append(np.linspace(0.0, 12.0, 2401), 13.0)
    beta = [0.0, 90.0, 180.0]
    q = 0.08
    rows = [f"{t},{','.join(3 * [str(1e4 * q * (1.0 + t * t) ** -1.5)])}" for t in tan_gamma]
    path = tmp_path / "alike.csv"
    path.write_text("\n".join([f"tan_gamma,{','.join(map(str, beta))}", *rows]))
    assert read_surface(path).q0 == pytest.approx(q, rel=1e-5)
    road = RoadSection(**ROAD, surface_file=path, arrangement="opposite")
    for lane, light in enumerate(RoadReadings.of(road).luminance):
        luminance = light.of(np.full((1, len(light.gamma_deg)), 500.0))[0].reshape(6, 11)
        for row, x in ((0, 1.5), (3, 16.5), (5, 31.5)):
            y = (row + 0.5) * 7.0 / 6
            lamps = [(33.0 * k - x, edge - y) for k in range(-9, 10) for edge in (0.0, 7.0)]
            counted = [(dx, dy) for dx, dy in lamps if -45.0 <= dx <= 108.0]
            lux = sum(500.0 * 9.0 / (dx * dx + dy * dy + 81.0) ** 1.5 for dx, dy in counted)
            assert luminance[row, int(x / 3.0)] == pytest.approx(q * lux, rel=2e-5), lane


@pytest.mark.parametrize("name", STANDARD_SURFACES)
def test_the_tables_have_the_published_lightness_and_gloss(name: str) -> None:
    surface = RoadSurface.of(name)
    assert round(surface.s1, 2) == _S1[name]
    assert surface.q0 == STANDARD_SURFACES[name]
    assert 1.0 < surface.integrated_q0() / surface.q0 < 1.03
    scaled = RoadSurface.of(name, q0=0.05)
    assert scaled.q0 == 0.05
    assert scaled.integrated_q0() == pytest.approx(0.05 * surface.integrated_q0() / surface.q0)
    assert surface.reading(np.array([0.0]), np.array([12.1])).item() == 0.0
    smooth = np.log(surface.r[:15])  # a wrong digit stands out among its neighbours
    assert np.abs(np.diff(smooth[:, :3], 2, axis=0)).max() < 0.32


def test_a_wet_road_must_be_even_for_every_driver(tmp_path) -> None:
    fields = ROAD | {"lanes": 2, "maintenance_factor": 0.8}
    wet = RoadReadings.of(RoadSection(**fields, wet_surface="W4"))
    asks = [requirement for requirement in requirements_of(wet) if requirement.name.endswith("wet")]
    assert [(requirement.name, requirement.quantity, requirement.bound) for requirement in asks] == [
        (f"lane {lane}: uniformity U0, wet", LeastOverMean(), 0.15) for lane in (1, 2)
    ]
    for eye_y, ask in zip((1.75, 5.25), asks, strict=True):
        wanted = _plain_luminance(wet.road, RoadSurface.of("W4"), eye_y)
        np.testing.assert_allclose(_of(ask.light), wanted, rtol=1e-9)
        assert min(wanted) / np.mean(wanted) < 0.8 * _of(wet.luminance[0]).min() / _of(wet.luminance[0]).mean()
    path = tmp_path / "wet.csv"
    path.write_text(_HEAD + "1,100,80,90\n2,90,20,30\n12,40,0,0\n")
    readings = RoadReadings.of(RoadSection(**fields, wet_surface_file=path, wet_uniformity=0.2))
    np.testing.assert_allclose(
        _of(readings.wet[1]), _plain_luminance(readings.road, read_surface(path), 5.25), rtol=1e-9
    )
    assert [requirement.bound for requirement in requirements_of(readings) if "wet" in requirement.name] == [0.2, 0.2]
    assert RoadReadings.of(RoadSection(**fields)).wet == ()


def test_a_class_asks_of_every_observer() -> None:
    readings = RoadReadings.of(RoadSection(**ROAD, lanes=3, maintenance_factor=0.8, uniformity=0.6))
    asks: list[IntensityLimit] = list(requirements_of(readings))
    assert len(asks) == 3 * 4 + 2
    assert [
        (requirement.quantity, requirement.sense, requirement.bound, requirement.unit) for requirement in asks[:4]
    ] == [
        (PlaceLight(), ">=", 1.0, "cd/m²"),
        (LeastOverMean(), ">=", 0.6, ""),
        (LeastOverMost(), ">=", 0.6, ""),
        (THRESHOLD_INCREMENT, "<=", 15.0, "%"),
    ]
    np.testing.assert_allclose(_of(asks[2].light), 0.8 * _of(readings.luminance[0])[readings.middle(0)])
    mean = _of(asks[0].light).item()
    glare = _of(asks[3].light)
    assert mean == pytest.approx(0.8 * glare[-1])  # glare is that of new lamps
    per_lux = RoadReadings.of(RoadSection(**ROAD, maintenance_factor=0.8, luminance_per_lux=0.08))
    (light,) = (
        requirement.light for requirement in requirements_of(per_lux) if requirement.name == "lane 1: per lux Q"
    )
    wanted = [_of(per_lux.luminance[0]).mean(), _of(per_lux.illuminance).mean()]
    np.testing.assert_allclose(_of(light), wanted)
    path = RoadReadings.of(RoadSection(**ROAD | {"lighting_class": "P4", "width_m": 2.0, "lanes": 1}))
    assert [(requirement.sense, requirement.bound) for requirement in requirements_of(path)] == [
        (">=", 5.0),
        ("<=", 7.5),
        (">=", 1.0),
    ]
    beside = RoadReadings.of(RoadSection(**ROAD | {"lighting_class": "P4", "edge_ratio": 0.4}))
    assert [requirement.bound for requirement in requirements_of(beside)][3:] == [0.4, 0.4]


_HEAD = "tan_gamma,0,90,180\n0,300,300,300\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (_HEAD + "1,100,,90\n2,50,40,30\n", "no number at tan gamma = 1, beta = 90"),
        (_HEAD + "1,100,,\n2,50,40,\n", "no number at tan gamma = 1, beta = 90"),
        (_HEAD + "1,100,x,90\n", "line 3, column 3: 'x' is no number"),
        (_HEAD + "1,100,nan,90\n", "line 3, column 3: 'nan' is not a finite number"),
        (_HEAD.replace("90", "x0") + "1,100,90,80\n", "line 1, column 3: beta: 'x0' is no number"),
        (_HEAD + "0,100,90,80\n", "tan gamma must begin with 0 and rise"),
        (_HEAD + "1,100,-3,90\n", "must be from 0 to 1e+06, and above 1e-06 at tan gamma = 0; found -3 to 300"),
        (_HEAD + "1,1e308,1e308,90\n", "must be from 0 to 1e+06"),
        (_HEAD.replace("300", "1e-320") + "1,0,0,0\n", "above 1e-06 at tan gamma = 0"),
        (
            _HEAD + "1,100,90,80\n1.0005,90,80,70\n",
            "tan gamma must begin with 0 and rise, by 0.001 at least; found 1, 1",
        ),
        (
            _HEAD.replace("90", "1e-3") + "1,100,90,80\n",
            "beta must begin with 0 and rise, by 0.01 at least; found 0, 0.001",
        ),
        (_HEAD + "1e300,100,90,80\n", "tan gamma ends at 1e+300, must be at most 100"),
        (_HEAD + ",100,90,80\n2,90,80,70\n", "line 3, column 1: no tan gamma"),
        (_HEAD + "1,100,90,80,70\n", "line 3: is longer than the row of beta"),
        (",0,,180\n0,300,300,300\n1,90,80,70\n", "a blank in its row of beta"),
        ("t,0,1,2\n0,300,300,300\n90,100,90,80\n180,90,80,70", "beta ends at 2 .*; rows and columns are swapped"),
        (_HEAD.replace("180", "170") + "1,100,90,80\n", "beta ends at 170"),
        ("", "has no row of numbers"),
        ("t,0,180\n0,1,1\n", "no r-table"),
    ],
)
def test_a_table_that_is_none_has_one_line(content: str, message: str, tmp_path) -> None:
    path = tmp_path / "surface.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=message.replace("^", r"\^").replace("+", r"\+")) as error:
        read_surface(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "content",
    [
        "t;0;90;180\r\n0;300,5;300,5;300,5\r\n1,5;100;80;\r\n",
        ",0,90,180\n0,300.5,300.5,300.5\n1.5,100,80\n",
        "# R9\nany words, with commas\n0\t0\t90\t180\n0\t300.5\t300.5\t300.5\n1.5\t100\t80\n",
        "tan 0 90 180\r0 300.5 300.5 300.5\r1.5 100 80 0",
    ],
    ids=["German Excel", "a blank corner", "tabs and words", "blanks, Macintosh"],
)
def test_a_table_of_any_program_is_the_same(content: str, tmp_path) -> None:
    path = tmp_path / "surface.csv"
    path.write_bytes(content.encode())
    table = read_surface(path)
    assert table.tan_gamma.tolist() == [0.0, 1.5] and table.beta_deg.tolist() == [0.0, 90.0, 180.0]
    np.testing.assert_allclose(1e4 * table.r, [[300.5] * 3, [100.0, 80.0, 0.0]])
    assert table.s1 is None, "the table ends before tan gamma = 2"


def test_a_table_in_another_unit_is_no_road_unless_it_is_scaled(tmp_path) -> None:
    """Without the factor 10^4, and in mcd; Q0 of a surface that looks alike from everywhere is its r below a lamp."""
    path = tmp_path / "alike.csv"
    tan_gamma = np.linspace(0.0, 3.0, 301)

    def written(q: float, unit: float) -> None:
        rows = [f"{t},{','.join(3 * [str(unit * q * (1.0 + t * t) ** -1.5)])}" for t in tan_gamma]
        path.write_text("\n".join(["t,0,90,180", *rows]))

    for q, unit, allowed in (
        (0.07, 1.0, False), (0.07, 1e3, False), (0.019, 1e4, False), (0.021, 1e4, True), (0.49, 1e4, True),
        (0.51, 1e4, False),
    ):  # fmt: skip
        written(q, unit)
        if allowed:
            assert RoadSurface.of("", path).q0 == pytest.approx(q, rel=1e-4), "of the part that it has"
        else:
            with pytest.raises(InputError, match=r"Q0 is .*, of a road it is from 0.02 to 0.5: give r .* times 10"):
                RoadSurface.of("", path)
        scaled = RoadSurface.of("", path, 0.08)
        assert scaled.r[0, 0] == pytest.approx(0.08, rel=1e-4) and scaled.s1 == pytest.approx(5.0**-1.5, rel=1e-4)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"lanes": 4}, "no class by luminance has lanes as narrow"),
        ({"overhang_m": 7.5}, "hangs over the other side"),
        ({"pole_spacing_m": 120.0}, "above 12 pole heights"),
        ({"pole_spacing_m": 0.89}, "pole_spacing_m = 0.89 is below a tenth of pole_height_m = 9, 0.9 m"),
        ({"pole_spacing_m": 1e-300}, "pole_spacing_m = 1e-300: .*at least 0.2"),
        ({"width_m": 7000.0}, "width_m = 7000.0: .*at most 200"),
        ({"pole_height_m": 9000.0}, "pole_height_m = 9000.0: .*at most 100"),
        ({"pole_height_m": 0.2, "pole_spacing_m": 1.0}, "pole_height_m = 0.2: .*at least 0.3"),
        ({"uniformity": 1e-300}, "uniformity = 1e-300: .*at least"),
        ({"lighting_class": "P2", "uniformity": 0.5}, "uniformity is of a class M"),
        ({"surface": "R5"}, "surface"),
        ({"arrangement": "median", "overhang_m": -1.0, "median_m": 1.8}, "inside the lane of the other"),
        ({"lighting_class": "P2", "wet_surface": "W4"}, "wet_surface is of a class M"),
        ({"wet_uniformity": 0.2}, "name its wet_surface"),
        ({"oncoming_lanes": 2}, "oncoming_lanes = 2 leave none of lanes = 2"),
        ({"median_m": 2.0}, "median_m = 2 is for arrangement"),
        ({"lighting_class": "major"}, "lighting_class"),
        ({"edition": "RP-8-00"}, "edition = RP-8-00 is of a class of RP-8, the class is M3"),
        ({"lighting_class": "local low", "glare_percent": 9.0}, "glare_percent is of a class M, the class is local"),
        ({"lighting_class": "local low", "wet_surface": "W4"}, "wet_surface is of a class M"),
    ],
)
def test_no_such_road(fields, message: str) -> None:
    with pytest.raises(InputError, match=message):
        RoadSection(**ROAD | fields)


def test_the_longest_work_of_a_road_is_bounded() -> None:
    """Lamps at the least spacing, as many lanes as there may be: the largest matrix of weights."""
    most = {"width_m": 200.0, "lanes": 12, "pole_height_m": 100.0, "pole_spacing_m": 10.0, "arrangement": "opposite"}
    readings = RoadReadings.of(RoadSection(**ROAD | most))
    assert sum(reading.weights.nnz for reading in readings.luminance) < 2_000_000
    low = {"width_m": 30.0, "lanes": 12, "pole_height_m": 2.0, "pole_spacing_m": 0.2, "oncoming_lanes": 6}
    glaring = RoadReadings.of(RoadSection(**ROAD | low | {"lighting_class": "local low"})).veiling
    assert sum(glare.weights.nnz for glare in glaring) < 2_000_000
