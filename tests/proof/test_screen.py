"""Receivers of the verification against those of the design, which share no code with them; hard pixels, and noise."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import small_spec

from lensforge.kernels.fate import Fate
from lensforge.proof.proof_inputs import screens_of
from lensforge.proof.receiver_screen import Screen, nmse, squared_norm
from lensforge.proof.refraction import unpolarised
from lensforge.proof.sequential_cast import CastFate, Passage
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import bin_flux, gaussian3
from lensforge.scene.receiver_shapes import receivers_of

PIXELS = 40
DISC = {"targets": [{"kind": "disc", "diameter_mm": 9.0}]}
PLANE = {"kind": "plane", "width_mm": 300.0, "height_mm": 170.0, **DISC}
FAR = {"kind": "far_field", "targets": [{"kind": "beam", "fwhm_deg": 30.0}]}
CYLINDER = {"kind": "cylinder", "radius_mm": 60.0, "width_mm": 250.0, "height_mm": 90.0, **DISC}
SPHERE = {"kind": "sphere", "radius_mm": 60.0, "half_angle_deg": 100.0, **DISC}
SKEWED = {
    "plane on the axis": {**PLANE, "centre_mm": [0.0, 0.0, 100.0]},
    "plane turned": {**PLANE, "centre_mm": [30.0, -20.0, 90.0], "tilt_deg": [25.0, -40.0], "rotation_deg": 17.0},
    "plane beside": {**PLANE, "centre_mm": [80.0, 5.0, 0.0], "normal": [-1.0, 0.2, 0.3], "window_mm": [120.0, 90.0]},
    "far field": {**FAR, "half_angle_deg": 70.0},
    "far field askew": {**FAR, "half_angle_deg": 50.0, "axis": [0.3, -0.5, 0.7], "rotation_deg": 200.0},
    "far field aside": {**FAR, "half_angle_deg": 50.0, "axis": [0.9, 0.1, 0.0]},
    "cylinder": CYLINDER,
    "cylinder askew": {**CYLINDER, "centre_mm": [3.0, -9.0, 8.0], "facing": [1.0, 0.6, 0.1], "rotation_deg": 75.0},
    "cylinder to the back": {**CYLINDER, "facing": [0.0, 0.0, -2.0]},
    "sphere": SPHERE,
    "sphere askew": {**SPHERE, "centre_mm": [-6.0, 7.0, 9.0], "facing": [0.2, -0.8, 0.3], "rotation_deg": -40.0},
}


def built(name, variance=1.0):
    """The screen and the design's receiver of the same section."""
    spec = small_spec(target=None, receivers=[SKEWED[name]], evaluate__filter_variance=variance)
    (screen,) = screens_of(spec, PIXELS)
    (receiver,) = receivers_of(spec, PIXELS)
    return screen, receiver


def exit_rays(count, seed=0):
    """Rays from anywhere in the largest lens to anywhere."""
    rng = np.random.default_rng(seed)
    ways, points = rng.normal(size=(2, count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    points *= 7.0 * rng.random((count, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    return points, ways


def by_design(receiver, points, ways):
    """Hits of the rays by the design's compiled kernel, NaN where they miss."""
    flux = np.ones(len(points))
    fates = np.full(len(points), int(Fate.LEFT_LENS), dtype=np.int8)
    rays = ExitRays(points, ways, flux, np.zeros_like(flux), fates)
    landings = receiver.land(rays)
    return np.where(landings.landed[:, None], landings.hits, np.nan)


@pytest.mark.parametrize("name", SKEWED)
def test_screen_and_receiver_land_every_ray_alike(name):
    screen, receiver = built(name)
    points, ways = exit_rays(20_000)
    seen = screen.land(points, ways)
    expected = by_design(receiver, points, ways)
    reached = np.isfinite(expected[:, 0])
    np.testing.assert_array_equal(np.isfinite(seen).all(axis=1), reached)
    assert 0.4 < reached.mean() < 0.6 if screen.kind == "plane" else reached.all()
    apart = np.linalg.norm(seen - expected, axis=1)[reached]
    assert (apart <= 1e-9 * np.maximum(np.linalg.norm(expected[reached], axis=1), screen.width)).all()


@pytest.mark.parametrize("name", SKEWED)
def test_rays_along_the_axes_of_a_screen_land_alike(name):
    """Some of them are level with a plane, along a cylinder, or straight back from a chart's centre: on no pixel."""
    screen, receiver = built(name)
    ways = np.concatenate([screen.axes, -screen.axes])
    points = np.full((6, 3), 0.5) if screen.kind == "plane" else np.tile(screen.centre_mm, (6, 1))
    seen = screen.land(points, ways)
    expected = by_design(receiver, points, ways)
    reached = np.isfinite(expected[:, 0])
    np.testing.assert_allclose(seen[reached], expected[reached], atol=1e-9 * screen.width)
    assert not screen.on_pixels(seen[~reached]).any()
    assert reached.sum() == {"plane": 1, "cylinder": 4}.get(screen.kind, 5)


@pytest.mark.parametrize("variance", [0.0, 1.0])
@pytest.mark.parametrize("name", SKEWED)
def test_screen_and_receiver_see_the_same_light_and_window(name, variance):
    screen, receiver = built(name, variance)
    points, ways = exit_rays(20_000, seed=1)
    flux = np.random.default_rng(2).random(20_000)
    hits = by_design(receiver, points, ways)
    expected = bin_flux(np.nan_to_num(hits, nan=1e9), flux, receiver.grid) / receiver.pixel_measure
    image = screen.irradiance(screen.land(points, ways), flux)
    assert image.shape == (screen.rows, screen.columns)
    np.testing.assert_allclose(image, gaussian3(expected, variance), rtol=1e-9, atol=1e-9 * expected.max())
    inside = screen.in_window(screen.land(points, ways))
    np.testing.assert_array_equal(inside, receiver.window.contains(hits))
    assert 0.02 < inside.mean() < 0.9
    assert not (inside & ~screen.on_pixels(hits)).any()


def moved_by_a_radian(screen, ways):
    """Largest movement (mm) on the screen of each ray from the origin, for a turn at the origin, by differences."""
    across = np.cross(ways, np.where(np.abs(ways[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turns = [1e-6 * across, 1e-6 * np.cross(ways, across)]
    start = np.zeros_like(ways)
    slopes = [(screen.land(start, ways + turn) - screen.land(start, ways - turn)) / 2e-6 for turn in turns]
    return np.linalg.norm(np.stack(slopes, axis=-1), ord=2, axis=(1, 2))


@pytest.mark.parametrize("name", [name for name in SKEWED if "plane" in name or "cylinder" in name])
def test_reach_is_how_far_light_moves_on_the_screen_for_a_turn_at_the_lens(name):
    screen = replace(built(name, 0.0)[0], columns=150, rows=150)
    ways = exit_rays(40_000, seed=5)[1]
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    flux = np.random.default_rng(6).random(len(ways))
    hits = screen.land(np.zeros_like(ways), ways)
    seen = screen.on_pixels(hits)
    moved = moved_by_a_radian(screen, ways[seen])
    rms = np.sqrt(np.average(moved**2, weights=flux[seen]))
    assert seen.sum() > 1000
    assert screen.reach_mm(screen.irradiance(hits, flux)) == pytest.approx(rms, rel=0.02)


def test_reach_of_a_screen_around_the_lens_is_its_radius_and_of_directions_a_metre():
    light = np.random.default_rng(7).random((PIXELS, PIXELS))
    sphere = next(built(name, 0.0)[0] for name in SKEWED if "sphere" in name)
    assert sphere.reach_mm(light) == pytest.approx(60.0) and built("far field", 0.0)[0].reach_mm(light) == 1000.0


def test_a_window_is_a_rectangle_a_circle_or_where_both_overlap():
    place = np.array([[0.0, 0.0], [39.0, 0.0], [0.0, 21.0], [35.0, 18.0], [41.0, 0.0], [np.nan, np.nan]])
    square = Screen.square(100.0, 200.0, 10)
    for window, inside in {
        (80.0, 40.0, None): [True, True, False, True, False, False],
        (None, None, 39.2): [True, True, True, False, False, False],
        (80.0, 40.0, 39.2): [True, True, False, False, False, False],
        (None, None, None): [True, True, True, True, True, False],
    }.items():
        assert replace(square, window=window).in_window(place).tolist() == inside


def test_landed_rays_have_the_fates_of_the_passage_and_miss_the_receiver_where_they_go_back():
    points = np.tile([0.0, 0.0, 5.0], (5, 1))
    ways = np.array([[0.0, 0.6, 0.8]] * 5)
    ways[1] = [0.6, 0.0, -0.8]
    points[2:4] = np.nan
    ways[2:4] = np.nan
    points[4, 2] = 120.0  # beyond the plane
    fates = [CastFate.LANDED, CastFate.LANDED, CastFate.TOTAL_REFLECTION, CastFate.NO_HIT, CastFate.LANDED]
    flux = np.arange(1.0, 6.0)
    lost = np.zeros(5)
    facets = np.zeros((5, 2))
    ends = np.array(fates, dtype=np.int64)
    fields = unpolarised(np.nan_to_num(ways))
    met = np.arange(10).reshape(5, 2)
    passage = Passage(points, ways, flux, lost, lost.copy(), ends, facets, fields, met, lost, draws=np.zeros((5, 2)))
    landed = passage.landed(Screen.square(100.0, 10.0, 4))
    names = ["landed", "missed_receiver", "total_reflection", "no_hit", "missed_receiver"]
    assert landed.fate_names.tolist() == names
    np.testing.assert_allclose(landed.landings[0], [0.0, 71.25])  # off the pixels, and yet landed
    assert np.isnan(landed.landings[1:]).all()
    np.testing.assert_array_equal(landed.flux, flux)
    assert landed.met.tolist() == met.tolist()
    assert passage.fates.tolist() == fates  # other screens see the same passage
    by_direction = passage.landed(built("far field")[0])
    assert by_direction.fate_names.tolist() == ["landed", "landed", "total_reflection", "no_hit", "landed"]


def test_pixels_need_not_be_square():
    screen = replace(Screen.square(100.0, 100.0, 10, filter_variance=0.0), width=60.0, columns=3, rows=5)
    landings = np.array([[30.0, -10.0], [-30.0, 50.0], [0.0, -50.0], [30.1, 0.0], [0.0, 50.1]])
    image = screen.irradiance(landings, np.array([1.0, 2.0, 4.0, 8.0, 16.0]))
    assert screen.pixel_measure == pytest.approx(20.0 * 20.0 * 1e-6)
    expected = np.zeros((5, 3))
    expected[2, 2] = 1.0
    expected[4, 0] = 2.0
    expected[0, 1] = 4.0
    np.testing.assert_allclose(image * screen.pixel_measure, expected, atol=1e-15)


@pytest.mark.parametrize("variance", [0.0, 1.0])
def test_noise_floor_is_the_error_that_independent_rays_make(variance):
    receiver = Screen.square(100.0, 100.0, 24, variance)
    cells = np.random.default_rng(0).random((24, 24)) + 0.2
    cells[:5] = 0.0  # a dark part
    chance = np.append((cells / cells.sum()).ravel() * 0.7, 0.3)  # the rest lands nowhere

    def draw(seed, count):
        rng = np.random.default_rng(seed)
        pixel = rng.choice(24 * 24 + 1, count, p=chance)
        place = (np.stack([pixel % 24, pixel // 24], axis=1) + 0.5) * (100.0 / 24) - 50.0
        return place, rng.uniform(0.5, 1.5, count) / count

    rows, columns = np.mgrid[:24, :24]
    centres = (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) * (100.0 / 24) - 50.0
    reference = receiver.irradiance(centres, chance[:-1])
    errors = []
    floors = []
    for seed in range(40):
        place, flux = draw(seed, 3000)
        errors.append(nmse(receiver.irradiance(place, flux), reference))
        floors.append(receiver.noise(place, flux).sum() / squared_norm(reference))
    assert np.mean(floors) == pytest.approx(np.mean(errors), rel=0.05)
