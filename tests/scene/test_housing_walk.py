"""Light from body to body by closed forms: images in two mirrors, radiosity of a room, plates, prisms, light pipes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from test_clear_crossing import at, transmitted
from test_housing import TURNED, from_point
from test_wall_reflection import drawn, obstacle

from lensforge.cad.mesh import BodyMesh
from lensforge.cad.mesh_files import stl_bytes
from lensforge.light.received_flux import BLOCKED, SECOND_WALL, ReceivedFlux, flux_by_fate
from lensforge.optics.media import FaceScatter, Media, Medium
from lensforge.optics.pose import Pose
from lensforge.optics.scattering import GaussianFacets
from lensforge.proof.obstacles import Obstacles
from lensforge.proof.obstacles import wall_numbers as proof_numbers
from lensforge.scene.body_view import BodyView
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing
from lensforge.scene.housing_walk import SceneLeg, last_of, legs_of
from lensforge.scene.pixel_grid import PixelGrid, Window, bin_flux
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.rough_faces import wall_numbers as design_numbers
from lensforge.scene.rough_faces import with_facets
from lensforge.seeds import sobol
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.housing_sections import HousingBox, HousingFile, HousingRoom, HousingSection

# Two mirrors beside the light, whose inner faces lean away from one another.
LEFT, RIGHT = (
    HousingBox(
        name=f"at{x:.0f}", size_mm=(4.0, 500.0, 400.0), centre_mm=(x, 3.0, 190.0), tilt_deg=(2.0, tilt),
        surface="mirror", reflectance=share,
    )
    for x, tilt, share in ((-21.0, -2.0, 0.9), (24.0, 3.5, 0.8))
)  # fmt: skip
ROOM = HousingRoom(
    name="room", size_mm=(300.0, 200.0, 150.0), centre_mm=(12.0, -30.0, 40.0), tilt_deg=(8.0, -13.0), rotate_z_deg=30.0,
    surface="diffuse", reflectance=0.7, floor_reflectance=0.5, ceiling_reflectance=0.9, patch_mm=60.0,
)  # fmt: skip


def housing_of(*sections: HousingSection, events: int) -> Housing:
    housing = Housing.of(sections, events)
    assert housing is not None
    return housing


def walked(housing: Housing, rays: ExitRays) -> tuple[tuple[SceneLeg, ...], SceneLeg]:
    legs = legs_of(housing, rays, housing.endless_shadow(rays), housing.endless_shadow)
    return legs, last_of(legs)


def inner_face(mirror: HousingBox) -> tuple[np.ndarray, np.ndarray]:
    """A point and the unit normal of the face that looks at the other mirror."""
    towards = -np.sign(mirror.centre_mm[0])
    point = mirror.pose.points(np.array([[2.0 * towards, 0.0, 0.0]]))[0]
    return point, towards * np.array(mirror.pose.rotation)[:, 0]


@pytest.mark.parametrize("events", [1, 3, 8])
def test_two_mirrors_show_the_images_of_images(events: int) -> None:
    """Unfolded by the mirrors that it met, the place where a ray lands lies on the straight line on which it began."""
    receiver = Plane(
        Pose.facing((0.1, -0.2, 1.0), (3.0, 5.0, 390.0), 20.0), PixelGrid(90.0, 90.0, 8, 8), Window(90.0, 90.0)
    )
    rays = from_point(4000)
    landings = replace(receiver, housing=housing_of(LEFT, RIGHT, events=events)).land(rays)
    assert landings.shadow is not None
    times = np.zeros(4000, dtype=int)
    for leg in landings.legs[1:]:
        times[leg.rows] += 1
    first = landings.shadow.bodies
    faces = [inner_face(LEFT), inner_face(RIGHT)]
    for count in range(1, events + 1):
        rows = np.flatnonzero(landings.landed & (times == count))
        places = receiver.places(*landings.hits[rows].T)
        shares = np.ones(len(rows))
        for turn in reversed(range(count)):
            number = (first[rows] + turn) % 2
            points, normals = (np.array(values)[number] for values in zip(*faces, strict=True))
            places -= 2.0 * ((places - points) * normals).sum(axis=1)[:, None] * normals
            shares *= np.array([0.9, 0.8])[number]
        away = np.cross(places - rays.points[rows], rays.directions[rows])
        assert len(rows) > (40 if count < 4 else 0) and np.abs(away).max() < 1e-4
        assert landings.flux[rows] == pytest.approx(rays.flux[rows] * shares, rel=1e-12)
    again = landings.shadow.again
    assert (times[again] == events).all() and again.any()
    ends = flux_by_fate(rays, landings.missed_receiver, landings.shadow)
    assert ends.sum() == pytest.approx(1.0, abs=1e-12)
    received = ReceivedFlux.none_yet(replace(receiver, housing=housing_of(LEFT, RIGHT, events=events)), 1, ())
    received.add(0, 1.0, receiver, rays, landings)
    assert received.by_housing is not None
    taken, _, returned, incident, *_ = received.by_housing[0].T
    assert taken == pytest.approx(incident * [0.1, 0.2], rel=1e-9)
    assert taken.sum() == pytest.approx(ends[BLOCKED], abs=1e-12) and (taken > 0.0).all()
    in_window = landings.flux * receiver.window.contains(landings.hits)
    assert returned.sum() == pytest.approx(in_window[landings.shadow.met].sum()) and (returned > 0.0).all()
    last = np.where(times % 2 == 1, first, 1 - first)
    assert returned[0] == pytest.approx(in_window[(last == 0) & landings.shadow.met].sum())


@pytest.mark.parametrize("events", [1, 2, 5])
def test_a_closed_room_keeps_the_powers_of_its_reflectance(events: int) -> None:
    """All light meets a side every time: 1 - rho^N is taken, and the rest is at a further side after N events."""
    even = ROOM.changed(floor_reflectance=0.7, ceiling_reflectance=0.7)
    rays = replace(from_point(3000), draws=np.random.default_rng(1).random((3000, 2 * events)))
    legs, last = walked(housing_of(even, events=events), rays)
    assert len(legs) == events + 1 and last.shadow.again.all()
    ends = flux_by_fate(rays, np.zeros(3000, dtype=bool), last.shadow)
    assert ends[SECOND_WALL] == pytest.approx(0.7**events, rel=1e-12)
    assert ends[BLOCKED] == pytest.approx(1.0 - 0.7**events, rel=1e-12)
    inside = np.abs(ROOM.pose.to_local_points(legs[-1].shadow.places)) - 0.5 * np.array(ROOM.size_mm)
    assert np.abs(inside.max(axis=1)).max() < 1e-4, "the light is on its sides"


def lit_by_lambert(corners: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Form factors of rectangles (m, 4, 3) as ``points`` (n) of Lambertian walls see them: the edges' contour sum."""
    away = corners[None] - points[:, None, None]
    units = away / np.linalg.norm(away, axis=3, keepdims=True)
    after = np.roll(units, -1, axis=2)
    across = np.cross(units, after)
    sine = np.linalg.norm(across, axis=3)
    angles = np.arctan2(sine, (units * after).sum(axis=3))
    ways = (across * normals[:, None, None]).sum(axis=3) / np.where(sine > 0.0, sine, 1.0)
    return np.abs((angles * ways).sum(axis=2)) / (2.0 * np.pi)


def sides_of_room(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (6 n², 4, 3) of cells of each side in the order of its names, and the inward normals, by hand."""
    edges = np.linspace(-0.5, 0.5, cells + 1)
    low, high = edges[:-1], edges[1:]
    corners = []
    normals = []
    for axis, sign in ((2, 1), (2, -1), (0, 1), (1, 1), (0, -1), (1, -1)):
        first, second = (k for k in range(3) if k != axis)
        for a, b in ((a, b) for a in range(cells) for b in range(cells)):
            cell = np.full((4, 3), 0.5 * sign)
            cell[:, first] = low[a], high[a], high[a], low[a]
            cell[:, second] = low[b], low[b], high[b], high[b]
            corners.append(cell * ROOM.size_mm)
            normals.append(-sign * np.eye(3)[axis])
    return ROOM.pose.points(np.array(corners).reshape(-1, 3)).reshape(-1, 4, 3), ROOM.pose.directions(np.array(normals))


def radiosity(source: np.ndarray, events: int, cells: int) -> np.ndarray:
    """Flux on each side of the room that a point of 1 W lights, after so many reflections: E + F R E + (F R)² E ..."""
    corners, normals = sides_of_room(cells)
    middles = corners.mean(axis=1)
    factors = lit_by_lambert(corners, middles, normals) - np.eye(len(middles))  # no cell sees itself
    assert factors.sum(axis=1) == pytest.approx(1.0, abs=1e-9), "a closed room"
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]), axis=1)
    shares = np.repeat([0.5, 0.9, 0.7, 0.7, 0.7, 0.7], cells**2)
    away = source - middles
    light = (away * normals).sum(axis=1) / np.linalg.norm(away, axis=1) ** 3 / (4.0 * np.pi)
    total = light
    for _ in range(events):
        light = factors @ (shares * light)
        total = total + light
    return (areas * total).reshape(6, -1).sum(axis=1)


def to_all_sides(source: np.ndarray, count: int) -> ExitRays:
    """Rays of 1 W together from a point, with numbers for three events."""
    numbers = sobol(count, 8, 5)
    z = 1.0 - 2.0 * numbers[:, 0]
    azimuth = 2.0 * np.pi * numbers[:, 1]
    sine = np.sqrt(1.0 - z * z)
    ways = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=1)
    start = np.tile(source, (count, 1))
    return ExitRays(start, ways, np.full(count, 1.0 / count), z, np.zeros(count, np.int8), draws=numbers[:, 2:])


def on_sides_of(rays: ExitRays, housing: Housing) -> np.ndarray:
    """Flux that comes to each body, at any event."""
    legs, _ = walked(housing, rays)
    return np.sum([np.bincount(leg.shadow.bodies, leg.rays.flux, len(housing)) for leg in legs], axis=0)


def test_the_sides_of_a_room_have_the_light_of_its_radiosity() -> None:
    """After three reflections, each side by its own; the error of cells falls with the square of their size."""
    source = np.array([20.0, -45.0, 30.0])
    coarse, fine = (radiosity(source, 3, cells) for cells in (6, 12))
    wanted = fine + (fine - coarse) / 3.0
    on_sides = on_sides_of(to_all_sides(source, 2**16), housing_of(ROOM, events=3))
    assert on_sides == pytest.approx(wanted, rel=0.01)
    assert on_sides.sum() == pytest.approx(wanted.sum(), rel=0.002) and wanted.sum() > 2.5
    assert np.abs(on_sides / wanted - 1.0).mean() < 0.004


def test_a_side_of_a_room_is_measured_with_the_light_that_comes_back_to_it() -> None:
    """Once for each time that a ray comes, by patches; of a black side but once."""
    rays = to_all_sides(np.array([20.0, -45.0, 30.0]), 2**12)
    whole = housing_of(ROOM, events=3)
    on_sides = on_sides_of(rays, whole)
    for number in (0, 3):
        side = ROOM.bodies[number]
        others = housing_of(*(other for other in ROOM.bodies if other is not side), events=3)
        view = BodyView.of(side).before(others, whole)
        landings = view.land(rays)
        assert landings.again is not None
        again = bin_flux(landings.again.hits, landings.again.flux, view.grid)
        assert landings.flux.sum() + again.sum() == pytest.approx(on_sides[number], rel=1e-9)
        assert np.bincount(landings.again.rows).max() == 1 and (landings.flux[landings.again.rows] > 0.0).all()
    black = ROOM.changed(floor_reflectance=0.0)
    assert BodyView.of(black.bodies[0]).before(whole, housing_of(black, events=3)).among is None


def wedge(folder: Path, corners: list[tuple[float, float]], **more: Any) -> HousingFile:
    """A prism along y with these corners (x, z), as a file."""
    hull = trimesh.PointCloud([(x, y, z) for x, z in corners for y in (-40.0, 40.0)]).convex_hull
    mesh = BodyMesh(hull.vertices, hull.faces, np.zeros(len(hull.faces), dtype=np.int64), ("prism",), 0)
    (folder / "prism.stl").write_bytes(stl_bytes(mesh))
    return HousingFile(name="prism", file=folder / "prism.stl", surface="clear", **more)


def test_a_plate_and_then_a_rib_each_pass_and_turn_light_as_they_do_alone(tmp_path: Path) -> None:
    """Two plates move light by the sum of both; a wedge of 30 degrees behind turns it by Snell at both of its faces."""
    pose = TURNED | {"centre_mm": (0.0, 0.0, 0.0)}
    plate = HousingBox(
        name="plate", size_mm=(90.0, 90.0, 6.0), surface="clear", refractive_index=1.58, absorption_per_mm=0.02, **pose
    )
    above = plate.pose.points(np.array([[0.0, 0.0, 20.0], [0.0, 0.0, 40.0]])).tolist()
    second = plate.changed(name="second", size_mm=(90.0, 90.0, 4.0), refractive_index=1.4, centre_mm=above[0])
    corners = [(-30.0, 0.0), (30.0, 0.0), (30.0, 60.0 * np.tan(np.radians(30.0)))]
    rib = wedge(tmp_path, corners, refractive_index=1.5, absorption_per_mm=0.0, **pose | {"centre_mm": above[1]})
    angle = np.radians(np.linspace(-35.0, 10.0, 40))
    sine = np.sin(angle)
    directions = np.stack([sine, 0.0 * angle, np.cos(angle)], axis=1)
    starts = np.stack([-20.0 * np.tan(angle), 0.0 * angle, 0.0 * angle - 20.0], axis=1)
    rays = at(plate, starts, directions)
    one, both, all_three = (walked(housing_of(plate, second, rib, events=events), rays)[1] for events in (1, 2, 3))
    assert one.shadow.again.all() and both.shadow.again.all() and not all_three.shadow.again.any()
    share = np.ones(40)
    shift = np.zeros(40)
    for index, thickness in ((1.58, 6.0), (1.4, 4.0)):
        across, along, behind = transmitted(np.abs(sine), index)
        share *= 0.5 * (across**2 + along**2) * np.exp(-0.02 * thickness / behind)
        shift += thickness * (sine / (index * behind) - np.tan(angle))
    without = walked(housing_of(plate, second, events=2), rays)[1]
    assert without.shadow.onward == pytest.approx(share, rel=1e-5) and not without.shadow.again.any()
    assert plate.pose.to_local_directions(without.rays.directions) == pytest.approx(directions, abs=1e-12)
    local = plate.pose.to_local_points(without.rays.points)
    straight = starts[:, 0] + (local[:, 2] + 20.0) * np.tan(angle)
    assert local[:, 0] - straight == pytest.approx(shift, abs=1e-5)
    inside = np.arcsin(sine / 1.5)
    at_slope = inside + np.radians(30.0)
    leaves = np.abs(np.sin(at_slope)) < 1.0 / 1.5
    out = np.arcsin(1.5 * np.sin(at_slope[leaves])) - np.radians(30.0)
    going = plate.pose.to_local_directions(all_three.rays.directions)[leaves]
    assert leaves.sum() > 20
    assert np.arctan2(going[:, 0], going[:, 2]) == pytest.approx(out, abs=1e-7)
    into, into_along, _ = transmitted(np.abs(sine[leaves]), 1.5)
    outof, outof_along, _ = transmitted(np.abs(np.sin(out + np.radians(30.0))), 1.5)
    wanted = share[leaves] * 0.5 * (into * outof + into_along * outof_along)
    assert all_three.shadow.onward[leaves] == pytest.approx(wanted, rel=1e-5)


def test_a_prism_sends_light_back_after_two_total_reflections(tmp_path: Path) -> None:
    """Through its hypotenuse in and out: 0.96 squared, less what the way of its full height absorbs; trapped before."""
    corners = [(-20.0, 0.0), (20.0, 0.0), (0.0, 20.0)]
    prism = wedge(tmp_path, corners, refractive_index=1.5, absorption_per_mm=0.01, **TURNED)
    rays = at(prism, np.array([[-7.0, 3.0, -10.0], [4.0, -9.0, -10.0]]), np.array([[0.0, 0.0, 1.0]] * 2))
    for events in (1, 2):
        (_, last) = walked(housing_of(prism, events=events), rays)
        assert last.shadow.onward.tolist() == [0.0, 0.0] and not last.shadow.again.any()
    _, last = walked(housing_of(prism, events=3), rays)
    assert last.shadow.onward == pytest.approx(0.96**2 * np.exp(-0.01 * 40.0), rel=1e-6)
    assert prism.pose.to_local_directions(last.rays.directions) == pytest.approx(np.array([[0.0, 0.0, -1.0]] * 2))
    assert prism.pose.to_local_points(last.rays.points)[:, :2] == pytest.approx(
        np.array([[7.0, 3.0], [-4.0, -9.0]]), abs=1e-5
    )


def test_a_light_pipe_leads_light_along_and_the_proof_has_its_polarisation() -> None:
    """In a plane of the pipe by Fresnel at both ends; of skew light by two laws of which neither knows the other."""
    pipe = HousingBox(
        name="pipe", size_mm=(4.0, 4.0, 60.0), surface="clear", refractive_index=1.5, absorption_per_mm=0.002, **TURNED
    )
    housing = housing_of(pipe, events=12)
    angle = np.radians(np.array([5.0, 20.0, 35.0]))
    none = np.zeros(3)
    directions = np.stack([np.sin(angle), none, np.cos(angle)], axis=1)
    flat = at(pipe, np.stack([0.2 - np.tan(angle), none + 0.1, none - 31.0], axis=1), directions)
    _, last = walked(housing, flat)
    across, along, behind = transmitted(np.sin(angle), 1.5)
    wanted = 0.5 * (across**2 + along**2) * np.exp(-0.002 * 60.0 / behind)
    assert last.shadow.onward == pytest.approx(wanted, rel=1e-5)
    going = pipe.pose.to_local_directions(last.rays.directions)
    assert np.abs(going) == pytest.approx(directions, abs=1e-9)
    rng = np.random.default_rng(4)
    ways = rng.normal(size=(3000, 3)) * [0.5, 0.5, 0.0] + [0.0, 0.0, 1.0]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    starts = np.hstack([rng.uniform(-2.0, 2.0, (3000, 2)), np.full((3000, 1), -30.0)]) - ways
    rays = at(pipe, starts, ways)
    shadow = housing.endless_shadow(rays)
    obstacles = Obstacles.of([obstacle(pipe)._replace(refractive_index=1.5, absorption_per_mm=0.002)], 12)
    assert obstacles is not None
    met = obstacles.met(rays.points, rays.directions, np.full(3000, np.inf))
    assert met.onward == pytest.approx(shadow.onward, abs=1e-9)
    assert (shadow.onward == 0.0).sum() > 30 and (shadow.onward > 0.0).sum() > 2000
    rows, behind_pipe = housing.reflected(rays, shadow)
    points, onward = obstacles.reflect(
        rays.points[rows], rays.directions[rows], met.take(rows), np.zeros((len(rows), 2))
    )
    assert points == pytest.approx(behind_pipe.points, abs=1e-6)
    assert onward == pytest.approx(behind_pipe.directions, abs=1e-8)
    in_and_out = 0.5 * (
        transmitted(np.hypot(*ways.T[:2]), 1.5)[0] ** 2 + transmitted(np.hypot(*ways.T[:2]), 1.5)[1] ** 2
    )
    assert np.abs(shadow.onward - in_and_out)[rows].max() > 0.01, "the phases of total reflection count"


def test_every_event_has_numbers_of_its_own() -> None:
    """Were those of the first wall taken again, light between two white plates would leave them elsewhere."""
    low, high = (
        HousingBox(name=name, size_mm=(400.0, 400.0, 2.0), centre_mm=(0.0, 0.0, z), surface="diffuse", reflectance=0.9)
        for name, z in (("low", -30.0), ("high", 30.0))
    )
    rays = drawn(from_point(4096))
    more = replace(rays, draws=sobol(4096, 6, 2))
    legs, _ = walked(housing_of(low, high, events=3), more)
    for number, leg in enumerate(legs[1:]):
        assert more.draws is not None and leg.rays.draws is not None
        assert (leg.rays.draws == more.draws[leg.rows, 2 * number + 2 :]).all()
        cosine = np.abs(leg.rays.directions[:, 2])
        radius = np.sqrt(more.draws[leg.rows, 2 * number])
        assert cosine == pytest.approx(np.sqrt(1.0 - radius**2), abs=1e-12)


def test_rays_have_the_numbers_of_all_events_in_any_part_of_a_bundle_and_in_the_proof() -> None:
    """Behind those of a rough face; of a source that draws some, and of rays that draw all by their bits."""
    rough = (FaceScatter("outer", GaussianFacets(0.05)),)
    media = Media(Medium(1.5), walls="diffuse", wall_events=3, scatter=rough)
    given = from_point(500)
    bundle = RayBundle(given.points, given.directions, given.flux)
    for rays in (bundle, replace(bundle, facets=sobol(500, 4, 3))):
        numbers = design_numbers(rays, media)
        assert numbers is not None and numbers.shape == (500, 6) and media.scattering == 4
        assert len(np.unique(numbers)) == 3000 and 0.0 <= numbers.min() < 0.01 and 0.99 < numbers.max() < 1.0
        assert (design_numbers(rays.take(slice(100, 300)), media) == numbers[100:300]).all()
        assert (proof_numbers(with_facets(rays, media.scattering), media) == numbers).all()
        once = design_numbers(rays, replace(media, wall_events=1))
        assert once is not None and (numbers[:, :2] == once).all()
    own = proof_numbers(bundle, media, 5)
    assert own.shape == (500, 6) and len(np.unique(own)) == 3000
    assert design_numbers(bundle, replace(media, walls="mirror")) is None
