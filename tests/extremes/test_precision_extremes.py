"""Single precision: the exact tracer takes it from its weights; the fused one computes in float64 only."""

import numpy as np
import pytest
import torch
from exact_surface import ExactSurface
from extremes import bundle, fuzzed, is_sound
from hypothesis import given
from hypothesis import strategies as st
from known_refraction import normal_transmittance
from landed import by_kernels, in_torch, trace_exact
from scenes import hemisphere_directions, random_surface, sphere, table_of

from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media
from lensforge.sources.build_source import SquareEmitter
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

DTYPE = st.sampled_from([torch.float32, torch.float64])


def _exact(surface: SrbfSurface, dtype: torch.dtype) -> ExactSurface:
    return ExactSurface.of(surface, dtype=dtype, requires_grad=True)


@fuzzed(20, by_day=8)
@given(
    DTYPE,
    st.integers(0, 2**31),
    st.floats(0.0, 0.1),
    st.sampled_from([1.0, 1.4936, 4.0]),
    st.floats(0.0, 1.8),
    st.sampled_from([1e-3, 1.0, 1e4]),
    st.sampled_from([1.001, 1.5, 3.0]),
)
def test_any_lens_through_the_exact_tracer(dtype, seed, roughness, index, side, size, ratio) -> None:
    surfaces = [
        _exact(random_surface(seed + k, radius * size, roughness, levels=(9,)), dtype)
        for k, radius in ((0, 1.0), (1, ratio))
    ]
    rays = SquareEmitter(side * size).sample(32, seed)
    arrivals = in_torch(trace_exact(*surfaces, Media(index), rays, dtype=dtype), 20.0 * size)
    assert arrivals.hits.dtype == dtype
    is_sound(arrivals, rays, [p for s in surfaces for p in (s.weights_mm, s.offset_mm)])


@fuzzed(10, by_day=5)
@given(DTYPE, st.sampled_from([1.0, 1.4936, 4.0]), st.sampled_from([1e-3, 1.0, 1e4]), st.sampled_from([2.1, 1e5]))
def test_concentric_spheres_bend_nothing_in_either_precision(dtype, index, size, distance) -> None:
    u = hemisphere_directions(100)
    u = u[u[:, 2] > 0.05]
    surfaces = [_exact(sphere(radius * size), dtype) for radius in (1.0, 2.0)]
    arrivals = in_torch(trace_exact(*surfaces, Media(index), bundle(np.zeros(3), u), dtype=dtype), distance * size)
    assert arrivals.landed.all()
    precision = 400.0 * torch.finfo(dtype).eps
    assert np.allclose(arrivals.hits.detach(), u[:, :2] / u[:, 2:] * distance * size, rtol=precision)
    assert arrivals.flux.sum().item() == pytest.approx(normal_transmittance(index) ** 2, rel=precision)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_exact_tracer_at_centres_axis_and_rim(dtype: torch.dtype) -> None:
    """The oracle too, in both precisions: through centres, along the axis, into the base."""
    basis = SrbfBasis((9, 25), 1.75)
    rng = np.random.default_rng(0)
    surfaces = [
        ExactSurface(
            basis,
            torch.tensor(0.02 * radius * rng.normal(size=basis.size), dtype=dtype, requires_grad=True),
            torch.tensor(radius, dtype=dtype, requires_grad=True),
        )
        for radius in (1.0, 2.0)
    ]
    horizon = [[1.0, 0.0, rise] for rise in (0.1, 1e-3, 1e-6, 1e-12)]
    rays = bundle(np.zeros(3), np.concatenate([basis.centres, [[0.0, 0.0, 1.0]], horizon]))
    rays.origins[-2:, 0] = 0.5
    arrivals = in_torch(trace_exact(*surfaces, Media(1.4936), rays, dtype=dtype), 10.0)
    assert arrivals.hits.dtype == dtype
    outputs = (arrivals.hits, arrivals.carried, arrivals.sin2_exit)
    assert all(torch.isfinite(output).all() for output in outputs)
    mixed = arrivals.hits.sum() / 1e3 + arrivals.carried.sum() + arrivals.sin2_exit.sum()
    parameters = [p for s in surfaces for p in (s.weights_mm, s.offset_mm)]
    assert all(torch.isfinite(g).all() for g in torch.autograd.grad(mixed, parameters))


@pytest.mark.nightly("a quarter of a minute")
def test_tables_in_single_precision_are_traced_in_double() -> None:
    """The fused path computes in float64 only; a float32 table is just a rounded one."""
    grid = TableGrid(32)
    rays = SquareEmitter(0.6).sample(256, 0)
    tables = [table_of(random_surface(k, r, 0.01), grid) for k, r in ((1, 0.8), (2, 2.45))]
    double = by_kernels(tables, Scene(Media(1.5), grid), rays, 10.0)
    rounded = [table.float().requires_grad_() for table in tables]
    single = by_kernels(rounded, Scene(Media(1.5), grid), rays, 10.0)
    assert single.hits.dtype == torch.float64
    assert (single.hits - double.hits).abs().max() < 1e-3
    is_sound(single, rays, rounded)
