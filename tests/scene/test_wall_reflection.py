"""Light that bodies of a scene reflect, by closed forms: images in mirrors, Lambert's form factors, and all fates."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import small_spec
from test_body_view import patched
from test_housing import BOX, TUBE, from_point, housing_of
from test_posed import RECEIVERS

from lensforge.errors import InputError
from lensforge.light.received_flux import BLOCKED, MISSED_RECEIVER, SECOND_WALL, flux_by_fate
from lensforge.optics.pose import Pose
from lensforge.proof.obstacles import ObstacleBody, Obstacles
from lensforge.proof.sequential_cast import CastFate, Passage
from lensforge.scene.body_view import BodyView
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing
from lensforge.scene.housing_mesh import mesh_of
from lensforge.scene.pixel_grid import PixelGrid, Window, bin_flux
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.wall_reflection import diffused, mirrored, towards_light
from lensforge.seeds import sobol
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.housing_sections import HousingBox, HousingSection

COUNT = 2**14
# A slab whose face -z of its own, at 45 mm, looks down on the lens; and a post beside it, which it hides in part.
SLAB = HousingBox(
    name="slab", size_mm=(70.0, 50.0, 6.0), centre_mm=(12.0, -8.0, 48.0), tilt_deg=(-24.0, 33.0), rotate_z_deg=15.0
)
POST = BOX.changed(name="post", centre_mm=(-32.0, 6.0, 30.0))
MIRROR: dict[str, Any] = {"surface": "mirror", "reflectance": 0.8}
WHITE: dict[str, Any] = {"surface": "diffuse", "reflectance": 0.7}


def plane(facing: tuple[float, float, float], centre: tuple[float, float, float], side: float = 60.0) -> Plane:
    return Plane(Pose.facing(facing, centre, 20.0), PixelGrid(side, side, 8, 8), Window(side, side))


BESIDE = plane((-0.8, 0.35, -0.3), (-70.0, 30.0, 10.0))  # to which the slab reflects


def drawn(rays: ExitRays, seed: int = 1) -> ExitRays:
    return replace(rays, draws=sobol(len(rays.flux), 2, seed))


def face_of_slab() -> tuple[np.ndarray, np.ndarray]:
    """A point and the unit normal of the face that looks at the lens."""
    pose = SLAB.pose
    return pose.points(np.array([[0.0, 0.0, -3.0]]))[0], -np.array(pose.axis)


def test_a_mirror_shows_the_image_of_the_source_ray_by_ray() -> None:
    """Of the second of two bodies, tilted and shifted: rays of the source's mirror image land at the same places."""
    receiver = replace(BESIDE, housing=housing_of(POST, SLAB.changed(**MIRROR)))
    rays = from_point(COUNT)
    landings = receiver.land(rays)
    shadow = landings.shadow
    assert shadow is not None
    point, normal = face_of_slab()
    there = SLAB.pose.to_local_points(shadow.places)
    rows = np.flatnonzero((shadow.bodies == 1) & (np.abs(there[:, 2] + 3.0) < 1e-9))
    image = rays.points - 2.0 * ((rays.points - point) @ normal)[:, None] * normal
    turned = rays.directions - 2.0 * (rays.directions @ normal)[:, None] * normal
    from_image = replace(BESIDE, housing=housing_of(POST)).land(
        ExitRays(image, turned, rays.flux, rays.sin2_exit, rays.fates)
    )
    landed = rows[landings.landed[rows]]
    assert len(landed) > 500 and shadow.again[rows].sum() > 20, "the post hides a part of the mirror image"
    assert (from_image.landed[landed]).all()
    assert landings.hits[landed] == pytest.approx(from_image.hits[landed], abs=2e-5, rel=1e-7)
    assert landings.flux[landed] == pytest.approx(0.8 * from_image.flux[landed], rel=1e-12)
    assert (
        not landings.flux[shadow.again].any() and not (landings.landed | landings.missed_receiver)[shadow.again].any()
    )


def seen_by_lambert(receiver: Plane, point: np.ndarray, normal: np.ndarray) -> float:
    """Form factor of the receiver as a point of a diffuse wall sees it (Lambert's polygon): Σ angle · n·edge / 2π."""
    half = 0.5 * np.array([receiver.grid.width, receiver.grid.height])
    corners = receiver.places(*(half[:, None] * np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]])))
    away = corners - point
    assert (away @ normal > 0.0).all(), "all of it lies before the wall"
    units = away / np.linalg.norm(away, axis=1, keepdims=True)
    after = np.roll(units, -1, axis=0)
    across = np.cross(units, after)
    angles = np.arctan2(np.linalg.norm(across, axis=1), (units * after).sum(axis=1))
    total = (angles * (across @ normal) / np.linalg.norm(across, axis=1)).sum()
    return abs(float(total)) / (2.0 * np.pi)


@pytest.mark.parametrize(
    "receiver", [plane((-0.8, 0.35, -0.3), (-70.0, 30.0, 10.0)), plane((0.2, -0.9, -0.1), (0.0, -60.0, 5.0))]
)
def test_a_lit_spot_of_a_white_wall_lights_a_plane_by_its_form_factor(receiver: Plane) -> None:
    """Quasi-random numbers: far below the noise of as many independent rays."""
    point, normal = face_of_slab()
    start = np.array([1.0, -2.0, 0.5])
    way = (point - start) / np.linalg.norm(point - start)
    ones = np.ones((COUNT, 1))
    rays = ExitRays(
        start * ones, way * ones, np.full(COUNT, 1.0 / COUNT), np.zeros(COUNT), np.zeros(COUNT, dtype=np.int8)
    )
    wanted = 0.7 * seen_by_lambert(receiver, point, normal)
    landings = replace(
        receiver, housing=housing_of(POST.changed(centre_mm=(0.0, 0.0, 900.0)), SLAB.changed(**WHITE))
    ).land(drawn(rays))
    on = float(landings.flux[receiver.window.contains(landings.hits)].sum())
    noise = np.sqrt(wanted * (0.7 - wanted) / COUNT)
    assert wanted > 0.02 and on == pytest.approx(wanted, abs=0.5 * noise)


def test_lambert_s_law_has_its_moments_about_any_normal_and_turns_with_the_scene() -> None:
    """Mean 2/3 along the normal and 0 across, mean squares 1/2 and 1/4; no frame of the scene enters."""
    normal = np.array([[0.3, -0.5, -0.8]]) / np.sqrt(0.98)
    normals = np.repeat(normal, COUNT, axis=0)
    for coming in (-normal, np.array([[0.6, 0.0, 0.8]])):
        directions = np.repeat(coming / np.linalg.norm(coming), COUNT, axis=0)
        going = diffused(directions, normals, sobol(COUNT, 2, 5))
        assert np.linalg.norm(going, axis=1) == pytest.approx(1.0, abs=1e-12)
        along = (going * normals).sum(axis=1)
        across = going - along[:, None] * normals
        assert along.min() > 0.0
        assert along.mean() == pytest.approx(2.0 / 3.0, abs=1e-4) and (along**2).mean() == pytest.approx(0.5, abs=1e-4)
        assert np.abs(across.mean(axis=0)).max() < 1e-3
        squares = across.T @ across / COUNT
        assert squares == pytest.approx(0.25 * (np.eye(3) - normal.T @ normal), abs=1e-3)
    pose = Pose.of_tilts((0.0, 0.0, 0.0), (70.0, -120.0), 33.0)
    turned = diffused(pose.directions(directions), pose.directions(normals), sobol(COUNT, 2, 5))
    assert turned == pytest.approx(pose.directions(going), abs=1e-9)
    facing = towards_light(-normals, directions)
    assert mirrored(mirrored(directions, facing), facing) == pytest.approx(directions, abs=1e-12)


@pytest.mark.parametrize("normal", np.concatenate([np.eye(3), -np.eye(3)]))
def test_light_straight_onto_a_wall_along_an_axis_is_spread_about_its_normal(normal: np.ndarray) -> None:
    """A ray has no direction along such a wall; that of any is as good."""
    normals = np.repeat(normal[None], COUNT, axis=0)
    going = diffused(-normals, normals, sobol(COUNT, 2, 3))
    assert np.linalg.norm(going, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert going.mean(axis=0) == pytest.approx(normal * 2.0 / 3.0, abs=1e-3)


def test_a_lamp_that_leans_sees_the_reflected_light_where_it_is() -> None:
    """Of unequal walls, in the frame of the lamp and in that of the scene."""
    lamp = Pose.of_tilts((14.0, -7.0, 3.0), (25.0, -40.0), 70.0)
    rays = drawn(from_point(2000))
    in_scene = replace(rays, points=lamp.points(rays.points), directions=lamp.directions(rays.directions))
    housing = housing_of(SLAB.changed(**WHITE), TUBE.changed(**MIRROR), POST)
    seen = housing.seen_from(lamp)
    reach = np.full(2000, np.inf)
    rows, by_lamp = seen.reflected(rays, seen.shadow(rays.points, rays.directions, reach))
    same_rows, by_scene = housing.reflected(in_scene, housing.shadow(in_scene.points, in_scene.directions, reach))
    assert rows.tolist() == same_rows.tolist() and len(rows) > 200
    assert lamp.points(by_lamp.points) == pytest.approx(by_scene.points, abs=1e-9)
    assert lamp.directions(by_lamp.directions) == pytest.approx(by_scene.directions, abs=1e-9)
    assert by_lamp.flux == pytest.approx(by_scene.flux, rel=1e-12)


@pytest.mark.parametrize("receiver", ["plane", "far field", "cylinder", "sphere"])
@pytest.mark.parametrize("surface", [MIRROR, WHITE], ids=["mirror", "white"])
def test_all_light_has_an_end(receiver: str, surface: dict[str, Any]) -> None:
    """Landed, missed, taken by the first wall, or at the second one: together what left; a black body adds nothing."""
    housing = housing_of(POST, TUBE.changed(**surface))
    rays = drawn(from_point(COUNT))
    landings = replace(RECEIVERS[receiver], housing=housing).land(rays)
    shadow = landings.shadow
    assert shadow is not None
    ends = flux_by_fate(rays, landings.missed_receiver, shadow)
    met = np.bincount(shadow.bodies[shadow.met], rays.flux[shadow.met])
    reflectance = surface["reflectance"]
    assert ends.sum() == pytest.approx(1.0, abs=1e-12)
    assert ends[BLOCKED] == pytest.approx(met[0] + (1.0 - reflectance) * met[1])
    assert ends[SECOND_WALL] == pytest.approx(reflectance * rays.flux[shadow.again].sum()) and ends[SECOND_WALL] > 0.001
    assert landings.flux.sum() == pytest.approx(ends.sum() - ends[BLOCKED] - ends[SECOND_WALL] - ends[MISSED_RECEIVER])
    assert (shadow.bodies[shadow.again] == 1).all() and (landings.flux[shadow.bodies == 0] == 0.0).all()


def test_between_two_mirrors_light_ends_at_the_second() -> None:
    """A ray from one to the other by hand; without the other it lands."""
    low, high = (
        HousingBox(name=name, size_mm=(80.0, 80.0, 2.0), centre_mm=(x, 0.0, z), **MIRROR)
        for name, x, z in (("low", 60.0, 10.0), ("high", 0.0, 50.0))
    )
    ray = ExitRays(np.zeros((1, 3)), np.array([[0.6, 0.0, 0.8]]), np.ones(1), np.zeros(1), np.zeros(1, dtype=np.int8))
    down = Plane(Pose.facing((0.0, 0.0, -1.0), (0.0, 0.0, -20.0)), PixelGrid(400.0, 400.0, 4, 4))
    both, alone = (replace(down, housing=housing_of(*bodies)).land(ray) for bodies in ((low, high), (high,)))
    assert both.shadow is not None and both.shadow.again.tolist() == [True] and both.flux.tolist() == [0.0]
    assert alone.shadow is not None and alone.shadow.again.tolist() == [False]
    # It meets z = 49 at x = 36.75, and z = -20 at x = 36.75 + 0.75 * 69.
    assert alone.flux.tolist() == [0.8]
    assert down.places(*alone.hits[:1].T)[0] == pytest.approx([88.5, 0.0, -20.0], abs=1e-5)


def obstacle(section: HousingSection) -> ObstacleBody:
    place = section.rotate_z_deg, section.tilt_deg, section.centre_mm
    return ObstacleBody(*mesh_of(section), *place, section.reflectance or 0.0, section.surface == "diffuse")


def test_a_measured_body_has_light_by_way_of_a_wall() -> None:
    """The box in the mirror image of the source, patch by patch; the proof finds it by its own walk and law."""
    measured = POST.changed(patch_mm=6.0)
    rays = drawn(from_point(2**16))
    for surface in (MIRROR, WHITE):
        wall = SLAB.changed(**surface)
        view = replace(BodyView.of(measured), housing=Housing.of([wall]))
        landings = view.land(rays)
        flux = bin_flux(landings.hits, landings.flux, view.grid)[0]
        black = replace(view, housing=Housing.of([SLAB])).land(rays)
        by_wall = flux - bin_flux(black.hits, black.flux, view.grid)[0]
        assert by_wall.min() >= 0.0 and by_wall.sum() > 0.001
        bundle = RayBundle(rays.points, rays.directions, rays.flux)
        passage = replace(
            Passage.of(bundle, 0), points=rays.points, directions=rays.directions, draws=rays.draws,
            fates=np.full(len(rays.flux), CastFate.LANDED),
        )  # fmt: skip
        proof = replace(patched(measured, wall, flux / view.patches.areas_m2), others=[obstacle(wall)])
        judged = proof.judge(bundle, passage)
        assert judged.mean.value == pytest.approx(flux.sum() / view.patches.areas_m2.sum(), rel=1e-6)
        assert judged.apart < 1e-3 and judged.groups > 20


def test_the_proof_s_walls_have_the_law_of_the_design_s() -> None:
    """Ray by ray, on turned bodies, by formulas that share no code; at normal incidence, too."""
    rays = drawn(from_point(4000))
    point, normal = face_of_slab()
    rays.points[:3] = point + 9.0 * normal
    rays.directions[:3] = -normal
    bodies = [POST, SLAB.changed(**WHITE), TUBE.changed(centre_mm=(30.0, 30.0, 40.0), **MIRROR)]
    housing = housing_of(*bodies)
    obstacles = Obstacles.of([obstacle(body) for body in bodies])
    assert obstacles is not None and rays.draws is not None
    reach = np.full(4000, np.inf)
    shadow = housing.shadow(rays.points, rays.directions, reach)
    rows, reflected = housing.reflected(rays, shadow)
    met = obstacles.met(rays.points, rays.directions, reach)
    assert met.onward == pytest.approx(shadow.onward) and len(rows) > 400
    chosen = type(met)(*(column[rows] for column in met))
    points, directions = obstacles.reflect(rays.points[rows], rays.directions[rows], chosen, rays.draws[rows])
    assert points == pytest.approx(reflected.points, abs=1e-9)
    assert directions[3:] == pytest.approx(reflected.directions[3:], abs=1e-9)
    assert rows[:3].tolist() == [0, 1, 2] and (shadow.bodies[:3] == 1).all()
    assert directions[:3] @ normal == pytest.approx(reflected.directions[:3] @ normal, abs=1e-9)


def test_walls_of_unequal_surfaces_are_no_mirror_images() -> None:
    left, right = (
        HousingBox(name=f"at{x:.0f}", size_mm=(4.0, 20.0, 30.0), centre_mm=(x, 0.0, 40.0)) for x in (-30.0, 30.0)
    )
    assert housing_of(left, right).has_mirrors("rectangle")
    assert housing_of(left.changed(**WHITE), right.changed(**WHITE)).has_mirrors("rectangle")
    for other in (WHITE, WHITE | {"reflectance": 0.6}, MIRROR | {"reflectance": 0.7}):
        if other != WHITE:
            assert not housing_of(left.changed(**WHITE), right.changed(**other)).has_mirrors("rectangle")
    assert not housing_of(left, right.changed(**WHITE)).has_mirrors("mirror_x")
    between = HousingBox(name="between", size_mm=(6.0, 8.0, 10.0), centre_mm=(0.0, 0.0, 60.0), **MIRROR)
    left, right = (body.changed(**WHITE) for body in (left, right))
    assert housing_of(left, between, right).has_mirrors("rectangle"), "its own mirror image is unlike the others"
    assert not housing_of(left, between.changed(centre_mm=(0.5, 0.0, 60.0)), right).has_mirrors("rectangle")


def test_the_facets_of_a_mirror_cylinder_turn_light_by_no_more_than_is_stated() -> None:
    """A quarter of a degree, against the law at the cylinder itself."""
    tube = TUBE.changed(**MIRROR)
    rays = from_point(COUNT)
    housing = housing_of(tube)
    shadow = housing.shadow(rays.points, rays.directions, np.full(COUNT, np.inf))
    rows, reflected = housing.reflected(rays, shadow)
    local = tube.pose.to_local_points(shadow.places[rows])
    bore = np.abs(np.hypot(local[:, 0], local[:, 1]) - 14.0) < 1e-3
    normals = tube.pose.directions(local * [1.0, 1.0, 0.0] / np.hypot(local[:, :1], local[:, 1:2]))
    wanted = mirrored(rays.directions[rows], normals)
    apart = np.degrees(np.linalg.norm(wanted - reflected.directions, axis=1))[bore]
    assert bore.sum() > 100 and 0.1 < apart.max() < 0.2501


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"surface": "black", "reflectance": 0.5}, "reflectance = 0.5: a black surface reflects no light; give surface"),
    ({"surface": "mirror"}, 'surface = "mirror": give its reflectance, the share of light that it reflects'),
    ({"surface": "diffuse", "reflectance": 1.2}, "reflectance = 1.2"),
    (
        {**WHITE, "kind": "cylinder", "radius_mm": 30.0, "bore_radius_mm": 20.0, "length_mm": 4.0, "patch_mm": 2.0},
        "the light that this body reflects onto itself is not measured",
    ),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_a_surface_that_is_none_is_refused_in_a_line(change: dict[str, Any], message: str) -> None:
    wall = {"kind": "box", "name": "wall", "size_mm": [9.0, 9.0, 2.0], "centre_mm": [0.0, 0.0, 50.0], **change}
    if wall["kind"] == "cylinder":
        del wall["size_mm"]
    with pytest.raises(InputError) as refusal:
        small_spec(scene=[wall])
    assert message in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_black_body_keeps_its_hash_and_a_convex_one_may_be_measured() -> None:
    black = {"kind": "box", "name": "wall", "size_mm": [9.0, 9.0, 2.0], "centre_mm": [0.0, 0.0, 50.0]}
    assert not {"surface", "reflectance", "refractive_index"} & set(small_spec(scene=[black]).scene[0].model_dump())
    (white,) = small_spec(scene=[{**black, **WHITE, "patch_mm": 2.0}]).scene
    assert white.model_dump()["surface"] == "diffuse" and white.model_dump()["reflectance"] == 0.7
    (clear,) = small_spec(scene=[{**black, "surface": "clear", "refractive_index": 1.5}]).scene
    of_clear = {"refractive_index", "absorption_per_mm"}
    assert of_clear <= set(clear.model_dump()) and not of_clear & set(white.model_dump())
    assert clear.model_dump()["surface"] == "clear" and "reflectance" not in clear.model_dump()
