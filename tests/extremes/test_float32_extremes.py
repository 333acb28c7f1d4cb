"""Every named extreme once more, in single precision: the exact tracer takes it from its weights."""

import numpy as np
import pytest
import torch
from exact_surface import ExactSurface
from extremes import bundle, is_sound
from landed import Landed, in_torch, trace_exact
from scenes import hemisphere_directions, random_surface, sphere

from lensforge.kernels.fate import Fate
from lensforge.light.exact_trace import DenseScan
from lensforge.optics.media import Media
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, level_sigma

EPSILON = 2.0**-24
UP = hemisphere_directions(40)


def _trace(inner: SrbfSurface, outer: SrbfSurface, rays: RayBundle, index: float = 1.5, far: float = 20.0) -> Landed:
    surfaces = [ExactSurface.of(s, DenseScan(64, 30), torch.float32, requires_grad=True) for s in (inner, outer)]
    arrivals = in_torch(trace_exact(*surfaces, Media(index), rays, dtype=torch.float32), far)
    assert arrivals.hits.dtype == torch.float32
    is_sound(arrivals, RayBundle(rays.origins, rays.directions, rays.flux * (1.0 + 1e-6)), [
        parameter for s in surfaces for parameter in (s.weights_mm, s.offset_mm)
    ])  # fmt: skip
    return arrivals


@pytest.mark.parametrize("sigma", [1e-3, 0.1, 1.0, 10.0])
def test_functions_of_any_width(sigma: float) -> None:
    basis = SrbfBasis((9,), sigma / level_sigma(9, 1.0))
    bumps = SrbfSurface(basis, np.full(9, 0.01), 1.0)
    _trace(bumps, sphere(2.0), bundle(np.zeros(3), np.concatenate([basis.centres, UP, [[0.0, 0.0, 1.0]]])))


@pytest.mark.parametrize("least", [1e-1, 1e-3, 1e-6])
def test_a_radius_of_nearly_zero(least: float) -> None:
    basis = SrbfBasis((1, 9), 1.0)
    dent = (least - 1.0) * (np.arange(10) == 0)
    _trace(SrbfSurface(basis, dent, 1.0), sphere(2.0), bundle(np.zeros(3), np.concatenate([basis.centres, UP])))


@pytest.mark.parametrize("thickness", [-1e-3, 0.0, 1e-7, 1e-6, 1e-3])
def test_surfaces_that_nearly_touch(thickness: float) -> None:
    _trace(sphere(1.0), sphere(1.0 + thickness), bundle(np.zeros(3), UP))


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 0.0])
def test_a_corner_within_a_hair_of_the_wall(gap: float) -> None:
    corner = (0.8 - gap) / np.sqrt(2.0)
    corners = np.array([[sx * corner, sy * corner, 0.0] for sx in (-1, 1) for sy in (-1, 1)])
    _trace(sphere(0.8), sphere(2.45), bundle(np.repeat(corners, 10, axis=0), UP))


@pytest.mark.parametrize("side", [0.0, 1e-9, 1e-3, 1.1])
def test_from_a_point_to_a_source_as_wide_as_the_cavity(side: float) -> None:
    arrivals = _trace(random_surface(1, 0.8, 0.01), random_surface(2, 2.45, 0.01), SquareEmitter(side).sample(64, 0))
    assert arrivals.landed.any()


@pytest.mark.parametrize("index", [1.0, 1.0 + 2.0 * EPSILON, 1.5, 4.0])
def test_up_to_grazing_and_the_critical_angle(index: float) -> None:
    """From beside the axis of a cavity of air: rays at every angle, some of them totally reflected."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 201)[1:-1]
    rays = bundle([0.799, 0.0, 0.0], np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], axis=1))
    arrivals = _trace(sphere(0.8), sphere(0.9), rays, index)
    reflected = (arrivals.fates == Fate.TOTAL_REFLECTION).sum()
    assert reflected == 0  # what a sphere lets in, a concentric one lets out
    _trace(random_surface(1, 0.8, 0.03), random_surface(8, 2.45, 0.06), rays, index)


@pytest.mark.parametrize("distance", [3e-2, 1e3, 1e7])
@pytest.mark.parametrize("size", [1e-3, 1e4])
def test_receivers_and_lenses_of_any_size(distance: float, size: float) -> None:
    far = max(distance, 3.0 * size)
    u = UP[UP[:, 2] > 0.05]
    arrivals = _trace(sphere(size), sphere(2.0 * size), bundle(np.zeros(3), u), 1.5, far)
    assert np.allclose(arrivals.hits.detach(), u[:, :2] / u[:, 2:] * far, rtol=400.0 * EPSILON)


@pytest.mark.parametrize("rise", [1e-1, 1e-6, 1e-12, 1e-30])
def test_towards_the_horizon(rise: float) -> None:
    _trace(sphere(1.0), sphere(2.0), bundle(np.zeros(3), [[1.0, 0.0, rise]]), 1.0, 1e3)


def test_one_ray() -> None:
    assert len(_trace(sphere(1.0), sphere(2.0), SquareEmitter(0.5).sample(1, 0)).fates) == 1
