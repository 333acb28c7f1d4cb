"""A room around the lamps: its sides by solid angles and form factors, and what stands in its very surfaces."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scenes import small_spec
from test_body_view import POINT, flux_on, seen_sr
from test_housing import BOX, housing_of
from test_wall_reflection import drawn

import lensforge as lf
from lensforge.optics.pose import Pose
from lensforge.report.body_figures import sides_of
from lensforge.scene.body_view import BodyView, body_pictures, body_views
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.eye_view import eye_views
from lensforge.scene.housing import Housing
from lensforge.scene.housing_room import dark_share
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver_shapes import Plane, receivers_of, seen_by_lamp
from lensforge.spec.housing_sections import HousingBox, HousingRoom

COUNT = 2**14
SIZE = (400.0, 300.0, 240.0)
ROOM = HousingRoom(
    name="room",
    size_mm=SIZE,
    centre_mm=(12.0, -30.0, 85.0),
    tilt_deg=(8.0, -13.0),
    rotate_z_deg=30.0,
    patch_mm=40.0,
    surface="diffuse",
    reflectance=0.5,
    floor_reflectance=0.3,
    ceiling_reflectance=0.0,
)
GIVEN = ROOM.model_dump(exclude_unset=True)
SHARES = {"floor": 0.3, "ceiling": 0.0, "wall-1": 0.5, "wall-2": 0.5, "wall-3": 0.5, "wall-4": 0.5}
MIDDLES = {  # of the sides, in half lengths of the room
    "floor": (0.0, 0.0, 1.0), "ceiling": (0.0, 0.0, -1.0), "wall-1": (1.0, 0.0, 0.0), "wall-2": (0.0, 1.0, 0.0),
    "wall-3": (-1.0, 0.0, 0.0), "wall-4": (0.0, -1.0, 0.0),
}  # fmt: skip


def rays_of(points: np.ndarray, directions: np.ndarray) -> ExitRays:
    """Rays of 1 W together, which have left the lens."""
    count = len(directions)
    points = np.broadcast_to(points, directions.shape).copy()
    return ExitRays(points, directions, np.full(count, 1.0 / count), np.zeros(count), np.zeros(count, dtype=np.int8))


def all_around(count: int = COUNT) -> ExitRays:
    """Rays from a point beside the origin, evenly into all directions."""
    directions = np.random.default_rng(4).normal(size=(count, 3))
    return rays_of(POINT, directions / np.linalg.norm(directions, axis=1, keepdims=True))


def corners_of(side: str) -> np.ndarray:
    """The four corners of a side in its place, in a circle."""
    half = 0.5 * np.array(SIZE)
    middle = np.array(MIDDLES[side])
    across = [axis * half for axis in np.eye(3) if not (axis * middle).any()]
    around = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    return ROOM.pose.points(np.array([middle * half + a * across[0] + b * across[1] for a, b in around]))


def views() -> dict[str, BodyView]:
    """The measured sides, each before the others."""
    sides = ROOM.bodies
    return {
        side.name.removeprefix("room-"): replace(
            BodyView.of(side), housing=Housing.of([other for other in sides if other is not side])
        )
        for side in sides
    }


def form_factor(place: np.ndarray, normal: np.ndarray, corners: np.ndarray) -> float:
    """Share of the light of a Lambertian point that comes to a polygon ahead of it (Lambert, 1760)."""
    ways = (corners - place) / np.linalg.norm(corners - place, axis=1, keepdims=True)
    total = 0.0
    for one, other in pairwise([*ways, ways[0]]):
        across = np.cross(one, other)
        total += np.arctan2(np.linalg.norm(across), one @ other) * (across @ normal) / np.linalg.norm(across)
    return float(abs(total) / (2.0 * np.pi))


def test_every_side_takes_the_light_of_its_solid_angle() -> None:
    """Together all of it; each face alone is measured, in patches that face into the room."""
    rays = all_around()
    whole = 0.0
    for name, view in views().items():
        a, b, c, d = corners_of(name)
        share = np.abs(seen_sr(np.array([[a, b, c], [a, c, d]]))).sum() / (4.0 * np.pi)
        direct = replace(view, housing=view.housing.black if view.housing else None)
        flux = flux_on(direct, rays).sum()
        assert flux == pytest.approx(share, abs=4.0 * np.sqrt(share / COUNT)), name
        whole += flux
        assert view.patches.areas_mm2.sum() == pytest.approx(np.linalg.norm(b - a) * np.linalg.norm(d - a), rel=1e-12)
        inwards = ROOM.pose.to_local_directions(view.pose.directions(view.patches.normals))
        assert inwards == pytest.approx(np.broadcast_to(-np.array(MIDDLES[name]), inwards.shape))
        assert sides_of(view) == ("lit",)
    assert whole == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("lit", "at"), [("floor", (0.3, -0.5, 1.0)), ("wall-2", (-0.4, 1.0, 0.2))])
def test_a_lit_place_sends_its_light_to_the_other_sides_by_their_form_factors(
    lit: str, at: tuple[float, float, float]
) -> None:
    """What the reflectance of its own side leaves, and on the patches of one side by cosines over the square."""
    place = ROOM.pose.points(np.array(at) * 0.5 * np.array(SIZE))
    normal = ROOM.pose.directions(-np.array(MIDDLES[lit]))
    towards = place - POINT
    rays = drawn(rays_of(POINT, np.tile(towards / np.linalg.norm(towards), (COUNT, 1))))
    share = SHARES[lit]
    whole = 0.0
    for name, view in views().items():
        flux = flux_on(view, rays)
        if name == lit:
            assert flux.sum() == pytest.approx(1.0, abs=1e-12)
            continue
        wanted = share * form_factor(place, normal, corners_of(name))
        assert flux.sum() == pytest.approx(wanted, abs=3e-3 * share), name
        whole += flux.sum()
        ways = view.centres_mm - place
        away = np.linalg.norm(ways, axis=1)
        facing = view.pose.directions(view.patches.normals)
        by_cosines = (ways @ normal) * -(ways * facing).sum(axis=1) * view.patches.areas_mm2 / (np.pi * away**4)
        far = away > 200.0
        noise = share * np.sqrt(by_cosines[far] / COUNT)
        assert (np.abs(flux[far] - share * by_cosines[far]) < 5.0 * noise + 0.02 * share * by_cosines[far]).all()
    assert whole == pytest.approx(share, abs=1e-12)


def test_no_light_leaves_a_room_and_none_goes_on_from_a_second_side() -> None:
    """Towards a plane that only light from the sides may reach: what each ray does is known."""
    sheet = Plane(
        Pose.facing((-0.3, 0.2, -1.0), (5.0, 4.0, -20.0), 20.0), PixelGrid(60.0, 60.0, 8, 8), Window(60.0, 60.0)
    )
    rays = drawn(all_around())
    landings = replace(sheet, housing=housing_of(ROOM)).land(rays)
    shadow = landings.shadow
    assert shadow is not None and not landings.missed_receiver.any()
    assert (landings.landed != (shadow.lost == 1.0)).all(), "every ray lands, or is lost"
    assert landings.flux.sum() + (shadow.lost * rays.flux).sum() == pytest.approx(1.0, abs=1e-12)
    assert shadow.again.sum() > 500 and (landings.landed & shadow.met).sum() > 100


def test_a_receiver_in_the_floor_has_its_light_as_without_the_room() -> None:
    """To the last bit where the floor is; a receiver behind the floor has none."""
    floor = Pose.of_tilts((30.0, -20.0, 120.0))
    rays = all_around()
    for behind_mm, lit in ((0.0, True), (1e-3, False)):
        pose = ROOM.pose.after(floor.at((30.0, -20.0, 120.0 + behind_mm)))
        plane = Plane(pose, PixelGrid(200.0, 180.0, 8, 8), Window(200.0, 180.0))
        plain = plane.land(rays)
        landings = replace(plane, housing=housing_of(ROOM.changed(surface="black", **BLACK))).land(rays)
        on_floor = plain.landed & (np.abs(plain.hits + np.array([30.0, -20.0])) < [200.0, 150.0]).all(axis=1)
        assert on_floor.sum() > 1000
        assert (landings.flux[on_floor] == (plain.flux[on_floor] if lit else 0.0)).all()
        assert (landings.hits[landings.landed] == plain.hits[landings.landed]).all()
        assert not landings.flux[~on_floor].any()


BLACK: dict[str, Any] = {"reflectance": None, "floor_reflectance": None, "ceiling_reflectance": None}


def test_no_light_leaves_a_room_where_its_sides_meet() -> None:
    """By rays to its very edges and corners."""
    edges = np.concatenate([np.linspace(*ends, 40) for name in MIDDLES for ends in pairwise(corners_of(name))])
    towards = edges - POINT
    rays = rays_of(POINT, towards / np.linalg.norm(towards, axis=1, keepdims=True))
    shadow = housing_of(ROOM).shadow(rays.points, rays.directions, np.full(len(towards), np.inf))
    assert shadow.met.all()
    assert np.linalg.norm(shadow.places - edges, axis=1).max() < 1e-6


def test_a_search_sees_no_rim_in_a_room_but_those_of_bodies_in_it() -> None:
    rays = all_around(4096)
    places = housing_of(ROOM).shadow(rays.points, rays.directions, np.full(4096, np.inf)).places
    to_sides = np.linalg.norm(places - rays.points, axis=1)
    alone, both, same = (
        housing_of(*bodies).faded(3.0).shadow(rays.points, rays.directions, to_sides)
        for bodies in ((ROOM,), (ROOM, BOX), (BOX,))
    )
    assert (alone.weights == 1.0).all()
    assert (both.weights == same.weights).all() and ((same.weights > 0.0) & (same.weights < 1.0)).sum() > 20


def test_a_far_field_and_an_eye_see_the_lamps_without_the_room() -> None:
    """But with the bodies in it, also where the wanted light is judged; a plane is in the room."""
    far = {"kind": "far_field", "half_angle_deg": 60.0, "targets": [{"kind": "disc", "diameter_deg": 30.0}]}
    near = {
        "kind": "plane", "name": "near", "centre_mm": [0.0, 0.0, 90.0], "width_mm": 90.0, "height_mm": 60.0,
        "targets": [{"kind": "disc", "diameter_mm": 40.0}],
    }  # fmt: skip
    eye = {"kind": "luminance", "at_most": 1e9, "unit": "cd_per_m2", "eyes_mm": [[140.0, -20.0, 9e3]], "spot_mm": 2.0}
    post = {"kind": "box", "name": "post", "size_mm": [6.0, 9.0, 60.0], "centre_mm": [9.0, -12.0, 60.0]}
    spec = small_spec(target=None, receivers=[far, near], scene=[GIVEN, post], limits=[eye], source__flux_lm=100.0)
    in_far, in_near = (receiver.housing for receiver in receivers_of(spec, 16))
    (view,) = eye_views(spec)
    assert in_far is not None and in_near is not None and view.housing is not None
    assert in_far.names == view.housing.names == ("post",) and len(in_near) == 7
    alone = spec.changed(scene=(ROOM,))
    assert receivers_of(alone, 16)[0].housing is None and eye_views(alone)[0].housing is None
    outside = np.array([[0.0, 0.0, 1e4]])
    assert dark_share(alone, outside, np.ones(1), is_far=True) == 0.0
    assert dark_share(alone, outside, np.ones(1), is_far=False) == 1.0


def test_a_limit_on_a_ceiling_in_which_the_lens_stands_is_not_searched_for() -> None:
    """No light of the lens comes there but by way of others, if these reflect any; of the floor there is a picture."""
    lux = {"kind": "body", "unit": "lx", "at_least": 0.1, "of": "mean"}
    upright = ROOM.changed(tilt_deg=(0.0, 0.0))
    white = upright.changed(centre_mm=tuple(upright.pose.directions(np.array([30.0, -40.0, 120.0]))))
    flush = white.changed(surface="black", reflectance=None, floor_reflectance=None, ceiling_reflectance=None)
    limits = [lux | {"body": "room-ceiling"}, lux | {"body": "room-floor"}]
    spec = small_spec(scene=[flush.model_dump(exclude_unset=True)], limits=limits, source__flux_lm=100.0)
    receivers_of(spec, 16)  # it may stand there
    (picture,) = body_pictures(spec)
    assert (picture.number, picture.name) == (1, "room-floor")
    assert len(body_views(spec)) == 6
    lit, _ = body_pictures(spec.changed(scene=(white,)))
    assert lit.name == "room-ceiling" and np.dot(lit.eye_mm, upright.pose.axis) > 100.0, "seen from below"


def test_sides_of_a_room_stand_where_a_lamp_sees_them() -> None:
    """Also of a lamp that looks along the room's side, so that its axis is that of y."""
    lamps = {
        "kind": "table", "places_mm": [[-20.0, 3.0], [18.0, -2.0, 5.0]],
        "aims_mm": [[-20.0, 3.0, 99.0], [18.0, 900.0, 5.0]], "turns_deg": [20.0, 0.0],
    }  # fmt: skip
    upright = ROOM.changed(tilt_deg=(0.0, 0.0), rotate_z_deg=0.0)
    spec = small_spec(scene=[upright.model_dump(exclude_unset=True)], lamps=lamps)
    lamp = spec.all_lamps.lamps[1].pose
    (room,) = seen_by_lamp(spec, 1).scene
    corners = np.array(SIZE) * 0.5
    assert room.pose.points(corners) == pytest.approx(lamp.to_local_points(upright.pose.points(corners)), abs=1e-10)


TWO = {"lamps": {"kind": "table", "places_mm": [[0.0, 0.0], [0.0, 300.0]]}}
REFUSED: list[tuple[list[dict[str, Any]], dict[str, Any], str]] = [
    ([GIVEN | {"centre_mm": (0.0, 0.0, -300.0)}], {}, "'room': the lens stands outside of it, at ("),
    ([GIVEN], TWO, "'room': lamp 1 stands outside of it, at ("),
    ([GIVEN, GIVEN | {"name": "hall"}], {}, "2 rooms; all lamps stand in one"),
    ([GIVEN, {"kind": "box", "name": "room-floor", "size_mm": [1.0, 1.0, 1.0]}], {}, "two have the name 'room-floor'"),
    ([GIVEN | {"surface": "black", "reflectance": None}], {}, "floor_reflectance = 0.3: a black"),
    ([GIVEN | {"reflectance": 1.2}], {}, "reflectance"),
    ([GIVEN | {"reflectance": None}], {}, "give its reflectance"),
]  # fmt: skip


@pytest.mark.parametrize(("scene", "more", "message"), REFUSED)
def test_a_room_that_is_none_is_refused_in_a_line(
    scene: list[dict[str, Any]], more: dict[str, Any], message: str
) -> None:
    with pytest.raises(lf.InputError) as refusal:
        small_spec(scene=scene, **more)
    assert message in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_wall_through_the_lens_is_refused_and_a_box_of_white_is_as_before() -> None:
    spec = small_spec(scene=[GIVEN | {"tilt_deg": (0.0, 0.0), "rotate_z_deg": 0.0, "centre_mm": (195.0, 0.0, 85.0)}])
    with pytest.raises(lf.InputError, match=r"'room-wall-3' reaches into the room of the lens"):
        receivers_of(spec, 16)
    box = HousingBox(name="box", size_mm=SIZE)
    assert box.bodies == (box,) and sides_of(BodyView.of(box.changed(patch_mm=60.0))) == ("lit", "far")
