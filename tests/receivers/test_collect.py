"""What a search collects from its rays, against plain NumPy and torch, and its gradients against differences."""

import numpy as np
import pytest
import torch
from scenes import DEVICES

from lensforge.receivers.collect import Collected, collected
from lensforge.receivers.collect_on_device import collected_on_device
from lensforge.receivers.plane import Receiver
from lensforge.receivers.splat import splat_flux
from lensforge.sources.bundle import RayBundle
from lensforge.tracing.arrivals import Arrivals
from lensforge.tracing.fates import Fate

RECEIVER, WINDOW_MM = Receiver(300.0, 32), 240.0


def _arrivals(count: int, seed: int = 0) -> tuple[Arrivals, RayBundle]:
    """Rays of every fate, on the receiver and beside it, with exit sines on both sides of total reflection."""
    rng = np.random.default_rng(seed)
    weights = rng.random(count)
    fates = rng.choice([Fate.ARRIVED, Fate.ARRIVED, Fate.ARRIVED, Fate.BASE, Fate.TOTAL_REFLECTION], count)
    hits = rng.uniform(-280.0, 280.0, (count, 2)) * (fates == Fate.ARRIVED)[:, None]
    carried, sines = weights * rng.uniform(0.8, 0.95, count), rng.uniform(0.0, 1.3, count)
    tensors = (torch.from_numpy(array).requires_grad_() for array in (hits, carried, sines))
    nowhere = np.zeros((count, 3))
    return Arrivals(*tensors, torch.from_numpy(fates.astype(np.int8))), RayBundle(nowhere, nowhere, weights)


def _plainly(arrivals: Arrivals, rays: RayBundle) -> tuple[torch.Tensor, ...]:
    """In window, stray and reflected flux, as their definitions read."""
    weights, half = torch.from_numpy(rays.weights), 0.5 * RECEIVER.side_mm
    inside = arrivals.hits.abs().amax(dim=1) <= 0.5 * WINDOW_MM
    beside = (((arrivals.hits.abs() - half).clamp(min=0.0) / half) ** 2).sum(dim=1)
    over = ((arrivals.sines - 0.97) / 0.1).clamp(min=0.0)
    return (
        (arrivals.flux * inside).sum(),
        (weights * arrivals.arrived * beside / (1.0 + beside)).sum(),
        (weights * over / (1.0 + over)).sum(),
    )


def _sums(light: Collected) -> tuple[torch.Tensor, ...]:
    return light.in_window, light.stray, light.reflected


def test_sums_are_those_of_the_definitions() -> None:
    arrivals, rays = _arrivals(3000)
    light = collected(arrivals, rays, RECEIVER, WINDOW_MM)
    for found, wanted in zip(_sums(light), _plainly(arrivals, rays), strict=True):
        assert found.item() == pytest.approx(wanted.item(), rel=1e-12)
    image = splat_flux(arrivals.hits.detach().numpy(), arrivals.flux.detach().numpy(), RECEIVER)
    assert np.allclose(light.image.detach().numpy(), image, rtol=1e-12, atol=1e-15)


def test_gradients_of_the_sums_are_those_of_the_definitions() -> None:
    arrivals, rays = _arrivals(3000)
    inputs = (arrivals.hits, arrivals.carried, arrivals.sines)
    mixed = (sum(c * s for c, s in zip((1.0, 2.0, -3.0), sums, strict=True)) for sums in (
        _sums(collected(arrivals, rays, RECEIVER, WINDOW_MM)), _plainly(arrivals, rays),
    ))  # fmt: skip
    found, wanted = (torch.autograd.grad(value, inputs) for value in mixed)
    for one, other in zip(found, wanted, strict=True):
        assert torch.allclose(one, other, rtol=1e-11, atol=1e-15)


def test_gradients_of_the_image_are_its_differences() -> None:
    arrivals, rays = _arrivals(60, seed=3)
    mixer = torch.from_numpy(np.random.default_rng(1).normal(size=(32, 32)))

    def value(hits: torch.Tensor, carried: torch.Tensor) -> torch.Tensor:
        moved = Arrivals(hits, carried, arrivals.sines, arrivals.fates)
        return (collected(moved, rays, RECEIVER, WINDOW_MM).image * mixer).sum()

    lit = arrivals.arrived[:, None].double()  # a ray that did not arrive has no hit to move
    assert torch.autograd.gradcheck(lambda h, c: value(h * lit, c), (arrivals.hits, arrivals.carried))


def test_lost_rays_are_drawn_back_and_none_outvotes_the_rest() -> None:
    hits = torch.tensor([[0.0, 0.0], [300.0, 0.0], [0.0, -1e9]], dtype=torch.float64, requires_grad=True)
    sines = torch.tensor([0.5, 1.07, 1e3], dtype=torch.float64, requires_grad=True)
    ones, nowhere = torch.ones(3, dtype=torch.float64), np.zeros((3, 3))
    arrivals = Arrivals(hits, ones, sines, torch.zeros(3, dtype=torch.int8))
    light = collected(arrivals, RayBundle(nowhere, nowhere, ones.numpy()), RECEIVER, WINDOW_MM)
    assert light.stray.item() == pytest.approx(0.0 + 0.5 + 1.0)
    pull = torch.autograd.grad(light.stray, hits, retain_graph=True)[0]
    assert pull[0].abs().max() == 0 and pull[1, 0] > 0 and pull[2, 1] < 0
    assert torch.autograd.grad(light.reflected, sines)[0].gt(0).tolist() == [False, True, True]
    assert light.reflected.item() < 2.0


@pytest.mark.parametrize("device", DEVICES)
def test_any_device_collects_the_same(device: str) -> None:
    """Rays at random, on the edges of pixels, window and receiver, and far beyond."""
    arrivals, rays = _arrivals(3000)
    edges = torch.tensor([-1e15, -155.0, -150.0, -145.3125, -120.0, 0.0, 9.375, 120.0, 150.0, 154.6875, 1e9])
    corners = torch.cartesian_prod(edges, edges).double()
    with torch.no_grad():
        arrivals.hits[: len(corners)] = corners
    inputs = (arrivals.hits, arrivals.carried, arrivals.sines)
    there = Arrivals(*(each.to(device) for each in (*inputs, arrivals.fates)))
    wanted = collected(arrivals, rays, RECEIVER, WINDOW_MM)
    found = collected_on_device(there, torch.from_numpy(rays.weights).to(device), RECEIVER, WINDOW_MM)
    assert found.image.device.type == device
    assert torch.allclose(found.image.cpu(), wanted.image, rtol=1e-12, atol=1e-14)
    for one, other in zip(_sums(found), _sums(wanted), strict=True):
        assert one.item() == pytest.approx(other.item(), rel=1e-12)
    mixer = torch.from_numpy(np.random.default_rng(1).normal(size=(32, 32)))
    one, other = (
        torch.autograd.grad((light.image.cpu() * mixer).sum() + sum(s.cpu() for s in _sums(light)), inputs)
        for light in (found, wanted)
    )
    for by_found, by_wanted in zip(one, other, strict=True):
        assert torch.allclose(by_found, by_wanted, rtol=1e-10, atol=1e-14)
