"""Absorption in the body, by Beer and Lambert: closed forms, finite differences, and every tracer and referee alike."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from known_refraction import normal_transmittance
from landed import by_kernels, in_torch
from scenes import DEVICES, hemisphere_directions, random_surface, small_spec, sphere, table_of

from lensforge.kernels.fate import Fate
from lensforge.light.device_trace import tables_on
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.exact_trace import DenseScan, exact_surfaces, trace_exact
from lensforge.light.sequential_trace import TensorRays, trace_sequence
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, TracedBundle, trace_tables
from lensforge.optics.media import Media
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lens import Lens
from lensforge.search.light_path import TableSurface
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

N, Z, GRID = 1.4936, 1000.0, TableGrid(64)
SURFACES = random_surface(3, 0.8, 0.03), random_surface(8, 2.45, 0.05)
TABLES = [table_of(each, GRID) for each in SURFACES]
RAYS = SquareEmitter(0.9).sample(512, 1)
DIM, CLEAR = Scene(Media(N, 0.21), GRID), Scene(Media(N), GRID)


def coloured(rays: RayBundle) -> RayBundle:
    """Rays of which each has an absorption of its own."""
    return replace(rays, absorption_per_mm=np.random.default_rng(3).uniform(0.0, 0.5, len(rays)))


def _on_cpu(found: ExitRays) -> ExitRays:
    """The same rays on the CPU; what the scene has not is None, and stays so."""
    tensors = (getattr(found, each.name) for each in fields(found))
    return ExitRays(*(None if each is None else each.cpu() for each in tensors))


def paths(rays: RayBundle) -> torch.Tensor:
    """Length (mm) of each ray in the body, by its ends."""
    traced = TracedBundle.of(*TABLES, CLEAR, rays)
    inner = rays.origins + traced.lengths[:, :1] * rays.directions
    return torch.from_numpy(np.linalg.norm(traced.exits.points.numpy() - inner, axis=1))


def test_light_from_the_centre_of_two_spheres_loses_what_the_law_says() -> None:
    directions = hemisphere_directions(500)
    rays = RayBundle(np.zeros((500, 3)), directions, np.full(500, 0.002))
    exits = trace_tables(table_of(sphere(2.0), GRID), table_of(sphere(5.0), GRID), Scene(Media(N, 0.1), GRID), rays)
    once, left = normal_transmittance(N), np.exp(-0.3)
    np.testing.assert_allclose(exits.flux.numpy(), 0.002 * once**2 * left, rtol=1e-9)
    assert exits.absorbed is not None
    np.testing.assert_allclose(exits.absorbed.numpy(), 0.002 * once * (1.0 - left), rtol=1e-9)


@pytest.mark.parametrize("rays", [RAYS, coloured(RAYS)], ids=["one for all", "of each ray"])
def test_each_ray_loses_by_its_own_path_and_nothing_else_changes(rays: RayBundle) -> None:
    clear, dim = trace_tables(*TABLES, CLEAR, RAYS), trace_tables(*TABLES, DIM, rays)
    out, length = clear.left_lens, paths(RAYS)
    assert torch.equal(dim.fates, clear.fates) and torch.equal(dim.points, clear.points)
    assert out.sum() > 400
    left = torch.exp(-torch.from_numpy(rays.absorptions(DIM.media)) * length)
    assert torch.allclose(dim.flux[out], (clear.flux * left)[out], rtol=1e-13, atol=0.0)
    # what reached the outer surface was absorbed, or is still there, whatever became of it
    assert clear.absorbed is None and dim.absorbed is not None
    lost = clear.fates == Fate.TOTAL_REFLECTION
    assert lost.sum() > 5
    assert torch.allclose((dim.absorbed + dim.flux)[lost], clear.flux[lost], rtol=1e-13, atol=0.0)
    assert not dim.absorbed[clear.fates == Fate.BASE].any()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("rays", [RAYS, coloured(RAYS)], ids=["one for all", "of each ray"])
def test_the_tracer_in_torch_and_its_gradients_are_those_of_the_kernels(rays: RayBundle, device: str) -> None:
    tables = [each.clone().requires_grad_() for each in TABLES]
    inner, outer = (TableSurface(each) for each in tables_on(torch.device(device), *tables, DIM))
    every = TensorRays.of(rays, DIM.media, torch.float64, torch.device(device))
    found, kernels = trace_sequence(inner, outer, every), by_kernels(tables, DIM, rays, Z)
    assert found.absorbed is not None and kernels.exits.absorbed is not None
    assert torch.allclose(found.flux.cpu(), kernels.carried, rtol=1e-10, atol=0.0)
    assert torch.allclose(found.absorbed.cpu(), kernels.exits.absorbed, rtol=1e-9, atol=1e-15)
    by_flux = torch.from_numpy(np.random.default_rng(1).normal(size=len(rays)))
    wanted, own = (
        torch.autograd.grad((by_flux * each).sum(), tables) for each in (kernels.flux, in_torch(_on_cpu(found), Z).flux)
    )
    for one, other in zip(own, wanted, strict=True):
        assert torch.linalg.norm(one - other) < 1e-9 * torch.linalg.norm(other)


@pytest.mark.parametrize("fresnel", [True, False])
def test_gradients_of_the_flux_are_those_of_finite_differences(fresnel: bool) -> None:
    scene, by_flux = replace(DIM, fresnel=fresnel), np.random.default_rng(2).normal(size=len(RAYS))
    tables = [each.clone().requires_grad_() for each in TABLES]

    def value(*moved: torch.Tensor) -> torch.Tensor:
        return (torch.from_numpy(by_flux) * by_kernels(list(moved), scene, RAYS, Z).flux).sum()

    gradients = torch.autograd.grad(value(*tables), tables)
    for which, gradient in enumerate(gradients):
        direction = torch.from_numpy(np.random.default_rng(5).normal(size=gradient.shape)) * (gradient != 0)
        ahead, behind = (
            value(*(each + s * 1e-7 * direction * (k == which) for k, each in enumerate(TABLES))) for s in (1, -1)
        )
        assert (ahead - behind).item() / 2e-7 == pytest.approx((gradient * direction).sum().item(), rel=1e-6)


def test_the_exact_tracer_dims_as_the_tables_do() -> None:
    spec = small_spec(lens__absorption_per_mm=0.05)
    lens = Lens(*(random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2)), spec, 0, "draft")
    rays = SquareEmitter(1.0).sample(64, 1)
    exact = trace_exact(*exact_surfaces(lens, (DenseScan(), DenseScan())), lens.media, rays)
    table = TracedLens.of(lens, 8.0).trace(rays)
    assert exact.absorbed is not None and table.absorbed is not None
    assert torch.allclose(exact.flux, table.flux, rtol=1e-6) and torch.allclose(
        exact.absorbed, table.absorbed, rtol=1e-6
    )


def test_the_flux_budget_names_what_the_body_takes() -> None:
    spec = small_spec(evaluate={"rays": 4096, "pixels": 16})
    lens = Lens(*(random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2)), spec, 0, "draft")
    dim = replace(lens, spec=small_spec(lens__absorption_per_mm=0.05))
    source = SquareEmitter(1.0)
    bright, dark = (evaluate_traced(TracedLens.of(each, 4.0), spec, source, 4096, 0).first for each in (lens, dim))
    assert bright.flux.absorbed == 0.0
    assert sum(dark.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    # 3 mm of body, and a little more for oblique rays
    assert dark.flux.absorbed == pytest.approx(0.96 * (1.0 - np.exp(-0.05 * 3.2)), rel=0.1)
    assert dark.efficiency.value == pytest.approx(bright.efficiency.value * np.exp(-0.05 * 3.2), rel=0.05)
    assert dark.flux.reflected < bright.flux.reflected  # at the outer face less light arrives
