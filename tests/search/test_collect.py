"""What a search collects from its rays, against plain NumPy and torch, and its gradients against differences."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from scenes import DEVICES

from lensforge.scene.pixel_grid import PixelGrid, Window, splat_flux
from lensforge.scene.receiver import Landings
from lensforge.search.collected_light import Collected, collected, collected_on_device

GRID = PixelGrid(300.0, 200.0, 32, 24)
WINDOWS = {"rectangle": Window(240.0, 130.0), "circle": Window(radius=110.0), "everywhere": Window()}


@dataclass(frozen=True)
class Rays:
    """Landings with exit sines on both sides of total reflection, and the flux with which they left the source."""

    landings: Landings
    sin2_exit: torch.Tensor
    emitted: torch.Tensor
    window: Window = WINDOWS["rectangle"]

    @staticmethod
    def at_random(count: int, seed: int = 0) -> "Rays":
        """On the receiver and outside it, some of them not landed."""
        rng = np.random.default_rng(seed)
        emitted = rng.random(count)
        landed = rng.random(count) < 0.6
        hits = rng.uniform(-280.0, 280.0, (count, 2)) * landed[:, None]
        flux = emitted * rng.uniform(0.8, 0.95, count) * landed
        sin2_exit = rng.uniform(0.0, 1.3, count)
        hits, flux, sin2_exit = (torch.from_numpy(array).requires_grad_() for array in (hits, flux, sin2_exit))
        lands = torch.from_numpy(landed)
        return Rays(Landings(hits, flux, lands, ~lands), sin2_exit, torch.from_numpy(emitted))

    @property
    def inputs(self) -> tuple[torch.Tensor, ...]:
        return self.landings.hits, self.landings.flux, self.sin2_exit

    def collected(self) -> Collected:
        return collected(self.landings, self.sin2_exit, self.emitted, GRID, self.window)


def _plainly(rays: Rays) -> tuple[torch.Tensor, ...]:
    """In window, flux outside of the receiver and near total reflection, as their definitions read."""
    hits, flux, sin2_exit = rays.inputs
    half = 0.5 * torch.tensor([GRID.width, GRID.height], dtype=torch.float64)
    inside = (hits[:, 0].abs() <= 0.5 * rays.window.width) & (hits[:, 1].abs() <= 0.5 * rays.window.height)
    inside &= hits.norm(dim=1) <= rays.window.radius
    landed = rays.landings.landed
    outside = (((hits.abs() - half).clamp(min=0.0) / half) ** 2).sum(dim=1)
    over = ((sin2_exit - 0.97) / 0.1).clamp(min=0.0)
    return (
        (flux * inside * landed).sum(),
        (rays.emitted * landed * outside / (1.0 + outside)).sum() + rays.emitted[~landed].sum(),
        (rays.emitted * over / (1.0 + over)).sum(),
    )


def _sums(light: Collected) -> tuple[torch.Tensor, ...]:
    return light.in_window, light.outside_receiver, light.total_reflection


@pytest.mark.parametrize("window", WINDOWS.values(), ids=list(WINDOWS))
def test_sums_are_those_of_the_definitions(window: Window) -> None:
    rays = replace(Rays.at_random(3000), window=window)
    light = rays.collected()
    for total, wanted in zip(_sums(light), _plainly(rays), strict=True):
        assert total.item() == pytest.approx(wanted.item(), rel=1e-12)
    image = splat_flux(rays.landings.hits.detach().numpy(), rays.landings.flux.detach().numpy(), GRID)
    assert np.allclose(light.image.detach().numpy(), image, rtol=1e-12, atol=1e-15)


def test_gradients_of_the_sums_are_those_of_the_definitions() -> None:
    rays = Rays.at_random(3000)
    mixed = (sum(c * s for c, s in zip((1.0, 2.0, -3.0), sums, strict=True)) for sums in (
        _sums(rays.collected()), _plainly(rays),
    ))  # fmt: skip
    gradients, wanted = (torch.autograd.grad(value, rays.inputs) for value in mixed)
    for gradient, expected in zip(gradients, wanted, strict=True):
        assert torch.allclose(gradient, expected, rtol=1e-11, atol=1e-15)


def test_gradients_of_the_image_are_its_differences() -> None:
    rays = Rays.at_random(60, seed=3)
    landings = rays.landings
    mixer = torch.from_numpy(np.random.default_rng(1).normal(size=GRID.shape))

    def value(hits: torch.Tensor, flux: torch.Tensor) -> torch.Tensor:
        return (replace(rays, landings=replace(landings, hits=hits, flux=flux)).collected().image * mixer).sum()

    assert torch.autograd.gradcheck(value, (landings.hits, landings.flux))


def test_lost_rays_are_drawn_back_and_none_outvotes_the_rest() -> None:
    hits = torch.tensor([[0.0, 0.0], [300.0, 0.0], [0.0, -1e9]], dtype=torch.float64, requires_grad=True)
    sines = torch.tensor([0.5, 1.07, 1e3], dtype=torch.float64, requires_grad=True)
    ones = torch.ones(3, dtype=torch.float64)
    every = torch.ones(3, dtype=torch.bool)
    light = Rays(Landings(hits, ones, every, ~every), sines, ones).collected()
    assert light.outside_receiver.item() == pytest.approx(0.0 + 0.5 + 1.0)
    pull = torch.autograd.grad(light.outside_receiver, hits, retain_graph=True)[0]
    assert pull[0].abs().max() == 0 and pull[1, 0] > 0 and pull[2, 1] < 0
    assert torch.autograd.grad(light.total_reflection, sines)[0].gt(0).tolist() == [False, True, True]
    assert light.total_reflection.item() < 2.0


@pytest.mark.parametrize("device", DEVICES)
def test_any_device_collects_the_same(device: str) -> None:
    """Rays at random, on the edges of pixels, window and receiver, and far beyond."""
    rays = Rays.at_random(3000)
    edges = torch.tensor([-1e15, -155.0, -150.0, -145.3125, -120.0, 0.0, 9.375, 120.0, 150.0, 154.6875, 1e9])
    corners = torch.cartesian_prod(edges, edges).double()
    with torch.no_grad():
        rays.landings.hits[: len(corners)] = corners
    landings = rays.landings
    there = Landings(
        *(tensor.to(device) for tensor in (landings.hits, landings.flux, landings.landed, landings.missed_receiver))
    )
    wanted = rays.collected()
    sums = collected_on_device(there, rays.sin2_exit.to(device), rays.emitted.to(device), GRID, rays.window)
    assert sums.image.device.type == device
    assert torch.allclose(sums.image.cpu(), wanted.image, rtol=1e-12, atol=1e-14)
    for one, other in zip(_sums(sums), _sums(wanted), strict=True):
        assert one.item() == pytest.approx(other.item(), rel=1e-12)
    mixer = torch.from_numpy(np.random.default_rng(1).normal(size=GRID.shape))
    one, other = (
        torch.autograd.grad((light.image.cpu() * mixer).sum() + sum(s.cpu() for s in _sums(light)), rays.inputs)
        for light in (sums, wanted)
    )
    for by_found, by_wanted in zip(one, other, strict=True):
        assert torch.allclose(by_found, by_wanted, rtol=1e-10, atol=1e-14)
