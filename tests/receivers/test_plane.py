"""Exit rays on the plane, against closed forms; the compiled kernel against its twin in torch."""

import numpy as np
import pytest
import torch
from scenes import DEVICES

from lensforge.kernels.fates import Fate
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.receiver import Hits, Receiver
from lensforge.spec import CrossTarget
from lensforge.tracing.exit_rays import ExitRays

RECEIVER = PlaneReceiver(100.0, PixelGrid(300.0, 32))


def _exits(count: int = 2000) -> ExitRays:
    """Exit rays in every direction, some of which did not leave the lens."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:4, 2] = [0.0, 1e-12, 1e-11, -1e-3]
    fates = rng.choice([Fate.LEFT_LENS, Fate.LEFT_LENS, Fate.LEFT_LENS, Fate.BASE, Fate.TOTAL_REFLECTION], count)
    fates[:4] = Fate.LEFT_LENS
    left = fates == Fate.LEFT_LENS
    points = rng.uniform(-3.0, 3.0, (count, 3)) * left[:, None]
    arrays = points, directions * left[:, None], rng.random(count), rng.random(count), fates.astype(np.int8)
    return ExitRays(*(torch.from_numpy(array) for array in arrays))


def test_rays_land_where_their_lines_meet_the_plane() -> None:
    exits = _exits()
    landings = RECEIVER.land(exits)
    landed, rise = landings.landed, exits.directions[:, 2]
    assert 500 < landed.sum() < 1000
    assert torch.equal(landed, exits.left_lens & (rise > 1e-12))
    assert torch.equal(landings.missed_receiver, exits.left_lens & ~landed)
    assert landings.missed_receiver[:4].tolist() == [True, True, False, True]
    across = torch.cat([landings.hits, torch.full_like(landings.hits[:, :1], 100.0)], dim=1) - exits.points
    off_line = torch.linalg.cross(across, exits.directions)[landed & (rise > 1e-3)]
    assert off_line.abs().max() < 1e-9
    assert torch.equal(landings.flux, exits.flux * landed)
    assert not landings.hits[~landed].any()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_twin_lands_them_alike(device: str, dtype: torch.dtype) -> None:
    exits = _exits()
    wanted = RECEIVER.land(exits)
    there = [each.to(device, dtype) for each in (exits.points, exits.directions, exits.flux, exits.sin2_exit)]
    found = RECEIVER.land_in_torch(ExitRays(*there, exits.fates.to(device)))
    assert found.hits.dtype == dtype and found.hits.device.type == device
    steep = (exits.directions[:, 2].abs() > 1e-2) | ~exits.left_lens
    assert torch.equal(found.landed.cpu()[steep], wanted.landed[steep])
    assert torch.equal(found.missed_receiver.cpu()[steep], wanted.missed_receiver[steep])
    tolerance = 100.0 * torch.finfo(dtype).eps
    assert torch.allclose(found.hits.cpu().double()[steep], wanted.hits[steep], rtol=tolerance, atol=1e4 * tolerance)
    assert torch.allclose(found.flux.cpu().double(), wanted.flux, rtol=tolerance)


def test_its_sensitivities_to_exit_rays_are_those_of_the_twin() -> None:
    """Crossings of the plane are the hits: with the direction kept, and none with respect to the direction."""
    exits = _exits()
    by_hits = np.random.default_rng(1).normal(size=(2000, 2)) * RECEIVER.land(exits).landed.numpy()[:, None]
    by = RECEIVER.sensitivities(by_hits)
    points = exits.points.clone().requires_grad_()
    moved = RECEIVER.land_in_torch(ExitRays(points, exits.directions, exits.flux, exits.sin2_exit, exits.fates))
    gradient = torch.autograd.grad((moved.hits * torch.from_numpy(by_hits)).sum(), points)[0]
    assert np.allclose(gradient[:, :2], by.by_crossings, rtol=1e-12)
    assert by.level_mm == 100.0 and by.by_directions.shape == (0, 3)


def test_it_is_a_receiver_that_knows_the_area_of_its_pixels() -> None:
    target = CrossTarget(kind="cross", length_mm=150.0, stroke_mm=37.5, distance_mm=120.0, receiver_mm=320.0)
    receiver = PlaneReceiver.of(target, 64)
    assert isinstance(receiver, Receiver)
    assert receiver == PlaneReceiver(120.0, PixelGrid(320.0, 64))
    assert receiver.pixel_measure == pytest.approx(25e-6)


def test_hits_are_the_landings_of_some_of_the_rays() -> None:
    landings = RECEIVER.land(_exits())
    hits, rows = Hits.of(landings), np.array([5, 3, 1999])
    assert np.array_equal(hits.arrived, landings.landed.numpy())
    assert np.array_equal(hits.take(rows).hits, landings.hits.numpy()[rows])
    assert np.array_equal(hits.take(slice(3)).flux, landings.flux.numpy()[:3])
