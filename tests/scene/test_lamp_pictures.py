"""Light of lamps together: the sum over rays moved one lamp after another, closed forms, and one lamp as it was.

Rays of lamps with heights and aims are moved by rotation matrices written out here.
"""

from bisect import bisect_right
from dataclasses import replace
from math import atan2, cos, hypot, sin
from typing import Any

import numpy as np
import pytest
from presets import FEW
from scenes import hemisphere_directions, small_spec, sphere
from scipy.special import k1

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.lens_light import evaluate
from lensforge.light.receiver_light import ReceiverLight
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lamp_pictures import LampPictures, _pictures, seen_by
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import bin_flux, splat_flux
from lensforge.scene.receiver_shapes import receivers_of, seen_by_lamp
from lensforge.spec import Spec

GRID = {"kind": "grid", "columns": 4, "rows": 3, "pitch_mm": 20.0}
RING = {"kind": "ring", "count": 5, "diameter_mm": 60.0}
DISC = [{"kind": "disc", "diameter_mm": 40.0}]
PATTERN = {"kind": "rectangle", "width_mm": 30.0, "height_mm": 30.0}
SHEET = {"kind": "plane", "centre_mm": [10.0, 5.0, 60.0], "width_mm": 150.0, "height_mm": 120.0, "targets": DISC}
FAR = {"kind": "far_field", "half_angle_deg": 60.0, "targets": [{"kind": "disc", "diameter_deg": 40.0}]}
CURVED = {"kind": "cylinder", "radius_mm": 90.0, "width_mm": 150.0, "height_mm": 120.0, "targets": DISC}
POLES = {  # the second one is aimed straight along z
    "kind": "table",
    "places_mm": [[-70.0, 20.0, 10.0], [60.0, 45.0, -15.0], [5.0, -50.0, 0.0]],
    "aims_mm": [[30.0, 0.0, 90.0], [60.0, 45.0, 100.0], [-20.0, 10.0, 60.0]],
    "turns_deg": [0.0, 25.0, -70.0],
}
HIGH = {**SHEET, "centre_mm": [10.0, 5.0, 80.0]}
WIDE = {**CURVED, "radius_mm": 130.0}
DOME = {"kind": "sphere", "radius_mm": 140.0, "half_angle_deg": 80.0, "targets": DISC}
SCENES: dict[str, tuple[dict[str, Any], dict[str, Any], int]] = {  # lamps, receiver, pictures that it takes
    "grid": (GRID, SHEET, 1),
    "grid without a common measure": ({**GRID, "pitch_mm": [20.0, 19.913]}, SHEET, 3),
    "grid below a turned plane": (GRID, {**SHEET, "rotation_deg": 25.0}, 12),
    "grid below a tilted plane": (GRID, {**SHEET, "tilt_deg": [10.0, 20.0]}, 12),
    "grid in a cylinder": (GRID, CURVED, 12),
    "grid from afar": (GRID, FAR, 1),
    "hexagon": ({"kind": "hexagon", "rings": 2, "pitch_mm": 20.0}, SHEET, 5),
    "ring": (RING, SHEET, 5),
    "ring from afar": (RING, FAR, 5),
    "row": ({"kind": "table", "places_mm": [[-20.0, 0.0], [0.0, 0.0], [40.0, 0.0]]}, SHEET, 1),
    "table": ({"kind": "table", "places_mm": [[3.0, 40.0]], "turns_deg": [30.0]}, SHEET, 1),
    "poles": (POLES, HIGH, 3),
    "poles before a tilted plane": (POLES, {**HIGH, "tilt_deg": [15.0, -20.0], "rotation_deg": 30.0}, 3),
    "poles in a cylinder": (POLES, WIDE, 3),
    "poles in a sphere": (POLES, DOME, 3),
    "poles from afar": (POLES, {**FAR, "half_angle_deg": 80.0}, 3),
}


def together(lamps: dict[str, Any], receiver: dict[str, Any]) -> Spec:
    return small_spec(lamps=lamps, target=None, receivers=[receiver], base={"kind": "none"})


def exits() -> ExitRays:
    rng = np.random.default_rng(0)
    directions = hemisphere_directions(4000)
    points = 5.0 * directions + 0.1 * rng.normal(size=(4000, 3))
    return ExitRays(points, directions, rng.random(4000), np.zeros(4000), np.full(4000, Fate.LEFT_LENS, dtype=np.int8))


def about_z(angle: float) -> np.ndarray:
    return np.array([[cos(angle), -sin(angle), 0.0], [sin(angle), cos(angle), 0.0], [0.0, 0.0, 1.0]])


def panned_and_tilted(place: np.ndarray, aim: list[float] | None, turn_deg: float) -> np.ndarray:
    """From the axes of a lamp to those of the scene: its own turn, a tilt of its +x downwards, and a pan."""
    x, y, z = (0.0, 0.0, 1.0) if aim is None else np.subtract(aim, place)
    pan = atan2(y, x) if hypot(x, y) > 0.0 else 0.0
    tilt = atan2(hypot(x, y), z)
    tilted = np.array([[cos(tilt), 0.0, sin(tilt)], [0.0, 1.0, 0.0], [-sin(tilt), 0.0, cos(tilt)]])
    return about_z(pan) @ tilted @ about_z(np.radians(turn_deg))


def moved_by_hand(lamps: dict[str, Any], receiver: Any) -> list[tuple[np.ndarray, np.ndarray]]:
    """Place of each lamp, and its axes in the scene: by its aim where it has one, else by its turn alone."""
    if "aims_mm" in lamps:
        places = [np.array(place) for place in lamps["places_mm"]]
        poses = zip(places, lamps["aims_mm"], lamps["turns_deg"], strict=True)
    else:
        places = [np.array([*place, 0.0]) for place in receiver.lamps.places_mm]
        poses = zip(places, [None] * len(places), receiver.lamps.turns_deg, strict=True)
    return [(pose[0], panned_and_tilted(*pose)) for pose in poses]


@pytest.mark.parametrize("deposit", [bin_flux, splat_flux])
@pytest.mark.parametrize(("lamps", "receiver", "pictures"), SCENES.values(), ids=SCENES)
def test_the_sum_is_that_of_rays_moved_one_lamp_after_another(
    lamps: dict[str, Any], receiver: dict[str, Any], pictures: int, deposit: Any
) -> None:
    whole = receivers_of(together(lamps, receiver), 32)[0]
    rays = exits()
    board = LampPictures.of(whole)
    assert len(board.rasters) == pictures
    total = np.zeros(whole.grid.shape)
    for place, axes in moved_by_hand(lamps, whole):
        points = rays.points @ axes.T + (0.0 if receiver["kind"] == "far_field" else place)
        landings = whole.land(replace(rays, points=points, directions=rays.directions @ axes.T))
        total += deposit(landings.hits, landings.flux, whole.grid)
    deposits = [deposit(landed.hits, landed.flux, r.grid) for r in board.receivers for landed in [r.land(rays)]]
    np.testing.assert_allclose(len(whole.lamps) * board.added(deposits), total, atol=1e-9 * total.max())
    rng = np.random.default_rng(1)
    forth = [rng.random(picture.shape) for picture in deposits]
    back = rng.random(total.shape)
    moved_back = sum(np.vdot(a, b) for a, b in zip(forth, board.spread(back), strict=True))
    assert np.vdot(board.added(forth), back) == pytest.approx(moved_back, rel=1e-12)


@pytest.mark.parametrize("receiver", [receiver for lamps, receiver, _ in SCENES.values() if lamps is POLES])
def test_a_lamp_on_a_pole_sees_the_receiver_as_its_raster_does(receiver: dict[str, Any]) -> None:
    """As a yield draws each lamp, and the proof casts one."""
    spec = together(POLES, receiver)
    (whole,) = receivers_of(spec, 32)
    for number, raster in enumerate(LampPictures.of(whole).rasters):
        assert seen_by(whole, number).pose == raster.receiver.pose
        (alone,) = receivers_of(seen_by_lamp(spec, number), 32)
        np.testing.assert_allclose(alone.corners(), raster.receiver.corners(), atol=1e-9)


def test_a_picture_of_all_lamps_has_so_many_pixels_at_most() -> None:
    """Sides of the receiver and the way from the first to the last lamp, 60 by 40 mm, in pixels."""

    def pixels(count: int) -> int:
        (receiver,) = receivers_of(together(GRID, SHEET), count)
        across, along = np.array([150.0, 120.0]) / [receiver.grid.columns, receiver.grid.rows]
        return round((150.0 + 60.0) / across) * round((120.0 + 40.0) / along)

    most = bisect_right(range(2048), 2**22, lo=32, key=pixels) - 1
    (raster,) = _pictures.__wrapped__(receivers_of(together(GRID, SHEET), most)[0]).rasters
    assert raster.receiver.grid.columns * raster.receiver.grid.rows == pixels(most)
    with pytest.raises(InputError, match=f"at most {2**22}; take fewer pixels"):
        _pictures.__wrapped__(receivers_of(together(GRID, SHEET), most + 1)[0])


def test_a_period_holds_all_light_and_moves_round() -> None:
    """No flux is lost at its edge, and rays from three pixels further make the same picture three pixels further."""
    period = {**SHEET, "centre_mm": [0.0, 0.0, 60.0], "width_mm": 20.0, "height_mm": 20.0 * 3.0**0.5, "targets": DISC}
    lamps = {"kind": "endless", "lattice": "hexagon", "pitch_mm": 20.0}
    receiver = receivers_of(together(lamps, period), 32)[0]
    rays = exits()
    board = LampPictures.of(receiver)
    (width, height) = receiver.grid.pixel
    pictures = []
    for move in (0.0, 3.0):
        moved = replace(rays, points=rays.points + np.array([move * width, move * height, 0.0]))
        deposits = [splat_flux(landed.hits, landed.flux, r.grid) for r in board.receivers for landed in [r.land(moved)]]
        pictures.append(board.added(deposits))
    assert pictures[0].sum() == pytest.approx(rays.flux.sum(), rel=1e-12)
    np.testing.assert_allclose(np.roll(pictures[0], (3, 3), axis=(0, 1)), pictures[1], atol=1e-9)
    half = (
        receiver.grid.rows // 2,
        receiver.grid.columns // 2,
    )  # where the second lamp stands: the lattice is the same there
    np.testing.assert_allclose(np.roll(pictures[0], half, axis=(0, 1)), pictures[0], atol=1e-9)


def test_the_receiver_of_a_target_alone_is_seen_by_a_lamp() -> None:
    spec = small_spec(lamps=POLES, base={"kind": "none"})
    (seen,), (straight,) = (seen_by_lamp(spec, number).all_receivers for number in (0, 1))
    x, y, z = straight.centre_mm  # turned by 25 degrees
    assert (hypot(x, y), z) == pytest.approx((75.0, 115.0)) and seen.name == straight.name == "light"


ABOVE = {"target": {**PATTERN, "distance_mm": 20.0, "receiver_mm": 30.0}}


def light_of(rays: int = 2**14, pixels: int = 16, **changes: Any) -> ReceiverLight:
    """Light of a point source in concentric spheres, whose rays go straight: Lambertian, with one transmittance."""
    spec = small_spec(**{"base": {"kind": "none"}, "source__side_mm": 0.0, **ABOVE, **changes})
    lens = Lens.double(sphere(3.0), sphere(6.0), spec, seed=0, accuracy=FEW)
    return evaluate(lens, rays=rays, pixels=pixels).receivers[0]


ENDLESS = {"kind": "endless", "pitch_mm": 30.0}


def test_a_lattice_of_lambertian_lamps_is_as_even_as_its_transform_says() -> None:
    """1 + sum of (h k) K1(h k) cos(k x) over its waves k: the transform of h^2/(r^2 + h^2)^2 / pi."""
    lit = light_of(2**18, 5, lamps=ENDLESS, evaluate__filter_variance=0.0)
    centres = 30.0 * ((np.arange(5) + 0.5) / 5.0 - 0.5)
    wanted = np.ones((5, 5))
    for i in range(-4, 5):
        for j in range(-4, 5):
            way = 2.0 * np.pi / 30.0 * np.array([i, j])
            k = 20.0 * np.hypot(*way)
            if k > 0.0:
                wave = np.outer(np.cos(way[1] * centres), np.cos(way[0] * centres))
                wanted += k * k1(k) * np.prod(np.sinc(3.0 * way / np.pi)) * wave  # its mean over a pixel of 6 mm
    np.testing.assert_allclose(lit.map / lit.map.mean(), wanted, rtol=8e-3)
    assert (lit.map / lit.map.mean()).std() > 0.04
    assert lit.efficiency.value == pytest.approx(lit.possible.efficiency, rel=1e-4)


def test_a_lattice_is_the_middle_of_41_times_41_lamps() -> None:
    """Those beyond send 620 mm far: h^2/(h^2 + r^2) of their light, spread evenly."""
    grid = {**ENDLESS, "kind": "grid", "columns": 41, "rows": 41}
    endless, middle = (light_of(2**18, 4, lamps=lamps) for lamps in (ENDLESS, grid))
    beyond = middle.map.mean() / endless.map.mean()
    assert 1.0 - 20.0**2 / 615.0**2 < beyond < 1.0 - 0.5 * 20.0**2 / 615.0**2
    np.testing.assert_allclose(middle.map / beyond, endless.map, rtol=2e-4)


def test_two_lamps_superpose_and_one_is_the_lens() -> None:
    """To the bit, metrics and possible light included; of two, each is the lens in a receiver moved the other way."""
    alone = light_of()
    same = light_of(lamps={"kind": "grid", "columns": 1, "rows": 1, "pitch_mm": 30.0})
    assert same == alone and np.array_equal(same.map, alone.map)
    both = light_of(lamps={"kind": "table", "places_mm": [[-15.0, 0.0], [15.0, 0.0]]})
    sheet = {**SHEET, "width_mm": 30.0, "height_mm": 30.0, "targets": [PATTERN]}
    moved = [light_of(target=None, receivers=[{**sheet, "centre_mm": [x, 0.0, 20.0]}]) for x in (15.0, -15.0)]
    np.testing.assert_allclose(both.map, moved[0].map + moved[1].map, rtol=1e-9)
    for name in ("efficiency", "share_in_target"):
        mean = 0.5 * sum(getattr(light, name).value for light in moved)
        assert getattr(both, name).value == pytest.approx(mean, rel=1e-9)
    assert both.flux.outside == pytest.approx(0.5 * (moved[0].flux.outside + moved[1].flux.outside), rel=1e-9)
    assert both.possible.efficiency <= 0.5 * sum(light.possible.efficiency for light in moved) + 0.02


def test_what_is_possible_from_afar_is_that_of_one_lamp() -> None:
    far = {"target": None, "receivers": [FAR], "source__side_mm": 2.0}
    alone = light_of(2**12, **far)
    many = light_of(2**12, lamps=GRID, **far)
    assert many.possible == alone.possible and many.efficiency == alone.efficiency
    np.testing.assert_allclose(many.map, 12.0 * alone.map, rtol=1e-12)


DIRECT: dict[str, Any] = {"rays": 2**17, "pixels": 5, "target": None, "evaluate__filter_variance": 0.0}


def irradiance(place: list[float], aim: list[float], height: float, centres: np.ndarray) -> np.ndarray:
    """That of a Lambertian lamp of 1 W, W/m^2, on pixels of the plane z = height: I cos(a) cos(b) / r^2."""
    x, y = np.meshgrid(centres, centres)
    way = np.stack([x - place[0], y - place[1], np.full_like(x, height - place[2])], axis=-1)
    axis = np.subtract(aim, place) / np.linalg.norm(np.subtract(aim, place))
    far = np.linalg.norm(way, axis=-1)
    return 1e6 / np.pi * np.maximum(way @ axis, 0.0) * way[..., 2] / far**4


def test_aimed_lambertian_lamps_light_a_plane_as_their_closed_form_says() -> None:
    """Two floodlights at heights of their own, aimed across: the sum, against the same lens straight above."""
    sheet = {"kind": "plane", "centre_mm": [0.0, 0.0, 80.0], "width_mm": 100.0, "height_mm": 100.0, "targets": DISC}
    places = [[-90.0, 10.0, 20.0], [60.0, -60.0, -10.0]]
    aims = [[20.0, 0.0, 80.0], [-30.0, 40.0, 80.0]]
    lamps = {"kind": "table", "places_mm": places, "aims_mm": aims}
    lit, above = (light_of(**DIRECT, receivers=[sheet], **fields) for fields in ({"lamps": lamps}, {}))
    centres = 100.0 * ((np.arange(50) + 0.5) / 50.0 - 0.5)

    def on_pixels(place: list[float], aim: list[float]) -> np.ndarray:
        return irradiance(place, aim, 80.0, centres).reshape(5, 10, 5, 10).mean(axis=(1, 3))

    single = on_pixels([0.0, 0.0, 0.0], [0.0, 0.0, 80.0])
    wanted = sum(on_pixels(*lamp) for lamp in zip(places, aims, strict=True))
    passed = above.map.sum() / single.sum()
    np.testing.assert_allclose(lit.map, passed * wanted, rtol=0.02)
    assert wanted.max() > 2.5 * wanted.min()
    share = lit.map.sum() / 2.0 / above.map.sum()
    assert lit.efficiency.value == pytest.approx(share * above.efficiency.value, rel=1e-9)
    assert lit.efficiency.value <= lit.possible.efficiency < above.possible.efficiency


def test_a_lamp_aimed_along_z_is_the_lens_moved() -> None:
    """Straight aims change nothing, to the bit; a plane takes light on its lit side alone."""
    sheet = {**SHEET, "centre_mm": [0.0, 0.0, 60.0]}
    row = {"kind": "table", "places_mm": [[-20.0, 0.0], [20.0, 0.0]]}
    aimed = light_of(
        2**12, 5, target=None, receivers=[sheet], lamps={**row, "aims_mm": [[-20.0, 0.0, 9.0], [20.0, 0.0, 70.0]]}
    )
    assert aimed == light_of(2**12, 5, target=None, receivers=[sheet], lamps=row)
    up, down = (
        light_of(
            2**12,
            5,
            target=None,
            receivers=[sheet],
            lamps={"kind": "table", "places_mm": [[0.0, 0.0, 9.0]], "aims_mm": [[3.0, 0.0, z]]},
        )
        for z in (90.0, -90.0)
    )
    assert up.efficiency.value > 0.3 and down.efficiency.value == 0.0


def test_the_mean_over_lamps_counts_each_lamp_once() -> None:
    """Three lamps share a raster, a turned one has its own."""
    places = [[-40.0, 0.0], [0.0, 0.0], [40.0, 0.0], [0.0, 40.0]]
    lamps = {"kind": "table", "places_mm": places, "turns_deg": [0.0, 0.0, 0.0, 30.0]}
    board = LampPictures.of(receivers_of(together(lamps, SHEET), 30)[0])
    counts = [raster.lamps for raster in board.rasters]
    assert sorted(counts) == [1, 3]
    assert board.mean([np.array([1.0 * (count == 3), count]) for count in counts]) == pytest.approx([0.75, 2.5])
