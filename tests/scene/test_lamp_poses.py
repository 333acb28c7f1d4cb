"""Lamps with heights and aims: rays moved by rotation matrices written out here, and closed forms."""

from dataclasses import replace
from math import atan2, cos, hypot, sin
from typing import Any

import numpy as np
import pytest
from scenes import hemisphere_directions, small_spec, sphere

from lensforge.kernels.fate import Fate
from lensforge.light.lens_light import evaluate
from lensforge.light.photometry_export import measure_photometry
from lensforge.light.receiver_light import ReceiverLight
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lamp_pictures import LampPictures, seen_by
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import bin_flux, splat_flux
from lensforge.scene.receiver_shapes import receivers_of, seen_by_lamp
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS

PLACES = [[-70.0, 20.0, 10.0], [60.0, 45.0, -15.0], [5.0, -50.0, 0.0]]
AIMS = [[30.0, 0.0, 90.0], [60.0, 45.0, 100.0], [-20.0, 10.0, 60.0]]  # the second one straight along z
TURNS = [0.0, 25.0, -70.0]
POLES = {"kind": "table", "places_mm": PLACES, "aims_mm": AIMS, "turns_deg": TURNS}
DISC = [{"kind": "disc", "diameter_mm": 40.0}]
SHEET = {"kind": "plane", "centre_mm": [10.0, 5.0, 80.0], "width_mm": 150.0, "height_mm": 120.0, "targets": DISC}
RECEIVERS = {
    "plane": SHEET,
    "tilted plane": {**SHEET, "tilt_deg": [15.0, -20.0], "rotation_deg": 30.0},
    "cylinder": {"kind": "cylinder", "radius_mm": 130.0, "width_mm": 150.0, "height_mm": 120.0, "targets": DISC},
    "sphere": {"kind": "sphere", "radius_mm": 140.0, "half_angle_deg": 80.0, "targets": DISC},
    "far field": {"kind": "far_field", "half_angle_deg": 80.0, "targets": [{"kind": "disc", "diameter_deg": 40.0}]},
}


def exits() -> ExitRays:
    rng, directions = np.random.default_rng(0), hemisphere_directions(4000)
    points = 5.0 * directions + 0.1 * rng.normal(size=directions.shape)
    left = np.full(len(points), Fate.LEFT_LENS, dtype=np.int8)
    return ExitRays(points, directions, rng.random(len(points)), np.zeros(len(points)), left)


def about_z(angle: float) -> np.ndarray:
    return np.array([[cos(angle), -sin(angle), 0.0], [sin(angle), cos(angle), 0.0], [0.0, 0.0, 1.0]])


def panned_and_tilted(place: list[float], aim: list[float], turn_deg: float) -> np.ndarray:
    """From the axes of a lamp to those of the scene: its own turn, a tilt of its +x downwards, and a pan."""
    x, y, z = np.subtract(aim, place)
    pan, tilt = atan2(y, x) if hypot(x, y) > 0.0 else 0.0, atan2(hypot(x, y), z)
    tilted = np.array([[cos(tilt), 0.0, sin(tilt)], [0.0, 1.0, 0.0], [-sin(tilt), 0.0, cos(tilt)]])
    return about_z(pan) @ tilted @ about_z(np.radians(turn_deg))


def posed(receiver: dict[str, Any], **changes: Any) -> Any:
    spec = small_spec(lamps=POLES | changes, target=None, receivers=[receiver], base={"kind": "none"})
    return receivers_of(spec, 32)[0]


@pytest.mark.parametrize("deposit", [bin_flux, splat_flux])
@pytest.mark.parametrize("name", RECEIVERS)
def test_the_sum_is_that_of_rays_moved_by_hand(name: str, deposit: Any) -> None:
    found, rays = posed(RECEIVERS[name]), exits()
    board, from_afar = LampPictures.of(found), name == "far field"
    assert len(board.rasters) == 3
    total = np.zeros(found.grid.shape)
    for place, aim, turn in zip(PLACES, AIMS, TURNS, strict=True):
        moved = panned_and_tilted(place, aim, turn)
        points = rays.points @ moved.T + (0.0 if from_afar else np.array(place))
        landings = found.land(replace(rays, points=points, directions=rays.directions @ moved.T))
        total += deposit(landings.hits, landings.flux, found.grid)
    own = [deposit(each.hits, each.flux, r.grid) for r in board.receivers for each in [r.land(rays)]]
    np.testing.assert_allclose(3.0 * board.added(own), total, atol=1e-9 * total.max())
    rng = np.random.default_rng(1)
    forth, back = [rng.random(each.shape) for each in own], rng.random(total.shape)
    moved_back = sum(np.vdot(a, b) for a, b in zip(forth, board.spread(back), strict=True))
    assert np.vdot(board.added(forth), back) == pytest.approx(moved_back, rel=1e-12)
    spec = small_spec(lamps=POLES, target=None, receivers=[RECEIVERS[name]], base={"kind": "none"})
    for number, raster in enumerate(board.rasters):  # as a yield draws each lamp, and the proof casts one
        assert seen_by(found, number).pose == raster.receiver.pose
        (alone,) = receivers_of(seen_by_lamp(spec, number), 32)
        np.testing.assert_allclose(alone.corners(), raster.receiver.corners(), atol=1e-9)


def test_the_receiver_of_a_target_alone_is_seen_by_a_lamp() -> None:
    spec = small_spec(lamps=POLES, base={"kind": "none"})
    (seen,), (straight,) = (seen_by_lamp(spec, number).all_receivers for number in (0, 1))
    x, y, z = straight.centre_mm  # turned by 25 degrees
    assert (hypot(x, y), z) == pytest.approx((75.0, 115.0)) and seen.name == straight.name == "light"


def light_of(**changes: Any) -> ReceiverLight:
    """Light of a point source in concentric spheres, whose rays go straight: Lambertian, with one transmittance."""
    one = {"base": {"kind": "none"}, "source__side_mm": 0.0, "evaluate__filter_variance": 0.0, "target": None}
    lens = Lens.double(sphere(3.0), sphere(6.0), small_spec(**one | changes), seed=0, accuracy="draft")
    return evaluate(lens, rays=2**17, pixels=5).receivers[0]


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
    places, aims = [[-90.0, 10.0, 20.0], [60.0, -60.0, -10.0]], [[20.0, 0.0, 80.0], [-30.0, 40.0, 80.0]]
    lamps = {"kind": "table", "places_mm": places, "aims_mm": aims}
    lit, above = (light_of(receivers=[sheet], **each) for each in ({"lamps": lamps}, {}))
    centres = 100.0 * ((np.arange(50) + 0.5) / 50.0 - 0.5)

    def on_pixels(place: list[float], aim: list[float]) -> np.ndarray:
        return irradiance(place, aim, 80.0, centres).reshape(5, 10, 5, 10).mean(axis=(1, 3))

    one = on_pixels([0.0, 0.0, 0.0], [0.0, 0.0, 80.0])
    wanted = sum(on_pixels(*each) for each in zip(places, aims, strict=True))
    passed = above.map.sum() / one.sum()
    np.testing.assert_allclose(lit.map, passed * wanted, rtol=0.02)
    assert wanted.max() > 2.5 * wanted.min()
    share = lit.map.sum() / 2.0 / above.map.sum()
    assert lit.efficiency.value == pytest.approx(share * above.efficiency.value, rel=1e-9)
    assert lit.efficiency.value <= lit.possible.efficiency < above.possible.efficiency


def test_a_lamp_aimed_along_z_is_the_lens_moved() -> None:
    """Straight aims change nothing, to the bit; a plane takes light on its lit side alone."""
    sheet = {**SHEET, "centre_mm": [0.0, 0.0, 60.0]}
    row = {"kind": "table", "places_mm": [[-20.0, 0.0], [20.0, 0.0]]}
    aimed = light_of(receivers=[sheet], lamps={**row, "aims_mm": [[-20.0, 0.0, 9.0], [20.0, 0.0, 70.0]]})
    assert aimed == light_of(receivers=[sheet], lamps=row)
    up, down = (
        light_of(receivers=[sheet], lamps={"kind": "table", "places_mm": [[0.0, 0.0, 9.0]], "aims_mm": [[3.0, 0.0, z]]})
        for z in (90.0, -90.0)
    )
    assert up.efficiency.value > 0.3 and down.efficiency.value == 0.0


def test_the_photometry_of_lamps_on_poles_is_that_of_one() -> None:
    one, poles = (
        small_spec(source={"kind": "square", "side_mm": 1.0, "flux_lm": 100.0}, base={"kind": "none"}, **changes)
        for changes in ({}, {"lamps": POLES})
    )
    found = [
        measure_photometry(
            Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft"),
            build_source(spec.source, None),
            PRESETS["draft"],
            rays=2**12,
        )
        for spec in (one, poles)
    ]
    np.testing.assert_array_equal(found[0].candela, found[1].candela)
    assert [each.source_lm for each in found] == [100.0, 100.0] and any("those of one" in w for w in found[1].warnings)
