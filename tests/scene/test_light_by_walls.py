"""Slopes of the light that walls reflect in a search: by differences, by averages, and at the surfaces of facets."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from landed import as_tensors
from scenes import small_spec
from test_housing import BOX, TUBE, from_point, housing_of
from test_posed import RECEIVERS
from test_wall_reflection import BESIDE, MIRROR, POST, SLAB, WHITE, drawn

from lensforge.optics.pose import Pose
from lensforge.scene.body_view import body_pictures, body_views
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import bin_flux, splat_flux
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.wall_reflection import diffused
from lensforge.seeds import sobol
from lensforge.spec.housing_sections import HousingBox, HousingCylinder, HousingSection
from lensforge.spec.light_limits import BodyLimit
from lensforge.surfaces.smooth_facets import facet_curvatures

COUNT = 2**12
STEP = 1e-6
FRAME = Pose.of_tilts((1.0, 2.0, -1.0), (5.0, -8.0), 20.0)
RING = HousingCylinder(
    name="ring", radius_mm=60.0, bore_radius_mm=30.0, length_mm=40.0, centre_mm=(3.0, -2.0, 20.0), tilt_deg=(6.0, -9.0)
)
KNOB = HousingBox(name="knob", size_mm=(7.0, 5.0, 4.0), centre_mm=(8.0, -5.0, 24.0), tilt_deg=(30.0, 10.0))
Motion = tuple[np.ndarray, np.ndarray]


def searched(receiver: PosedReceiver, *bodies: HousingSection, rim_deg: float = 0.6) -> PosedReceiver:
    return replace(receiver, housing=housing_of(*bodies).seen_from(FRAME)).searched(rim_deg, 6.0)


def motions(rays: ExitRays, seed: int = 5) -> Motion:
    """Moves of the points and turns of the directions."""
    moved, turned = np.random.default_rng(seed).normal(size=(2, *rays.points.shape))
    return moved, turned - (turned * rays.directions).sum(axis=1)[:, None] * rays.directions


def displaced(rays: ExitRays, by: Motion, step: float) -> ExitRays:
    directions = rays.directions + step * by[1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return replace(rays, points=rays.points + step * by[0], directions=directions)


@pytest.mark.parametrize("name", ["beside", "far field", "cylinder", "sphere"])
def test_light_by_a_tilted_mirror_has_the_slopes_of_differences(name: str) -> None:
    """Ray by ray, of the second of two bodies, in a frame that leans; the flux by what the mirror leaves of it."""
    receiver = searched(RECEIVERS.get(name, BESIDE), POST, SLAB.changed(**MIRROR), KNOB, rim_deg=3.0)
    rays = from_point(COUNT)
    by = motions(rays)
    low, landings, high = (receiver.land(displaced(rays, by, step)) for step in (-STEP, 0.0, STEP))
    assert landings.by_walls is not None and landings.shadow is not None
    by_hits, by_flux = (np.random.default_rng(2).normal(size=shape) for shape in ((COUNT, 2), COUNT))
    by_rays, of_flux = receiver.adjoint(rays, by_hits, by_flux, landings)
    slopes = (by_rays.by_points * by[0] + by_rays.by_directions * by[1]).sum(axis=1)
    changes = ((by_hits * (high.hits - low.hits)).sum(axis=1) + by_flux * (high.flux - low.flux)) / (2.0 * STEP)
    rows = landings.by_walls.rows
    assert len(rows) > 150 and (landings.shadow.bodies[rows] == 1).all() and landings.shadow.again.sum() > 5
    share = landings.shadow.onward[rows]
    assert landings.flux[rows] == pytest.approx(share * rays.flux[rows], rel=1e-12)
    assert of_flux[rows] == pytest.approx(share * by_flux[rows], rel=1e-12)
    assert share.max() == 0.8 and ((share < 0.79) & (share > 0.01)).sum() > 3, "some pass the rim of the other body"
    differs = np.abs(changes[rows] - slopes[rows]) > 1e-5 * (1.0 + np.abs(slopes[rows]))
    assert differs.sum() <= 2, "where the motion itself goes over an edge"


@pytest.mark.parametrize("name", ["beside", "far field", "sphere"])
@pytest.mark.parametrize("surface", [MIRROR, WHITE], ids=["mirror", "white"])
def test_a_search_in_torch_sees_the_same_light_by_walls(name: str, surface: dict[str, Any]) -> None:
    bodies = POST, RING.changed(**surface), SLAB.changed(**WHITE), KNOB
    receiver = searched(RECEIVERS.get(name, BESIDE), *bodies, rim_deg=3.0)
    rays = drawn(from_point(COUNT))
    by_hits, by_flux = (np.random.default_rng(2).normal(size=shape) for shape in ((COUNT, 2), COUNT))
    wanted = receiver.land(rays)
    by_rays, of_flux = receiver.adjoint(rays, by_hits * wanted.landed[:, None], by_flux * wanted.landed, wanted)
    tensors = replace(as_tensors(rays), draws=rays.draws)
    leaves = [column.requires_grad_() for column in (tensors.points, tensors.directions, tensors.flux)]
    landings = receiver.land_by_arrays(tensors)
    assert (landings.landed.numpy() == wanted.landed).all()
    assert (landings.missed_receiver.numpy() == wanted.missed_receiver).all()
    assert landings.hits.detach().numpy() == pytest.approx(wanted.hits, rel=1e-9, abs=1e-9)
    assert landings.flux.detach().numpy() == pytest.approx(wanted.flux, rel=1e-12)
    assert wanted.by_walls is not None and len(wanted.by_walls.rows) > 150
    landed = landings.landed
    total = (landings.hits[landed] * torch.from_numpy(by_hits)[landed]).sum()
    total = total + (landings.flux[landed] * torch.from_numpy(by_flux)[landed]).sum()
    gradients = torch.autograd.grad(total, leaves)
    ours = by_rays.by_points, by_rays.by_directions, of_flux * rays.left_lens
    for gradient, our in zip(gradients, ours, strict=True):
        across = gradient.numpy()
        if across.ndim > 1:  # a direction is a unit vector
            across = across - (across * rays.directions).sum(axis=1)[:, None] * rays.directions
            our = our - (our * rays.directions).sum(axis=1)[:, None] * rays.directions
        lit = landings.flux.detach().numpy() > 0.0
        assert across[lit] == pytest.approx(our[lit], rel=1e-7, abs=1e-7 * np.abs(our).max())


@pytest.mark.parametrize("receiver", [RECEIVERS["far field"], RECEIVERS["sphere"], BESIDE])
def test_a_search_counts_the_light_by_walls_that_an_evaluation_counts(receiver: PosedReceiver) -> None:
    """Beside its rims alone it differs; light from a wall meets the backs of bodies, which light of the lens cannot."""
    bodies = (
        POST,
        SLAB.changed(**WHITE),
        RING.changed(**MIRROR),
        BOX.changed(name="other", centre_mm=(30.0, -20.0, 28.0)),
    )
    rays = drawn(from_point(2**14))
    search = searched(receiver, *bodies, rim_deg=1e-7)
    assert search.housing is not None and search.housing.whole is not None
    assert len(search.housing.tree.corners) < len(search.housing.whole.corners)
    seen = search.land(rays)
    wanted = replace(receiver, housing=housing_of(*bodies).seen_from(FRAME)).land(rays)
    assert seen.by_walls is not None and wanted.shadow is not None and seen.shadow is not None
    assert len(seen.by_walls.rows) > 500
    assert seen.flux == pytest.approx(wanted.flux, rel=1e-9, abs=1e-15)
    assert (seen.missed_receiver == wanted.missed_receiver).all()
    assert (seen.shadow.again == wanted.shadow.again).all() and wanted.shadow.again.sum() > 200
    landed = wanted.landed
    assert (seen.hits[landed] == wanted.hits[landed]).all() and seen.landed[landed].all()


def spot(point: np.ndarray, direction: np.ndarray, count: int) -> ExitRays:
    """The same ray so many times."""
    ones = np.ones((count, 1))
    ray = point * ones, direction / np.linalg.norm(direction) * ones
    return ExitRays(*ray, np.full(count, 1.0 / count), np.zeros(count), np.zeros(count, dtype=np.int8))


def bright(hits: np.ndarray) -> np.ndarray:
    """A light that is wanted: smooth, and soon none."""
    return np.exp(-0.5 * (((hits - [4.0, -7.0]) / 18.0) ** 2).sum(axis=1))


def slope_of_mean(receiver: PosedReceiver, rays: ExitRays, by: Motion) -> float:
    """The change of the mean of :func:`bright` with a motion of the rays, by the adjoint."""
    landings = receiver.land(rays)
    by_hits = -((landings.hits - [4.0, -7.0]) / 18.0**2) * bright(landings.hits)[:, None]
    by_hits *= (landings.landed / len(rays.flux))[:, None]
    by_rays, _ = receiver.adjoint(rays, by_hits, np.zeros(len(rays.flux)), landings)
    return float((by_rays.by_points * by[0] + by_rays.by_directions * by[1]).sum())


WAYS = [((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((0.0, 0.0, 0.0), (0.3, -0.8, 0.0)), ((0.0, 1.0, 0.0), (0.5, 0.2, 0.0))]


@pytest.mark.parametrize("way", WAYS)
def test_the_mean_of_light_by_a_diffuse_wall_has_the_slope_of_its_differences(way: Any) -> None:
    """The frame of a wall turns with the ray in the differences, not in the slope: the means agree."""
    receiver = replace(BESIDE, housing=housing_of(SLAB.changed(**WHITE))).searched(0.6, 6.0)
    rays = replace(spot(np.array([1.0, -2.0, 0.5]), np.array([8.0, -9.0, 45.0]), 2**15), draws=sobol(2**15, 2, 3))
    moved, turned = (np.array(vector) * np.ones((2**15, 1)) for vector in way)
    by = moved, turned - (turned * rays.directions).sum(axis=1)[:, None] * rays.directions
    step = 0.02
    high, low = (receiver.land(displaced(rays, by, sign * step)) for sign in (1.0, -1.0))
    change = (bright(high.hits) * high.landed - bright(low.hits) * low.landed).mean() / (2.0 * step)
    assert abs(change) > 1e-4
    assert slope_of_mean(receiver, rays, by) == pytest.approx(change, rel=0.02)


def at_bore(rays: ExitRays) -> tuple[np.ndarray, np.ndarray]:
    """Places and normals where rays meet the bore of the ring itself, no facet."""
    starts, ways = RING.pose.to_local_points(rays.points), RING.pose.to_local_directions(rays.directions)
    square = (ways[:, :2] ** 2).sum(axis=1)
    half = (starts[:, :2] * ways[:, :2]).sum(axis=1)
    path = (np.sqrt(half**2 - square * ((starts[:, :2] ** 2).sum(axis=1) - 900.0)) - half) / square
    places = starts + path[:, None] * ways
    normals = -places * [1.0, 1.0, 0.0] / 30.0
    return RING.pose.points(places), RING.pose.directions(normals)


def behind_bore(law: Callable[..., np.ndarray], rays: ExitRays) -> ExitRays:
    places, normals = at_bore(rays)
    return replace(rays, points=places, directions=law(rays.directions, normals))


def by_mirror(directions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    return directions - 2.0 * (directions * normals).sum(axis=1)[:, None] * normals


ABOVE = RECEIVERS["plane on the axis"]


def test_light_by_a_mirror_of_facets_has_the_slopes_of_the_cylinder_that_they_stand_for() -> None:
    """Flat facets turn no normal: without the curvature most slopes across the axis are wrong by far."""
    receiver = replace(ABOVE, housing=housing_of(RING.changed(**MIRROR))).searched(0.6, 6.0)
    rays = from_point(COUNT)
    landings = receiver.land(rays)
    assert landings.by_walls is not None
    rows = landings.by_walls.rows
    places, _ = at_bore(rays.take(rows))
    rows = rows[np.abs(RING.pose.to_local_points(places)[:, 2]) < 19.9]
    rows = rows[np.abs(landings.hits[rows]).max(axis=1) < 150.0]  # beyond, slopes grow without bound
    height = RING.pose.to_local_points(at_bore(rays.take(rows))[0])[:, 2]
    assert landings.shadow is not None
    share = landings.shadow.onward[rows]
    assert (share[np.abs(height) < 17.0] == 0.8).all(), "lines between facets are no rims"
    assert share[np.argmax(height)] < 0.4, "at its rim the mirror is dark"
    by = motions(rays)
    by_hits = np.random.default_rng(2).normal(size=(COUNT, 2))
    by_rays, _ = receiver.adjoint(rays, by_hits, np.zeros(COUNT), landings)
    slopes = (by_rays.by_points * by[0] + by_rays.by_directions * by[1]).sum(axis=1)[rows]
    low, high = (
        ABOVE.land(behind_bore(by_mirror, displaced(rays, by, step).take(rows))).hits for step in (-STEP, STEP)
    )
    changes = (by_hits[rows] * (high - low)).sum(axis=1) / (2.0 * STEP)
    assert len(rows) > 300
    assert np.sqrt(((slopes - changes) ** 2).mean() / (changes**2).mean()) < 0.02


def test_light_by_a_diffuse_cylinder_turns_with_its_normal() -> None:
    """The lobe of a spot at the middle of a facet, as the spot moves along the wall."""
    count = 2**15
    receiver = replace(ABOVE, housing=housing_of(RING.changed(**WHITE))).searched(0.6, 6.0)
    middle = RING.pose.points(np.array([[30.0 * np.cos(0.3), 30.0 * np.sin(0.3), 9.0]]))[0]
    start = np.array([1.0, -2.0, 0.5])
    rays = replace(spot(start, middle - start, count), draws=sobol(count, 2, 3))
    for axis in range(3):
        moved = np.zeros((count, 3))
        moved[:, axis] = 1.0
        by = moved, np.zeros((count, 3))
        change = 0.0
        for sign in (0.1, -0.1):
            there = displaced(rays, by, sign)
            behind = behind_bore(lambda ways, normals: diffused(ways, normals, rays.draws), there)
            landed = ABOVE.land(behind)
            change += (bright(landed.hits) * landed.landed).mean() / (2.0 * sign)
        assert slope_of_mean(receiver, rays, by) == pytest.approx(change, rel=0.05, abs=1e-5)


def test_facets_have_the_curvature_of_their_surface() -> None:
    """Of a ball to some percent; a box is flat, and a tube bends about its axis alone, the bore the other way."""
    ball = trimesh.creation.icosphere(4, 10.0)
    normals = ball.face_normals
    wanted = (np.eye(3) - normals[:, :, None] * normals[:, None]) / 10.0
    error = facet_curvatures(np.asarray(ball.triangles)) - wanted
    assert np.sqrt((error**2).sum() / (wanted**2).sum()) < 0.05
    housing = housing_of(BOX.changed(**WHITE), TUBE.changed(**MIRROR))
    assert np.abs(housing.curvatures[housing.bodies == 0]).max() < 1e-12
    axis = np.array(TUBE.pose.axis)
    tube = housing.bodies == 1
    side = tube & (np.abs(housing.normals @ axis) < 0.5)
    across = np.cross(axis, housing.normals[side])
    bends = np.einsum("ti,tij,tj->t", across, housing.curvatures[side], across)
    assert sorted(set(np.round(bends, 4))) == pytest.approx([-1.0 / 14.0, 1.0 / 21.0], abs=1e-4)
    assert np.abs(housing.curvatures[side] @ axis).max() < 1e-9
    assert np.abs(housing.curvatures[tube & ~side]).max() < 1e-9
    faces, sides = housing.faces
    assert sorted(np.unique(faces[tube], return_counts=True)[1]) == [2880] * 4 and len(set(faces[~tube])) == 6
    assert (sides[:, 0] == sides[:, 1]).sum() == 2 * 1440, "the lines between the facets of bore and jacket"


BAR = {
    "kind": "cylinder", "name": "bar", "radius_mm": 9.0, "length_mm": 50.0, "centre_mm": [6.0, -9.0, 70.0],
    "tilt_deg": [20.0, 80.0], "patch_mm": 5.0,
}  # fmt: skip
BEHIND = {
    "kind": "box", "name": "behind", "size_mm": [160.0, 130.0, 2.0], "centre_mm": [10.0, 5.0, 104.0],
    "tilt_deg": [9.0, -12.0], **WHITE,
}  # fmt: skip
DARK = {"kind": "box", "name": "dark", "size_mm": [9.0, 30.0, 20.0], "centre_mm": [-30.0, 10.0, 50.0]}
FAR_SIDE = {
    "kind": "body", "body": "bar", "facing": [0.1, 0.0, 1.0], "within_deg": 40.0, "at_least": 1.0, "unit": "w_per_m2"
}  # fmt: skip


def test_a_picture_of_a_side_that_walls_alone_light_reads_what_its_patches_have() -> None:
    """Of light that passes the bar; on the side of the lens nothing counts, and no other body hides the picture."""
    spec = small_spec(scene=[DARK, BAR, BEHIND], limits=[FAR_SIDE, FAR_SIDE | {"of": "mean"}])
    rays = drawn(from_point(2**17))
    (view,) = body_views(spec)
    flux = view.land(rays)
    by_patch = bin_flux(flux.hits, flux.flux, view.grid).ravel()
    for picture, limit, spread in zip(body_pictures(spec), spec.limits, (0.3, 0.03), strict=True):
        assert isinstance(limit, BodyLimit)
        search = picture.searched(1e-7, 6.0)
        seen = search.land(rays)
        image = splat_flux(seen.hits, seen.flux, search.grid).ravel()
        wanted = view.readings(limit) @ by_patch
        read = search.readings(limit) @ image
        assert len(read) == len(wanted) and wanted.min() > 0.0
        brighter = (len(wanted) + 1) // 2  # the smallest patches have few rays
        assert np.sort(read)[-brighter:] == pytest.approx(np.sort(wanted)[-brighter:], rel=spread)
        assert seen.by_walls is not None
        behind = seen.by_walls.rays
        ways = search.pose.to_local_points(behind.points), search.pose.to_local_directions(behind.directions)
        _, pieces = search.met(*ways)
        off = np.abs(seen.hits[seen.by_walls.rows]) / (0.5 * np.array(search.grid.size))
        assert (pieces < 0).sum() > 1000 and (off[pieces >= 0] < 1.0).all() and (off.max(axis=1) > 1.0).any()
    black = small_spec(scene=[DARK, BAR, BEHIND | {"surface": "black", "reflectance": None}], limits=[FAR_SIDE])
    (picture,) = body_pictures(black)
    assert picture.eye_mm == (0.0, 0.0, 0.0)


def test_patches_in_the_shadow_of_a_body_count_where_walls_light_them() -> None:
    near_side = FAR_SIDE | {"facing": [0.0, 0.0, -1.0]}
    hiding = DARK | {"centre_mm": [4.0, -6.0, 45.0]}
    counted = []
    for wall in (BEHIND, BEHIND | {"surface": "black", "reflectance": None}):
        spec = small_spec(scene=[hiding, BAR, wall], limits=[near_side])
        (picture,) = body_pictures(spec)
        (limit,) = spec.limits
        assert isinstance(limit, BodyLimit) and picture.eye_mm == (0.0, 0.0, 0.0)
        counted.append(picture.searched(0.6, 6.0).readings(limit).shape[0])
    assert counted[0] > counted[1] + 5
