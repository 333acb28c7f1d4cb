"""Shadows of opaque bodies by closed forms: halves, balls, boxes and tubes; their files, their fading, their room."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from keep_outs import box, step_file
from scenes import small_spec
from test_posed import RECEIVERS, exits

from lensforge.cad.mesh import BodyMesh
from lensforge.cad.mesh_files import stl_bytes, threemf_bytes
from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing
from lensforge.scene.housing_mesh import mesh_of, placed_mesh
from lensforge.scene.housing_room import bodies_that_may_be_in_inches, dark_share
from lensforge.scene.lamp_pictures import LampPictures, seen_by
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.spec.housing_sections import HousingBox, HousingCylinder, HousingFile, HousingSection
from lensforge.surfaces.solid_file import open_edges, rims_of

TURNED: dict[str, Any] = {"centre_mm": (4.0, -7.0, 31.0), "tilt_deg": (20.0, -35.0), "rotate_z_deg": 50.0}
SIZE = (30.0, 16.0, 9.0)
BOX = HousingBox(name="box", size_mm=SIZE, **TURNED)
TUBE = HousingCylinder(name="tube", radius_mm=21.0, bore_radius_mm=14.0, length_mm=12.0, **TURNED)


def housing_of(*sections: HousingSection) -> Housing:
    housing = Housing.of(sections)
    assert housing is not None
    return housing


def from_point(count: int, seed: int = 0) -> ExitRays:
    """Rays of 1 W together, upwards from a point beside the origin, evenly over the hemisphere."""
    rng = np.random.default_rng(seed)
    z = rng.random(count)
    azimuth = 2.0 * np.pi * rng.random(count)
    sine = np.sqrt(1.0 - z * z)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=1)
    points = np.tile([1.0, -2.0, 0.5], (count, 1))
    return ExitRays(points, directions, np.full(count, 1.0 / count), np.zeros(count), np.zeros(count, dtype=np.int8))


def in_box(points: np.ndarray) -> np.ndarray:
    return (np.abs(BOX.pose.to_local_points(points)) <= 0.5 * np.array(SIZE)).all(axis=-1)


def in_tube(points: np.ndarray) -> np.ndarray:
    local = TUBE.pose.to_local_points(points)
    radius = np.hypot(local[..., 0], local[..., 1])
    return (radius >= 14.0) & (radius <= 21.0) & (np.abs(local[..., 2]) <= 6.0)


@pytest.mark.parametrize("receiver", [RECEIVERS[name] for name in ("plane", "far field", "cylinder", "sphere")])
@pytest.mark.parametrize(("body", "inside"), [(BOX, in_box), (TUBE, in_tube)])
def test_rays_end_in_a_turned_body_before_a_receiver(receiver: Any, body: HousingSection, inside: Any) -> None:
    """By steps along the rays, which see no triangle; rays that were lost in the lens are not blocked."""
    rays = exits()
    landings = replace(receiver, housing=housing_of(body)).land(rays)
    plain = receiver.land(rays)
    steps = np.arange(0.0, 130.0, 0.02)
    ends = np.full(len(rays.flux), np.inf)
    if not receiver.is_far:
        landed = plain.landed
        places = receiver.places(*plain.hits[landed].T)
        ends[landed] = ((places - rays.points[landed]) * rays.directions[landed]).sum(axis=1)
    meets = np.zeros(len(rays.flux), dtype=bool)
    for row in np.flatnonzero(rays.left_lens):
        way = rays.points[row] + steps[:, None] * rays.directions[row]
        meets[row] = (inside(way) & (steps < ends[row])).any()
    assert landings.shadow is not None
    assert (landings.shadow.met != meets).sum() <= 1, "a ray that passes an edge by less than a step"
    met = landings.shadow.met
    assert (
        meets.sum() > 15
        and not landings.flux[met].any()
        and not (landings.landed | landings.missed_receiver)[met].any()
    )
    for before, after in ((plain.flux, landings.flux), (plain.landed, landings.landed)):
        assert (before[~met] == after[~met]).all()
    assert np.abs(placed_distance(body, landings.shadow.places[met])).max() < 5.1e-3


def placed_distance(body: HousingSection, points: np.ndarray) -> np.ndarray:
    """Signed distances (mm) of points from the faces of a body."""
    local = np.abs(body.pose.to_local_points(points))
    if isinstance(body, HousingBox):
        return (local - 0.5 * np.array(SIZE)).max(axis=1)
    radius = np.hypot(local[:, 0], local[:, 1])
    return np.max([radius - 21.0, 14.0 - radius, local[:, 2] - 6.0], axis=0)


def test_a_ball_of_a_file_has_the_shadow_of_a_ball(tmp_path: Path) -> None:
    """The share of a hemisphere of directions that a ball covers, seen from outside: 1 - cos of half its width."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=9.0)
    mesh = BodyMesh(ball.vertices, ball.faces, np.zeros(len(ball.faces), dtype=np.int64), ("ball",), 0)
    for name, content in (("ball.stl", stl_bytes(mesh)), ("ball.3mf", threemf_bytes(mesh, "ball"))):
        (tmp_path / name).write_bytes(content)
        section = HousingFile(name="ball", file=tmp_path / name, centre_mm=(10.0, 5.0, 30.0))
        rays = from_point(40000)
        far = replace(RECEIVERS["far field"], housing=housing_of(section)).land(rays)
        away = np.linalg.norm(np.array([10.0, 5.0, 30.0]) - [1.0, -2.0, 0.5])
        wanted = 1.0 - np.sqrt(1.0 - (9.0 / away) ** 2)
        assert far.shadow is not None
        assert far.shadow.met.mean() == pytest.approx(wanted, abs=3.0 * np.sqrt(wanted / 40000))


def test_the_second_of_two_bodies_is_met_where_the_first_is_passed() -> None:
    wall = HousingBox(name="wall", size_mm=(400.0, 400.0, 2.0), centre_mm=(0.0, 0.0, 60.0))
    rays = from_point(4000)
    alone = housing_of(BOX).shadow(rays.points, rays.directions, np.full(4000, np.inf)).met
    both = housing_of(BOX, wall).shadow(rays.points, rays.directions, np.full(4000, np.inf))
    assert ((both.bodies == 0) == alone).all() and 40 < alone.sum() < 2000
    reaches = np.abs(rays.points + (58.5 / rays.directions[:, 2])[:, None] * rays.directions)[:, :2].max(axis=1) < 200.0
    assert ((both.bodies == 1)[reaches] == ~alone[reaches]).all()
    before = housing_of(wall).shadow(rays.points, rays.directions, np.full(4000, 10.0))
    assert not before.met.any(), "all rays end before it"


def test_a_body_in_the_surface_of_a_receiver_is_none_before_it() -> None:
    screen = RECEIVERS["plane on the axis"]
    rays = from_point(500)
    for z, blocks in ((100.5, False), (100.499, True)):
        wall = HousingBox(name="wall", size_mm=(1e6, 1e6, 1.0), centre_mm=(0.0, 0.0, z))
        landed = replace(screen, housing=housing_of(wall)).land(rays)
        assert landed.shadow is not None and landed.shadow.met.mean() == pytest.approx(float(blocks), abs=0.02)


def test_a_lamp_sees_the_bodies_where_they_are() -> None:
    """On a plane, to which each lamp then has a picture of its own, and in the far field."""
    lamps = {"kind": "table", "places_mm": [[-30.0, 5.0], [25.0, 0.0, -4.0]], "turns_deg": [20.0, 250.0]}
    scene = [{**BOX.model_dump(), "centre_mm": (4.0, -7.0, 50.0)}]
    spec = small_spec(lamps=lamps, scene=scene)
    (plane,) = receivers_of(spec, 16)
    assert plane.housing is not None and len(LampPictures.of(plane).rasters) == 2
    rays = from_point(3000, 3)
    for number, lamp in enumerate(spec.all_lamps.lamps):
        seen = seen_by(plane, number).land(rays)
        there = plane.housing.shadow(
            lamp.pose.points(rays.points), lamp.pose.directions(rays.directions), np.full(3000, 1e3)
        )
        assert seen.shadow is not None and 20 < seen.shadow.met.sum() < 1000
        assert (seen.shadow.met == there.met).mean() > 0.99, "but for rays beyond the plane"
        assert seen.shadow.places[seen.shadow.met] == pytest.approx(there.places[seen.shadow.met], abs=1e-9)


def test_a_posed_body_is_that_body() -> None:
    for pose in (
        Pose.facing((0.3, -0.5, 0.8), (5.0, 6.0, 7.0), 33.0),
        Pose.of_tilts((1.0, 2.0, 3.0), (-90.0, 20.0), 7.0),
    ):
        again = BOX.posed(pose).pose
        assert again.points(np.eye(3)) == pytest.approx(pose.points(np.eye(3)), abs=1e-12)


def test_shadows_of_a_search_fade_to_those_of_an_evaluation() -> None:
    """The light that fades is in proportion to the rim; what is left is dark where a body stands."""
    rays = from_point(20000)
    sharp = housing_of(BOX, TUBE)
    reach = np.full(20000, np.inf)
    whole = sharp.shadow(rays.points, rays.directions, reach)
    lost = []
    for rim in (0.02, 0.01, 0.005):
        faded = replace(sharp, rim=rim).shadow(rays.points, rays.directions, reach)
        assert (faded.met == whole.met).all() and (faded.weights <= whole.weights).all()
        lost.append((whole.weights - faded.weights).sum())
    assert lost[0] > 100.0
    assert np.array(lost) / lost[0] == pytest.approx([1.0, 0.5, 0.25], abs=0.05)


def hollow(path: Path) -> Path:
    """A ball around the lens."""
    outer, inner = (trimesh.creation.icosphere(radius=radius) for radius in (90.0, 80.0))
    inner.invert()
    trimesh.util.concatenate([outer, inner]).export(path)
    return path


@pytest.mark.parametrize("radius_mm", [3.0, 12.0])
def test_a_search_has_the_shadows_of_all_triangles_by_those_that_light_can_meet_first(
    radius_mm: float, tmp_path: Path
) -> None:
    """For rays from balls about two places, in a frame that moves; of a shell around them, too."""
    centres = [(4.0, -3.0, 2.0), (-25.0, 6.0, -1.0)]
    shell = HousingFile(name="shell", file=hollow(tmp_path / "shell.stl"))
    frame = Pose.of_tilts((1.0, 2.0, -3.0), (5.0, -8.0), 20.0)
    rng = np.random.default_rng(7)
    away = rng.normal(size=(4000, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    points = np.resize(centres, (4000, 3)) + radius_mm * rng.random((4000, 1)) * away
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for bodies, fewest in (((BOX, TUBE), 200), ((BOX, TUBE, shell), 4000)):
        housing = replace(housing_of(*bodies), rim=0.03).seen_from(frame)
        lit = housing.lit_from(centres, radius_mm)
        assert len(lit.tree.corners) < len(housing.tree.corners)
        reach = np.full(4000, np.inf)
        every, few = (body.shadow(points, directions, reach) for body in (housing, lit))
        assert (every.met == few.met).all() and every.met.sum() >= fewest
        for number, body in enumerate(bodies[:2]):
            there = housing_of(body).seen_from(frame).shadow(points, directions, reach).met
            assert there[few.bodies == number].all() and (few.bodies == number).any()
        assert (every.weights == few.weights).all() and (every.by_directions == few.by_directions).all()


def test_weights_have_the_slopes_of_differences() -> None:
    rays = from_point(3000)
    rng = np.random.default_rng(5)
    housing = replace(housing_of(BOX, TUBE), rim=0.05).seen_from(Pose.of_tilts((1.0, 2.0, -3.0), (5.0, -8.0), 20.0))
    reach = np.full(3000, 60.0)
    points = rays.points + rng.normal(size=(3000, 3))
    shadow = housing.shadow(points, rays.directions, reach)
    across = rng.normal(size=(3000, 3))
    across -= (across * rays.directions).sum(axis=1)[:, None] * rays.directions
    moved = rng.normal(size=(3000, 3))
    step = 1e-6

    def at(sign: float) -> np.ndarray:
        directions = rays.directions + sign * step * across
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return housing.shadow(points + sign * step * moved, directions, reach).weights

    slopes = (shadow.by_points * moved + shadow.by_directions * across).sum(axis=1)
    differs = np.abs((at(1.0) - at(-1.0)) / (2.0 * step) - slopes)
    assert ((shadow.weights > 0.0) & (shadow.weights < 1.0)).sum() > 80
    assert (differs > 1e-5 * (1.0 + np.abs(slopes))).sum() <= 3, "where another rim becomes the nearest, or one ends"
    assert np.abs((shadow.by_points * rays.directions).sum(axis=1)).max() < 1e-9, "a ray is a line"
    chosen = np.flatnonzero(shadow.met)[::-2]
    for name, values in shadow.take(chosen)._asdict().items():
        np.testing.assert_array_equal(values, getattr(shadow, name)[chosen], err_msg=name)


@pytest.mark.parametrize(
    ("bodies", "kept"), [(("straight",), "square"), (("straight", "aside"), "mirror_y"), (("turned",), "none")]
)
def test_a_scene_has_the_mirrors_of_its_bodies(bodies: tuple[str, ...], kept: str) -> None:
    places: dict[str, Any] = {
        "straight": {"centre_mm": (0.0, 0.0, 30.0)}, "aside": {"centre_mm": (40.0, 0.0, 30.0)}, "turned": TURNED,
    }  # fmt: skip
    sections = [
        HousingCylinder(name=name, radius_mm=8.0, bore_radius_mm=3.0, length_mm=2.0, **places[name]) for name in bodies
    ]
    names = ("none", "mirror_x", "mirror_y", "diagonal", "rectangle", "square")
    within = {"square": set(names), "mirror_y": {"none", "mirror_y"}, "none": {"none"}}[kept]
    assert {name for name in names if housing_of(*sections).has_mirrors(name)} == within


def test_the_rims_of_a_body_are_the_edges_in_which_it_is_not_flat() -> None:
    """Of a box its twelve; of a tube four circles, and the lines along its facets, but none across a flat face."""
    rims = rims_of(mesh_of(BOX))
    assert sorted(np.linalg.norm(rims[:, 1] - rims[:, 0], axis=1)) == pytest.approx([9.0] * 4 + [16.0] * 4 + [30.0] * 4)
    mesh = mesh_of(TUBE)
    sides = len(mesh.vertices) // 4
    assert len(rims_of(mesh)) == 6 * sides


def test_a_step_file_is_the_body_in_it(tmp_path: Path) -> None:
    path = step_file(
        tmp_path / "two.step", box((4.0, 6.0, 8.0), (0.0, 0.0, 0.0)), box((1.0, 2.0, 3.0), (9.0, 0.0, 0.0))
    )
    mesh = mesh_of(HousingFile(name="two", file=path))
    assert open_edges(mesh) == 0
    assert trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).volume == pytest.approx(192.0 + 6.0)
    assert np.ptp(placed_mesh(HousingFile(name="two", file=path, rotate_z_deg=90.0)).vertices[:, 1]) == pytest.approx(
        11.5
    )


def opened(path: Path) -> Path:
    mesh = trimesh.creation.box((4.0, 4.0, 4.0))
    trimesh.Trimesh(mesh.vertices, mesh.faces[:-1], process=False).export(path)
    return path


def many(path: Path) -> Path:
    triangles = np.zeros(1_000_001, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("none", "<u2")])
    path.write_bytes(bytes(80) + len(triangles).to_bytes(4, "little") + triangles.tobytes())
    return path


FILES = {
    "open": (opened, "its bodies are not closed, 3 edges bound no body; repair it in CAD"),
    "many": (many, "1000001 triangles, at most 1000000 are read; export it more coarsely"),
    "text": (lambda path: (path.write_text("lens"), path)[1], "not readable as STL"),
    "step": (lambda path: (path.write_text("ISO-10303-21; DATA; #1=CLOSED_SHELL('',(#1"), path)[1], "STEP"),
    "none": (lambda path: path, "no such file"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_holds_no_body_is_one_line(name: str, tmp_path: Path) -> None:
    make, phrase = FILES[name]
    with pytest.raises(InputError) as refusal:
        mesh_of(HousingFile(name="it", file=make(tmp_path / "it.stl")))
    assert phrase in str(refusal.value) and "\n" not in str(refusal.value)


TWO = {"lamps": {"kind": "table", "places_mm": [[0.0, 0.0], [0.0, 30.0, 38.0]]}}
ROOM: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"centre_mm": (6.0, 0.0, 2.0)}, {}, "'wall' reaches into the room of the lens, at ("),
    ({"centre_mm": (0.0, 0.0, 10.0), "tilt_deg": (0.0, 80.0)}, {}, "a lens of constraints.max_radius_mm = "),
    ({"centre_mm": (0.0, 0.0, 40.0)}, TWO, ""),
    ({"centre_mm": (0.0, 30.0, 40.0)}, TWO, "room"),
    ({"centre_mm": (0.0, 0.0, -3.0)}, {}, ""),
]  # fmt: skip


@pytest.mark.parametrize(("wall", "more", "message"), ROOM)
def test_no_body_stands_in_the_lens(wall: dict[str, Any], more: dict[str, Any], message: str) -> None:
    """Where a lens may be, and at each lamp; below it a body may stand."""
    spec = small_spec(scene=[{"kind": "box", "name": "wall", "size_mm": (20.0, 20.0, 2.0), **wall}], **more)
    if not message:
        receivers_of(spec, 16)
        return
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        receivers_of(spec, 16)


def test_a_body_in_inches_and_one_that_keeps_a_place_dark_are_told(tmp_path: Path) -> None:
    ring = trimesh.creation.annulus(r_min=20.0, r_max=60.0, height=2.0)
    for scale, told in ((1.0, 0), (25.4, 1)):
        ring.copy().apply_scale(scale).export(tmp_path / f"{told}.stl")
        section = {"kind": "file", "name": "it", "file": str(tmp_path / f"{told}.stl"), "centre_mm": (0.0, 0.0, 60.0)}
        spec = small_spec(scene=[section])
        lines = bodies_that_may_be_in_inches(spec)
        assert len(lines) == told and all("25.4 times too large" in line for line in lines)
    spec = small_spec(
        scene=[{"kind": "box", "name": "cap", "size_mm": (40.0, 40.0, 1.0), "centre_mm": (60.0, 0.0, 79.0)}]
    )
    places = np.array([[60.0, 0.0, 80.0], [60.0, 5.0, 80.0], [60.0, 90.0, 80.0]])
    assert dark_share(spec, places, np.array([1.0, 2.0, 5.0]), False) == pytest.approx(3.0 / 8.0)


def test_what_left_the_lens_alone_is_blocked() -> None:
    rays = exits()
    assert (rays.fates != Fate.LEFT_LENS).sum() > 500
    shadow = replace(RECEIVERS["plane"], housing=housing_of(BOX)).land(rays).shadow
    assert shadow is not None and not shadow.met[~rays.left_lens].any()
