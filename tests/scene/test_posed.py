"""Receivers of every kind and in any pose, against geometry written otherwise: places, landings, and gradients."""

import numpy as np
import pytest
import torch
from scenes import DEVICES

from lensforge.kernels.fate import Fate
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver import PosedReceiver, Receiver, ReceiverPose
from lensforge.scene.receiver_shapes import Cylinder, Dome, FarField, Plane, chart_radius

GRID = PixelGrid(200.0, 120.0, 20, 12)
UNIT = PixelGrid(2.0, 2.0, 16, 16)
AWRY = (0.3, -0.5, 0.8)
RECEIVERS = {
    "plane on the axis": Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), GRID),
    "plane": Plane(ReceiverPose.facing(AWRY, (40.0, -70.0, 90.0), 33.0), GRID),
    "wall": Plane(ReceiverPose.facing((1.0, 0.0, 0.0), (150.0, 20.0, 30.0), 90.0), GRID),
    "far field": FarField(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), UNIT),
    "tilted far field": FarField(ReceiverPose.facing(AWRY, (0.0, 0.0, 0.0), -20.0), UNIT),
    "cylinder": Cylinder(ReceiverPose.facing(AWRY, (5.0, 7.0, -9.0), 15.0), GRID, radius_mm=130.0),
    "sphere": Dome(ReceiverPose.facing(AWRY, (5.0, 7.0, -9.0), 15.0), GRID, radius_mm=130.0),
}
each_receiver = pytest.mark.parametrize("receiver", RECEIVERS.values(), ids=list(RECEIVERS))


def exits(count: int = 2000) -> ExitRays:
    """Rays from points of a lens in every direction, some of which did not leave it."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fates = rng.choice([Fate.LEFT_LENS, Fate.LEFT_LENS, Fate.BASE, Fate.TOTAL_REFLECTION], count)
    left = fates == Fate.LEFT_LENS
    points = rng.uniform(-3.0, 3.0, (count, 3)) * left[:, None]
    arrays = points, directions * left[:, None], rng.random(count), rng.random(count), fates.astype(np.int8)
    return ExitRays(*(torch.from_numpy(array) for array in arrays))


def on_surface(receiver: PosedReceiver, points: np.ndarray) -> np.ndarray:
    """Distances (mm) of points from the surface of a receiver, by its equation in space."""
    away = points - receiver.pose.centre_mm
    _, y, z = receiver.pose.axes
    if receiver.kind == "plane":
        return np.abs(away @ z)
    axial = np.outer(away @ y, y) if receiver.kind == "cylinder" else 0.0
    return np.abs(np.linalg.norm(away - axial, axis=1) - receiver.radius_mm)


@each_receiver
def test_its_axes_are_a_right_handed_frame(receiver: PosedReceiver) -> None:
    axes = receiver.pose.axes
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-14) and np.linalg.det(axes) == pytest.approx(1.0)
    assert isinstance(receiver, Receiver)


@each_receiver
def test_rays_land_where_their_lines_meet_it(receiver: PosedReceiver) -> None:
    rays = exits()
    landings = receiver.land(rays)
    landed = landings.landed.numpy()
    assert landed.sum() > 400 and not landings.hits.numpy()[~landed].any()
    assert np.array_equal(landings.missed_receiver.numpy(), rays.left_lens.numpy() & ~landed)
    assert np.array_equal(landings.flux.numpy(), np.where(landed, rays.flux.numpy(), 0.0))
    found = receiver.places(*landings.hits.numpy()[landed].T)
    points, directions = rays.points.numpy()[landed], rays.directions.numpy()[landed]
    if receiver.kind == "far_field":
        assert np.allclose(found, directions, atol=1e-9)
        return
    steep = np.linalg.norm(found, axis=1) < 1e4
    across = np.cross(found - points, directions)[steep]
    assert np.abs(across).max() < 1e-9 and on_surface(receiver, found[steep]).max() < 1e-9
    assert (np.sum((found - points) * directions, axis=1) > 0.0).all(), "ahead, not behind"


def test_curved_screens_around_the_lens_miss_no_ray() -> None:
    for name in ("cylinder", "sphere"):
        assert not RECEIVERS[name].land(exits()).missed_receiver.any()


@each_receiver
def test_its_chart_keeps_areas(receiver: PosedReceiver) -> None:
    """The area spanned by small steps along the chart's axes, at places all over it."""
    step = 1e-4
    x, y = (np.random.default_rng(1).uniform(-0.5, 0.5, (2, 500)).T * receiver.grid.size).T
    along_x, along_y = (
        receiver.places(x + dx, y + dy) - receiver.places(x - dx, y - dy) for dx, dy in ((step, 0.0), (0.0, step))
    )
    areas = np.linalg.norm(np.cross(along_x, along_y), axis=1)
    assert np.allclose(areas / (2.0 * step) ** 2, 1.0, atol=1e-6)
    width, height = receiver.grid.pixel
    assert receiver.pixel_measure == pytest.approx(width * height * (1.0 if receiver.kind == "far_field" else 1e-6))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@each_receiver
def test_the_twin_in_torch_lands_them_alike(receiver: PosedReceiver, device: str, dtype: torch.dtype) -> None:
    rays = exits()
    wanted = receiver.land(rays)
    there = [tensor.to(device, dtype) for tensor in (rays.points, rays.directions, rays.flux, rays.sin2_exit)]
    found = receiver.land_in_torch(ExitRays(*there, rays.fates.to(device)))
    assert found.hits.dtype == dtype and found.hits.device.type == device
    steep = (rays.directions.numpy() @ receiver.pose.axes[2] > 1e-2) | ~rays.left_lens.numpy()
    rows = torch.from_numpy(steep)
    assert torch.equal(found.landed.cpu()[rows], wanted.landed[rows])
    tolerance = 200.0 * torch.finfo(dtype).eps
    assert torch.allclose(found.hits.cpu().double()[rows], wanted.hits[rows], rtol=tolerance, atol=1e4 * tolerance)


@each_receiver
def test_its_sensitivities_to_exit_rays_are_those_of_the_twin(receiver: PosedReceiver) -> None:
    rays = exits()
    landed = receiver.land(rays).landed.numpy()
    by_hits = np.random.default_rng(1).normal(size=(2000, 2)) * landed[:, None]
    by = receiver.sensitivities(rays, by_hits)
    points, directions = (tensor.clone().requires_grad_() for tensor in (rays.points, rays.directions))
    moved = receiver.land_in_torch(ExitRays(points, directions, rays.flux, rays.sin2_exit, rays.fates))
    loss = (moved.hits * torch.from_numpy(by_hits)).sum()
    gradients = torch.autograd.grad(loss, (points, directions), allow_unused=True)
    rows = landed & (rays.directions.numpy() @ receiver.pose.axes[2] > 1e-3)
    for found, wanted in zip(by, gradients, strict=True):
        exact = np.zeros_like(found) if wanted is None else wanted.numpy()
        assert np.allclose(_across(found, rays)[rows], _across(exact, rays)[rows], rtol=1e-9, atol=1e-9)


def _across(vectors: np.ndarray, rays: ExitRays) -> np.ndarray:
    """The part across each ray: a direction stays a unit vector, and a point may slide along its line."""
    directions = rays.directions.numpy()
    across: np.ndarray = vectors - np.sum(vectors * directions, axis=1)[:, None] * directions
    return across


def test_the_far_field_is_that_of_equal_solid_angles() -> None:
    """Light of cos gamma, by hand: the flux within gamma is sin^2 gamma."""
    rng = np.random.default_rng(3)
    sine, azimuth = np.sqrt(rng.random(100_000)), rng.uniform(0.0, 2.0 * np.pi, 100_000)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.sqrt(1.0 - sine**2)], axis=1)
    none, fates = np.zeros(100_000), np.full(100_000, Fate.LEFT_LENS, dtype=np.int8)
    rays = ExitRays(*(torch.from_numpy(array) for array in (0.0 * directions, directions, 1.0 + none, none, fates)))
    hits = RECEIVERS["far field"].land(rays).hits.numpy()
    for gamma in (20.0, 45.0, 80.0):
        inside = Window(radius=chart_radius(gamma)).contains(hits).mean()
        assert inside == pytest.approx(np.sin(np.radians(gamma)) ** 2, abs=4e-3)


def test_directions_are_stated_as_angles_along_x_and_y() -> None:
    x, y = RECEIVERS["far field"].target_coordinates(
        np.array([0.0, chart_radius(30.0), 0.0]), np.array([0.0, 0.0, -1.0])
    )
    assert np.allclose(x, [0.0, 30.0, 0.0]) and np.allclose(y, [0.0, 0.0, -60.0])


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), AWRY])
def test_a_pose_faces_its_direction_and_turns_about_it(direction: tuple[float, float, float]) -> None:
    unit = np.array(direction) / np.linalg.norm(direction)
    upright, turned = (ReceiverPose.facing(direction, (0.0, 0.0, 0.0), angle).axes for angle in (0.0, 90.0))
    assert np.allclose(upright[2], unit, atol=1e-15) and np.allclose(turned[2], unit, atol=1e-15)
    assert np.allclose(turned[0], upright[1], atol=1e-15) and np.allclose(turned[1], -upright[0], atol=1e-15)
    assert np.array_equal(ReceiverPose.facing((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)).axes, np.eye(3))
