"""Receivers of every kind and in any pose, against geometry written otherwise: places, landings, and gradients."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from landed import as_tensors
from scenes import DEVICES

from lensforge.kernels.fate import Fate
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import Cylinder, FarField, Plane, SphericalReceiver

GRID = PixelGrid(200.0, 120.0, 20, 12)
UNIT = PixelGrid(2.0, 2.0, 16, 16)
AWRY = (0.3, -0.5, 0.8)
RECEIVERS = {
    "plane on the axis": Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), GRID),
    "plane": Plane(Pose.facing(AWRY, (40.0, -70.0, 90.0), 33.0), GRID),
    "wall": Plane(Pose.facing((1.0, 0.0, 0.0), (150.0, 20.0, 30.0), 90.0), GRID),
    "far field": FarField(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), UNIT),
    "tilted far field": FarField(Pose.facing(AWRY, (0.0, 0.0, 0.0), -20.0), UNIT),
    "cylinder": Cylinder(Pose.facing(AWRY, (5.0, 7.0, -9.0), 15.0), GRID, radius_mm=130.0),
    "sphere": SphericalReceiver(Pose.facing(AWRY, (5.0, 7.0, -9.0), 15.0), GRID, radius_mm=130.0),
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
    return ExitRays(*arrays)


def on_surface(receiver: PosedReceiver, points: np.ndarray) -> np.ndarray:
    """Distances (mm) of points from the surface of a receiver, by its equation in space."""
    away = points - receiver.pose.origin_mm
    _, y, z = receiver.pose.axes
    if receiver.is_flat:
        return np.abs(away @ z)
    axial = np.outer(away @ y, y) if isinstance(receiver, Cylinder) else 0.0
    return np.abs(np.linalg.norm(away - axial, axis=1) - receiver.radius_mm)


@each_receiver
def test_rays_land_where_their_lines_meet_it(receiver: PosedReceiver) -> None:
    rays = exits()
    landings = receiver.land(rays)
    landed = landings.landed
    assert landed.sum() > 400 and not landings.hits[~landed].any()
    assert np.array_equal(landings.missed_receiver, rays.left_lens & ~landed)
    assert np.array_equal(landings.flux, np.where(landed, rays.flux, 0.0))
    places = receiver.places(*landings.hits[landed].T)
    points = rays.points[landed]
    directions = rays.directions[landed]
    if receiver.is_far:
        assert np.allclose(places, directions, atol=1e-9)
        return
    steep = np.linalg.norm(places, axis=1) < 1e4
    across = np.cross(places - points, directions)[steep]
    assert np.abs(across).max() < 1e-9 and on_surface(receiver, places[steep]).max() < 1e-9
    assert (np.sum((places - points) * directions, axis=1) > 0.0).all(), "ahead, not behind"


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
    assert receiver.pixel_measure == pytest.approx(width * height * (1.0 if receiver.is_far else 1e-6))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@each_receiver
def test_the_twin_in_torch_lands_them_alike(receiver: PosedReceiver, device: str, dtype: torch.dtype) -> None:
    rays = exits()
    wanted = receiver.land(rays)
    rows = ~rays.left_lens | (rays.directions @ receiver.pose.axes[2] > 1e-2)
    tensors = as_tensors(rays)
    there = [
        tensor.to(device, dtype) for tensor in (tensors.points, tensors.directions, tensors.flux, tensors.sin2_exit)
    ]
    landings = receiver.land_by_arrays(ExitRays(*there, tensors.fates.to(device)))
    assert landings.hits.dtype == dtype and landings.hits.device.type == device
    assert np.array_equal(landings.landed.cpu()[rows], wanted.landed[rows])
    tolerance = 200.0 * torch.finfo(dtype).eps
    assert np.allclose(landings.hits.cpu().double()[rows], wanted.hits[rows], rtol=tolerance, atol=1e4 * tolerance)


@each_receiver
def test_its_sensitivities_to_exit_rays_are_those_of_the_twin(receiver: PosedReceiver) -> None:
    rays = exits()
    landed = receiver.land(rays).landed
    by_hits = np.random.default_rng(1).normal(size=(2000, 2)) * landed[:, None]
    by = receiver.sensitivities(rays, by_hits)
    tensors = as_tensors(rays)
    points, directions = (tensor.clone().requires_grad_() for tensor in (tensors.points, tensors.directions))
    moved = receiver.land_by_arrays(replace(tensors, points=points, directions=directions))
    loss = (moved.hits * torch.from_numpy(by_hits)).sum()
    gradients = torch.autograd.grad(loss, (points, directions), allow_unused=True)
    rows = landed & (rays.directions @ receiver.pose.axes[2] > 1e-3)
    for gradient, wanted in zip(by, gradients, strict=True):
        exact = np.zeros_like(gradient) if wanted is None else wanted.numpy()
        assert np.allclose(_across(gradient, rays)[rows], _across(exact, rays)[rows], rtol=1e-9, atol=1e-9)


def _across(vectors: np.ndarray, rays: ExitRays) -> np.ndarray:
    """The part across each ray: a direction stays a unit vector, and a point may slide along its line."""
    directions = rays.directions
    across: np.ndarray = vectors - np.sum(vectors * directions, axis=1)[:, None] * directions
    return across
