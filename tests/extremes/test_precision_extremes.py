"""Single precision: the exact tracer takes it from its weights; the fused one computes in float64 only."""

import torch
from exact_surface import ExactSurface
from extremes import fuzzed, is_sound
from hypothesis import given
from hypothesis import strategies as st
from landed import in_torch, trace_exact
from scenes import random_surface

from lensforge.optics.media import Media, Medium
from lensforge.sources.build_source import SquareEmitter
from lensforge.surfaces.srbf import SrbfSurface

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
    arrivals = in_torch(trace_exact(*surfaces, Media(Medium(index)), rays, dtype=dtype), 20.0 * size)
    assert arrivals.hits.dtype == dtype
    is_sound(arrivals, rays, [p for s in surfaces for p in (s.weights_mm, s.offset_mm)])
