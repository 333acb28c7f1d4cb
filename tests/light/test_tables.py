"""The fused tracer against the readable one (exact sum, other code), closed forms, and finite differences."""

import numpy as np
import pytest
import torch
from chains import MixedLight
from exact_surface import ExactSurface
from landed import Landed, by_kernels, in_torch, trace_exact, trace_tables
from scenes import random_surface, sphere, table_of, weight_matrix

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

N = 1.4936
Z = 1000.0


def _fused(surfaces, rays: RayBundle, nodes: int, index: float = N, distance: float = Z) -> Landed:
    grid = TableGrid(nodes)
    return by_kernels([table_of(s, grid) for s in surfaces], Scene(Media(Medium(index)), grid), rays, distance)


@pytest.mark.parametrize("symmetry", ["none", "square"])
def test_table_and_exact_tracer_converge_to_each_other(symmetry: str) -> None:
    surfaces = random_surface(1, 0.8, 0.01, symmetry=symmetry), random_surface(2, 2.45, 0.008, symmetry=symmetry)
    rays = SquareEmitter(0.8).sample(128, 0)
    exact = in_torch(trace_exact(*map(ExactSurface.of, surfaces), Media(Medium(N)), rays), Z)
    errors = []
    for nodes in (61, 121):
        fused = _fused(surfaces, rays, nodes)
        assert torch.equal(fused.fates, exact.fates)
        errors.append((fused.hits - exact.hits).norm(dim=1).median().item())
        assert torch.allclose(fused.carried, exact.carried, rtol=1e-4, atol=0)
    assert errors[1] < 1e-5 * Z
    assert (fused.exits.points - exact.exits.points).norm(dim=1).median() < 1e-5
    assert (fused.exits.directions - exact.exits.directions).norm(dim=1).median() < 1e-5
    assert np.log2(errors[0] / errors[1]) > 2.5  # the normal converges with the third power of the step


def test_the_flux_of_lost_rays_is_a_constant() -> None:
    grid = TableGrid(64)
    tables = [table_of(random_surface(3, *shape), grid).requires_grad_() for shape in ((0.8, 0.1), (2.45, 0.1))]
    landed = by_kernels(tables, Scene(Media(Medium(N)), grid), SquareEmitter(0.9).sample(4096, 1), Z)
    lost = ~landed.landed
    assert landed.missed_receiver.any() and (landed.fates == Fate.TOTAL_REFLECTION).any()
    for gradient in torch.autograd.grad(landed.flux[lost].sum() + landed.hits[lost].sum(), tables):
        assert not gradient.any()


def test_sensitivities_to_a_point_and_to_a_direction_are_those_of_differences() -> None:
    """With respect to the exit point, and to the direction; where along the ray the point lies does not count."""
    grid = TableGrid(64)
    rays = SquareEmitter(0.9).sample(200, 1)
    tables = np.stack([tabulate(grid, s) for s in (random_surface(3, 0.8, 0.03), random_surface(4, 2.45, 0.02))])
    light = MixedLight(tables, Scene(Media(Medium(N)), grid), rays, 2)
    for face in (0, 1):
        direction = np.zeros_like(tables)
        direction[face] = np.random.default_rng(face).normal(size=tables[face].shape)
        slope = light.slope(direction, 1e-7)
        assert slope.crossed == 0 and slope.differences == pytest.approx(slope.adjoint, rel=1e-5)


def test_gradients_reach_weights_and_offsets_as_in_the_exact_tracer() -> None:
    surfaces = random_surface(6, 0.8, 0.01), random_surface(7, 2.45, 0.008)
    rays = SquareEmitter(0.6).sample(256, 2)
    exact = [ExactSurface.of(s, requires_grad=True) for s in surfaces]
    parameters = [p for e in exact for p in (e.weights_mm, e.offset_mm)]
    expected = torch.autograd.grad(in_torch(trace_exact(*exact, Media(Medium(N)), rays), Z).mixed(Z), parameters)
    grid = TableGrid(161)
    matrix = torch.from_numpy(weight_matrix(grid, surfaces[0].basis))
    tables = [(matrix @ e.weights_mm + e.offset_mm).reshape(grid.side, -1) for e in exact]
    gradients = torch.autograd.grad(by_kernels(tables, Scene(Media(Medium(N)), grid), rays, Z).mixed(Z), parameters)
    for a, b in zip(gradients, expected, strict=True):
        assert ((a - b).norm() / b.norm()).item() < 3e-3


def test_a_lens_of_air_is_not_there() -> None:
    rays = SquareEmitter(0.6).sample(1000, 4)
    landed = _fused((random_surface(1, 0.8), random_surface(2, 2.45)), rays, 48, index=1.0)
    arrived = landed.landed.numpy()
    straight = rays.origins + (Z / rays.directions[:, 2])[:, None] * rays.directions
    assert np.allclose(landed.hits.numpy()[arrived], straight[arrived, :2], rtol=1e-9, atol=1e-9)
    assert np.array_equal(landed.flux.numpy()[arrived], rays.flux[arrived])


def test_the_same_rays_give_the_same_bits_on_any_number_of_threads() -> None:
    surfaces = random_surface(1, 0.8), random_surface(2, 2.45)
    rays = SquareEmitter(0.8).sample(5000, 0)
    grid = TableGrid(48)
    results = []
    threads = torch.get_num_threads()
    for count in (1, 3):
        torch.set_num_threads(count)
        tables = [table_of(s, grid).requires_grad_() for s in surfaces]
        landed = by_kernels(tables, Scene(Media(Medium(N)), grid), rays, Z)
        results.append((landed.hits, *torch.autograd.grad(landed.mixed(Z), tables)))
    torch.set_num_threads(threads)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_a_surface_through_the_origin_is_refused_in_one_line() -> None:
    grid = TableGrid(48)
    bad = table_of(sphere(1.0), grid) - 1.5
    with pytest.raises(InputError, match=r"inner surface: its radius falls to -0\.5"):
        trace_tables((bad, table_of(sphere(2.0), grid)), Scene(Media(Medium(N)), grid), SquareEmitter(0.1).sample(8, 0))


def test_without_fresnel_rays_keep_their_flux_and_their_way() -> None:
    surfaces = random_surface(3, 0.8, 0.03), random_surface(4, 2.45, 0.02)
    grid = TableGrid(64)
    rays = SquareEmitter(0.9).sample(2048, 1)
    tables = [table_of(s, grid).requires_grad_() for s in surfaces]
    full, bare = (by_kernels(tables, Scene(Media(Medium(N)), grid, fresnel), rays, Z) for fresnel in (True, False))
    assert torch.equal(full.hits, bare.hits) and torch.equal(full.fates, bare.fates)
    assert torch.equal(bare.carried, torch.from_numpy(rays.flux))
    assert (full.flux[full.landed] < bare.flux[full.landed]).all()
    assert all(not gradient.any() for gradient in torch.autograd.grad(bare.flux.sum(), tables))
