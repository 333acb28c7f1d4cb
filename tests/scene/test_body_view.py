"""Light on measured bodies by closed forms and by lines of sight; pictures of a search; the walk of the proof."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scenes import small_spec
from test_housing import BOX, SIZE, TUBE, from_point, in_box, in_tube

from lensforge.errors import InputError
from lensforge.light.irradiated_body import IrradiatedBody
from lensforge.proof.obstacles import ObstacleBody
from lensforge.proof.patched_body import PatchedBody
from lensforge.proof.proof_inputs import _patched_bodies
from lensforge.proof.sequential_cast import CastFate, Passage
from lensforge.results.criteria import state_of
from lensforge.results.figure import criteria_in
from lensforge.scene.body_patches import BodyPatches
from lensforge.scene.body_view import BodyPicture, BodyView
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing
from lensforge.scene.housing_mesh import mesh_of
from lensforge.scene.pixel_grid import bin_flux, splat_flux
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.housing_sections import HousingBox, HousingSection
from lensforge.spec.light_limits import BodyLimit

POINT = np.array([1.0, -2.0, 0.5])  # from which ``from_point`` sends 1 W evenly into a hemisphere
W_PER_SR = 1.0 / (2.0 * np.pi)
MEASURED = BOX.changed(patch_mm=3.0)
TUBE_BEHIND = TUBE.changed(centre_mm=(-9.0, 12.0, 44.0), patch_mm=4.0)
IRRADIANCE = {"kind": "body", "unit": "w_per_m2", "at_least": 1.0}


def seen_sr(corners: np.ndarray, point: np.ndarray = POINT) -> np.ndarray:
    """Solid angles of triangles as a point sees them (van Oosterom and Strackee), below 0 from within."""
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(vectors, axis=1) for vectors in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    sums = la * lb * lc + lc * np.einsum("ij,ij->i", a, b) + la * np.einsum("ij,ij->i", b, c)
    return -2.0 * np.arctan2(volume, sums + lb * np.einsum("ij,ij->i", a, c))


def flux_on(view: BodyView, rays: ExitRays) -> np.ndarray:
    landings = view.land(rays)
    return bin_flux(landings.hits, landings.flux, view.grid)[0]


def test_a_box_has_the_solid_angles_of_its_lit_faces_and_three_dark_ones() -> None:
    """Patch by patch within five standard errors; patches are of one face, and no wider than they are to be."""
    view = BodyView.of(MEASURED)
    patches = view.patches
    assert patches.areas_mm2.sum() == pytest.approx(2.0 * (30 * 16 + 16 * 9 + 9 * 30), rel=1e-12)
    assert np.sort(np.abs(patches.normals), axis=1) == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(patches), 1)))
    for number in range(len(patches)):
        corners = patches.corners[patches.numbers == number].reshape(-1, 3)
        assert np.ptp(corners, axis=0).max() <= 1.5 * 3.0
    solid_sr = seen_sr(view.pose.points(patches.corners))
    exact = W_PER_SR * np.bincount(patches.numbers, np.maximum(solid_sr, 0.0))
    count = 2**18
    flux = flux_on(view, from_point(count))
    lit = exact > 0.0
    faces = {tuple(normal) for normal in np.round(patches.normals[lit]).tolist()}
    assert len(faces) == 3 and not flux[~lit].any()
    errors = np.sqrt(exact[lit] / count)
    assert (np.abs(flux[lit] - exact[lit]) < 5.0 * errors).all()
    assert np.mean(((flux[lit] - exact[lit]) / errors) ** 2) == pytest.approx(1.0, abs=0.4)


@pytest.mark.parametrize(("axis", "lit_mm2"), [(0, 16.0 * 9.0), (2, 30.0 * 16.0)])
def test_the_dark_share_of_a_body_is_that_of_its_area(axis: int, lit_mm2: float) -> None:
    """Of a box with light on one face alone, whose patches are larger or smaller than those of the others."""
    view = BodyView.of(MEASURED)
    on_face = np.where(view.patches.normals[:, axis] > 0.9, 1e-3, 0.0)
    body = IrradiatedBody.of(view, np.stack([on_face, 3.0 * on_face]))
    whole_mm2 = 2.0 * (30 * 16 + 16 * 9 + 9 * 30)
    assert body.area_mm2 == pytest.approx(whole_mm2)
    assert body.dark == pytest.approx(1.0 - lit_mm2 / whole_mm2, rel=1e-12)
    assert body.mean.value == pytest.approx(2.0 * on_face.sum() / (1e-6 * whole_mm2))
    least = view.pose.to_local_points(np.array([body.least_mm]))[0]
    assert body.least.value == 0.0 and least[axis] < 0.49 * SIZE[axis]


def test_a_tube_is_dark_in_its_own_shadow_and_in_that_of_another_body() -> None:
    """By steps from points of its surface to the source, which see no triangle; its bore is lit in part."""
    view = replace(BodyView.of(TUBE_BEHIND), housing=Housing.of([BOX]))
    patches = view.patches
    rng = np.random.default_rng(5)
    sides = rng.random((16, len(patches.corners), 2))
    sides = np.where(sides.sum(axis=2, keepdims=True) > 1.0, 1.0 - sides, sides)
    first, second, third = np.moveaxis(view.pose.points(patches.corners), 1, 0)
    places = first + sides[..., :1] * (second - first) + sides[..., 1:] * (third - first)
    towards = POINT - places
    away = np.linalg.norm(towards, axis=2)
    cosines = (towards * view.pose.directions(patches.piece_normals)).sum(axis=2) / away
    turned = TUBE_BEHIND.pose

    def blocked(points: np.ndarray) -> np.ndarray:
        return in_box(points) | in_tube(TUBE.pose.points(turned.to_local_points(points)))

    free = cosines > 0.0
    for share in np.linspace(0.004, 1.0, 300):
        free[free] = ~blocked((places + share * towards)[free])
    areas = np.linalg.norm(np.cross(second - first, third - first), axis=1) / 2.0
    on_pieces = W_PER_SR * areas * np.where(free, cosines / away**2, 0.0).mean(axis=0)
    wanted = np.bincount(patches.numbers, on_pieces)
    count = 2**18
    flux = flux_on(view, from_point(count))
    lone = flux_on(BodyView.of(TUBE_BEHIND), from_point(count))
    assert flux.sum() < 0.9 * lone.sum(), "the box before it decides"
    assert flux.sum() == pytest.approx(wanted.sum(), rel=0.02)
    noise = np.sqrt(wanted / count)
    assert (np.abs(flux - wanted) < 5.0 * noise + 0.1 * wanted + 2e-5).all()
    inside = (patches.normals[:, :2] * patches.centres_mm[:, :2]).sum(axis=1) < -1.0
    assert flux[inside].sum() > 0.0 and (flux[inside] == 0.0).any(), "of the bore, its own shadow"


def test_what_a_limit_reads_is_irradiance_of_the_patches_that_face_its_direction() -> None:
    view = BodyView.of(MEASURED)
    flux = flux_on(view, from_point(2**12))
    out = MEASURED.pose.directions(np.array([[-1.0, 0.0, 0.0]]))[0]
    limit = BodyLimit(body="box", facing=tuple(3.0 * out), within_deg=20.0, **IRRADIANCE)
    on_face = patches_of_face(view, [-1.0, 0.0, 0.0])
    read = view.readings(limit) @ flux
    assert read == pytest.approx(1e6 * flux[on_face] / view.patches.areas_mm2[on_face])
    (mean,) = view.readings(limit.changed(of="mean")) @ flux
    assert mean == pytest.approx(1e6 * flux[on_face].sum() / (SIZE[1] * SIZE[2]))
    (whole,) = view.readings(BodyLimit(body="box", of="mean", **IRRADIANCE)) @ flux
    assert whole == pytest.approx(1e6 * flux.sum() / view.patches.areas_mm2.sum())
    with pytest.raises(InputError, match=r"no patch of 'box' faces .* within 1 deg; widen within_deg, or turn facing"):
        view.readings(limit.changed(facing=(1.0, 1.0, 1.0), within_deg=1.0))


def patches_of_face(view: BodyView, normal: list[float]) -> np.ndarray:
    return np.flatnonzero(view.patches.normals @ normal > 0.9)


@pytest.mark.parametrize("body", [MEASURED, TUBE_BEHIND], ids=["box", "tube"])
def test_a_picture_of_a_search_reads_what_patches_have(body: HousingSection) -> None:
    """Of even intensity from the origin: I cos / r² on each lit patch; rays that pass beside the body land there."""
    rays = from_point(2**19)
    rays = replace(rays, points=4.0 * rays.directions)  # on lines through the origin
    others = Housing.of([BOX]) if body is TUBE_BEHIND else None
    view = replace(BodyView.of(body), housing=others)
    limit = BodyLimit(body=body.name, facing=(0.0, 0.0, -1.0), within_deg=75.0, **IRRADIANCE)
    picture = BodyPicture.of(view, 0, limit, 3.0, 200)
    landings = picture.land(rays)
    image = splat_flux(landings.hits, landings.flux, picture.grid)
    read = picture.readings(limit) @ image.ravel()
    by_patches = view.readings(limit) @ flux_on(view, rays)
    lit = np.sort(by_patches[by_patches > 0.4 * by_patches.max()])
    assert len(lit) > 20 and np.sort(read)[-len(lit) :] == pytest.approx(lit, rel=0.08)
    mean = limit.changed(of="mean")
    (by_picture,) = picture.readings(mean) @ image.ravel()
    (exact,) = view.readings(mean) @ flux_on(view, rays)
    assert by_picture == pytest.approx(exact, rel=0.03)
    inside = np.abs(landings.hits) <= 0.5 * np.array(picture.grid.size)
    _, pieces = picture.met(
        picture.pose.to_local_points(rays.points), picture.pose.to_local_directions(rays.directions)
    )
    beside = landings.landed & inside.all(axis=1) & (pieces < 0)
    units = picture.towards.to_local_directions(rays.directions[beside])
    assert beside.sum() > 1000
    assert landings.hits[beside] == pytest.approx(units[:, :2] * np.sqrt(2.0 / (1.0 + units[:, 2:])), abs=1e-9)


def cast_of(rays: Any) -> tuple[RayBundle, Passage]:
    bundle = RayBundle(rays.points, rays.directions, rays.flux)
    landed = np.full(len(rays.flux), CastFate.LANDED)
    return bundle, replace(Passage.of(bundle, 0), points=rays.points, directions=rays.directions, fates=landed)


def patched(
    body: HousingSection, other: HousingSection, irradiance: np.ndarray, designed_rays: int = 2**20
) -> PatchedBody:
    def obstacle(section: HousingSection, mesh: Any) -> ObstacleBody:
        placed = *mesh, section.rotate_z_deg, section.tilt_deg, section.centre_mm
        return ObstacleBody(*placed, section.reflectance or 0.0, section.surface == "diffuse")

    patches = BodyPatches.of(body)
    pieces = patches.corners.reshape(-1, 3), np.arange(patches.corners.size // 3).reshape(-1, 3)
    return PatchedBody(
        body.name, obstacle(body, pieces), patches.numbers, [obstacle(other, mesh_of(other))], irradiance, designed_rays
    )


def test_the_proof_finds_the_light_of_each_patch_by_its_own_walk() -> None:
    """The same rays meet the same patches; other rays agree within noise; light on other patches fails."""
    view = replace(BodyView.of(TUBE_BEHIND), housing=Housing.of([BOX]))
    areas_m2 = 1e-6 * view.patches.areas_mm2
    rays = from_point(2**16)
    flux = flux_on(view, rays)
    same = patched(TUBE_BEHIND, BOX, flux / areas_m2).judge(*cast_of(rays))
    assert same.mean.value == pytest.approx(flux.sum() / areas_m2.sum(), rel=1e-12)
    assert same.apart < 1e-20 and same.in_dark == 0.0 and same.groups > 50
    many = flux_on(view, from_point(2**20, seed=3)) / areas_m2
    other = patched(TUBE_BEHIND, BOX, many).judge(*cast_of(from_point(2**14, seed=9)))
    assert other.mean_apart < 4.0 * (other.mean.standard_error or 0.0)
    assert other.apart == pytest.approx(1.0, abs=0.5)
    few = flux_on(view, from_point(2**13, seed=4)) / areas_m2
    noisy = patched(TUBE_BEHIND, BOX, few, 2**13).judge(*cast_of(from_point(2**14, seed=9)))
    assert noisy.apart == pytest.approx(1.0, abs=0.5), "whose light by the design has noise, too"
    assert other.least_design == many.min() and other.least.value == pytest.approx(0.0)
    judged = {criterion.key: criterion.state for criterion in criteria_in(None, other)}
    assert judged == {"body_patches": "pass", "body_in_dark": "pass", "body_mean_apart": "pass"}
    shifted = patched(TUBE_BEHIND, BOX, np.roll(many, 40)).judge(*cast_of(from_point(2**14, seed=9)))
    wrong = {criterion.key for criterion in criteria_in(None, shifted) if criterion.state == "fail"}
    assert wrong == {"body_patches", "body_in_dark"}
    without = patched(TUBE_BEHIND, BOX.changed(centre_mm=(0.0, 0.0, 900.0)), many)
    failed = list(criteria_in(None, without.judge(*cast_of(from_point(2**14, seed=9)))))
    assert state_of(failed, "body_mean_apart") == "fail", "the body before it decides"


def test_light_by_a_mirror_comes_from_the_image_of_its_source_in_the_design_and_in_the_proof() -> None:
    """A box whose sides towards the wall x = -40 mm are lit by that alone, by 0.6 of the light of the image."""
    wall = HousingBox(
        name="wall", size_mm=(2.0, 4000.0, 4000.0), centre_mm=(-41.0, 0.0, 2000.5), surface="mirror", reflectance=0.6
    )
    view = BodyView.of(MEASURED)
    image = POINT * (-1.0, 1.0, 1.0) - (80.0, 0.0, 0.0)
    corners = view.pose.points(view.patches.corners)
    direct, mirrored = (
        np.bincount(view.patches.numbers, W_PER_SR * np.maximum(seen_sr(corners, point), 0.0))
        for point in (POINT, image)
    )
    rays = from_point(2**18)
    flux = flux_on(replace(view, housing=Housing.of([wall])), rays)
    only = (direct == 0.0) & (mirrored > 0.0)
    share = mirrored[only].sum()
    assert only.sum() > 20 and flux[only].sum() == pytest.approx(0.6 * share, rel=4.0 / np.sqrt(share * len(rays.flux)))
    assert flux.sum() == pytest.approx(direct.sum() + 0.6 * mirrored.sum(), rel=0.01)
    same = patched(MEASURED, wall, flux / (1e-6 * view.patches.areas_mm2)).judge(*cast_of(rays))
    assert same.mean.value == pytest.approx(same.mean_design, rel=1e-12) and same.apart < 1e-20


def test_each_measured_body_of_a_scene_is_compared_with_its_own_light_behind_all_others() -> None:
    sections = [BOX, MEASURED.changed(name="second", centre_mm=(0.0, 0.0, 900.0)), TUBE.changed(patch_mm=9.0)]
    spec = small_spec(scene=[section.model_dump() for section in sections])
    by_design = {name: np.full(3, value) for name, value in (("tube", 2.0), ("second", 5.0))}
    measured = [SimpleNamespace(name=name, irradiance=irradiance) for name, irradiance in by_design.items()]
    bodies = _patched_bodies(spec, SimpleNamespace(on_bodies=measured, rays=4096))
    assert [body.name for body in bodies] == ["second", "tube"]
    for body in bodies:
        np.testing.assert_array_equal(body.designed, by_design[body.name])
        assert body.designed_rays == 4096
        others = [section for section in sections if section.name != body.name]
        assert [other.centre_mm for other in body.others] == [section.centre_mm for section in others]


def test_the_error_of_the_mean_is_that_of_the_share_of_the_rays_that_land() -> None:
    """Of n equal rays of which k meet the body, k (1 - k/n) is the variance: nothing where all do."""
    rays = from_point(2**12)
    local = TUBE_BEHIND.pose.to_local_points(rays.points), TUBE_BEHIND.pose.to_local_directions(rays.directions)
    met = BodyView.of(TUBE_BEHIND).met(*local)[1] >= 0
    hit, miss = (np.flatnonzero(flags)[0] for flags in (met, ~met))
    areas_m2 = 1e-6 * BodyPatches.of(TUBE_BEHIND).areas_mm2
    far_off = BOX.changed(centre_mm=(0.0, 0.0, 900.0))
    for landing in (100, 60):
        chosen = [hit] * landing + [miss] * (100 - landing)
        equal = SimpleNamespace(points=rays.points[chosen], directions=rays.directions[chosen], flux=np.full(100, 0.3))
        judged = patched(TUBE_BEHIND, far_off, np.ones(len(areas_m2))).judge(*cast_of(equal))
        assert judged.mean.value == pytest.approx(0.3 * landing / areas_m2.sum())
        error_w = 0.3 * np.sqrt(landing * (1.0 - landing / 100.0))
        assert judged.mean.standard_error == pytest.approx(error_w / areas_m2.sum(), abs=1e-6 / areas_m2.sum())


def test_patches_that_are_too_many_are_refused_in_a_line() -> None:
    with pytest.raises(InputError) as refusal:
        BodyPatches.of(BOX.changed(patch_mm=1e-2))
    message = str(refusal.value)
    assert "patch_mm = 0.01 cuts its surface into more than 524288 pieces; take a larger one" in message


LIMITS: list[tuple[dict[str, Any], str]] = [
    ({}, "limits.0.body = 'box': the scene has no body of that name with patch_mm; known: none"),
    ({"receiver": "light"}, "receiver: it is on the body itself; leave it out"),
    ({"meter_mm": 3.0}, "meter: light on a body is the mean of a patch; give the body patch_mm"),
    ({"unit": "cd"}, "give at_least or at_most, and unit: w_per_m2, mw_per_cm2"),
    ({"facing": [0.0, 0.0, 0.0]}, "facing = (0, 0, 0) is no direction"),
    ({"unit": "mj_per_cm2"}, "a dose (mj_per_cm2) and exposure_s"),
]


@pytest.mark.parametrize(("change", "message"), LIMITS)
def test_a_limit_that_is_not_one_of_a_body_is_refused_in_a_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refusal:
        small_spec(scene=[{**BOX.model_dump(exclude_unset=True)}], limits=[{**IRRADIANCE, "body": "box", **change}])
    assert message in str(refusal.value) and "\n" not in str(refusal.value)
