"""What fills the cavity and surrounds the lens: ratios of indices count, and a face between equals does nothing."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from landed import by_kernels, in_torch
from scenes import hemisphere_directions, random_surface, small_spec, sphere, table_of

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.device_trace import tables_on
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.sequential_trace import TensorRays, trace_sequence
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.optics.media import Media
from lensforge.scene.lens import Lens
from lensforge.search.light_path import TableSurface
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

N, GEL, WATER, Z, GRID = 1.4936, 1.41, 1.333, 1000.0, TableGrid(64)
TABLES = [table_of(each, GRID) for each in (random_surface(3, 0.8, 0.03), random_surface(4, 2.45, 0.02))]
RAYS = SquareEmitter(0.9).sample(512, 1)
WET = Scene(Media(N, 0.1, GEL, WATER), GRID)


def test_a_gel_of_the_index_of_the_lens_makes_the_inner_face_do_nothing() -> None:
    gel = Scene(Media(N, cavity_index=N), GRID)
    one, other = (trace_tables(each, TABLES[1], gel, RAYS) for each in (TABLES[0], table_of(sphere(0.7), GRID)))
    out = one.left_lens & other.left_lens
    assert out.sum() > 450
    for name in ("points", "directions", "flux", "sin2_exit"):
        assert torch.allclose(getattr(one, name)[out], getattr(other, name)[out], rtol=1e-9, atol=1e-12), name


def test_only_ratios_of_indices_count() -> None:
    air, scaled = (Scene(Media(k * N, 0.05, k, k), GRID) for k in (1.0, 1.3))
    one, other = (trace_tables(*TABLES, scene, RAYS) for scene in (air, scaled))
    assert torch.equal(one.fates, other.fates)
    assert torch.allclose(one.directions, other.directions, rtol=1e-12, atol=1e-13)
    assert torch.allclose(one.flux, other.flux, rtol=1e-12)


def test_light_from_the_centre_of_spheres_meets_two_faces_at_normal_incidence() -> None:
    rays = RayBundle(np.zeros((300, 3)), hemisphere_directions(300), np.ones(300))
    exits = trace_tables(
        table_of(sphere(2.0), GRID), table_of(sphere(5.0), GRID), replace(WET, media=Media(N, 0.0, GEL, WATER)), rays
    )
    through = 4 * GEL * N / (GEL + N) ** 2 * 4 * WATER * N / (WATER + N) ** 2
    np.testing.assert_allclose(exits.flux.numpy(), through, rtol=1e-9)
    assert transmittance_of(WET.media) == pytest.approx(through, rel=1e-14)


def test_a_gel_denser_than_the_lens_may_reflect_all_light_at_the_inner_face() -> None:
    flat = table_of(random_surface(8, 0.8, 0.1, levels=(25, 81)), GRID)
    exits = trace_tables(flat, table_of(sphere(2.45), GRID), Scene(Media(1.3, cavity_index=1.6), GRID), RAYS)
    inside = exits.fates == Fate.TOTAL_REFLECTION
    assert inside.sum() > 5 and not exits.sin2_exit[inside].all()


def test_the_tracer_in_torch_and_its_gradients_are_those_of_the_kernels() -> None:
    tables = [each.clone().requires_grad_() for each in TABLES]
    inner, outer = (TableSurface(each) for each in tables_on(torch.device("cpu"), *tables, WET))
    found = trace_sequence(inner, outer, TensorRays.of(RAYS, WET.media, torch.float64, torch.device("cpu")))
    twin, kernels = in_torch(found, Z), by_kernels(tables, WET, RAYS, Z)
    assert torch.equal(twin.fates, kernels.fates)
    assert torch.allclose(twin.hits, kernels.hits, rtol=1e-8, atol=1e-6)
    assert torch.allclose(twin.carried, kernels.carried, rtol=1e-10, atol=0.0)
    by_flux = torch.from_numpy(np.random.default_rng(1).normal(size=len(RAYS)))
    pairs = ((by_flux * each.flux).sum() + torch.tanh(each.hits / Z).sum() for each in (twin, kernels))
    one, other = (torch.autograd.grad(value, tables) for value in pairs)
    for a, b in zip(one, other, strict=True):
        assert torch.linalg.norm(a - b) < 1e-8 * torch.linalg.norm(b)


def test_gradients_are_those_of_finite_differences() -> None:
    by_flux = torch.from_numpy(np.random.default_rng(2).normal(size=len(RAYS)))
    tables = [each.clone().requires_grad_() for each in TABLES]

    def value(*moved: torch.Tensor) -> torch.Tensor:
        found = by_kernels(list(moved), WET, RAYS, Z)
        return (100.0 * by_flux * found.flux).sum() + found.hits.sum() / Z + (by_flux * found.sin2_exit).sum()

    for which, gradient in enumerate(torch.autograd.grad(value(*tables), tables)):
        direction = torch.from_numpy(np.random.default_rng(5).normal(size=gradient.shape)) * (gradient != 0)
        ahead, behind = (
            value(*(each + s * 1e-7 * direction * (k == which) for k, each in enumerate(TABLES))) for s in (1, -1)
        )
        assert (ahead - behind).item() / 2e-7 == pytest.approx((gradient * direction).sum().item(), rel=1e-5)


def test_a_spec_states_them_and_its_light_is_traced_with_them() -> None:
    spec = small_spec(lens__cavity_index=GEL, lens__outside_index=WATER)
    assert spec.lens.media == Media(1.4936, 0.0, GEL, WATER)
    lens = Lens(*(random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2)), spec, 0, "draft")
    wet = evaluate_traced(TracedLens.of(lens, 4.0), spec, SquareEmitter(1.0), 4096, 0).first
    assert sum(wet.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    assert 0.0 < wet.flux.reflected < 0.01  # 0.08 in air
    with pytest.raises(InputError, match=r"lens.cavity_index: .*greater than or equal to 1|cavity_index"):
        small_spec(lens__cavity_index=0.9)
