"""How the extremes are searched, and what every trace must keep.

``LENSFORGE_FUZZ=n`` multiplies the number of examples: 1 in the suite, 10 at night; 500 are 10^5 specs and lenses.
"""

from functools import lru_cache

import numpy as np
import torch
from hypothesis import settings
from landed import Landed, by_kernels
from nightly import scaled
from scenes import weight_matrix

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface


def fuzzed(examples: int, *, by_day: int | None = None) -> settings:
    """Always the same examples, ``LENSFORGE_FUZZ`` times as many; fewer ``by_day`` where each is dear."""
    return settings(max_examples=scaled(examples, by_day=by_day), derandomize=True, deadline=None, database=None)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def bundle(origins: np.ndarray, directions: np.ndarray) -> RayBundle:
    """Rays of 1 W together; one origin may serve all."""
    directions = unit(np.atleast_2d(np.asarray(directions, dtype=np.float64)))
    origins = np.array(np.broadcast_to(np.asarray(origins, dtype=np.float64), directions.shape))
    return RayBundle(origins, directions, np.full(len(directions), 1.0 / len(directions)))


@lru_cache(maxsize=16)
def _matrix(grid: TableGrid, basis: SrbfBasis) -> np.ndarray:
    return weight_matrix(grid, basis)


def quick_table_of(surface: SrbfSurface, grid: TableGrid) -> torch.Tensor:
    """The table of one of many lenses of the same basis: a product with a matrix that is made once."""
    table = surface.offset_mm + _matrix(grid, surface.basis) @ surface.weights_mm
    return torch.from_numpy(table.reshape(grid.side, grid.side))


def sound(
    inner: SrbfSurface,
    outer: SrbfSurface,
    rays: RayBundle,
    index: float = 1.4936,
    distance: float = 1000.0,
    nodes: int = 32,
) -> Landed:
    """Trace; every output and gradient is finite, every ray has one fate, and no flux comes out of nothing."""
    grid = TableGrid(nodes)
    tables = [quick_table_of(surface, grid).requires_grad_() for surface in (inner, outer)]
    landed = by_kernels(tables, Scene(Media(Medium(index)), grid), rays, distance)
    is_sound(landed, rays, tables)
    return landed


def is_sound(landed: Landed, rays: RayBundle, parameters: list[torch.Tensor]) -> None:
    outputs = (landed.hits, landed.flux, landed.sin2_exit)
    assert all(torch.isfinite(output).all() for output in (*outputs, landed.exits.points, landed.exits.directions))
    assert set(landed.fates.tolist()) <= set(Fate)
    assert (
        torch.equal(landed.landed | landed.missed_receiver, landed.exits.left_lens)
        and not (landed.landed & landed.missed_receiver).any()
    )
    carried, rounding = landed.carried.detach().numpy(), max(1e-12, 8.0 * torch.finfo(landed.flux.dtype).eps)
    assert (carried >= 0.0).all() and (carried <= rays.flux * (1.0 + rounding)).all()
    rng = np.random.default_rng(0)
    mixed = sum((output * torch.as_tensor(rng.normal(size=output.shape))).sum() for output in outputs)
    gradients = torch.autograd.grad(mixed, parameters, allow_unused=True)
    assert all(gradient is None or torch.isfinite(gradient).all() for gradient in gradients)
