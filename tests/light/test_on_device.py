"""The tracer in plain torch against the kernels: the same tables, so every ray agrees, and so do the gradients."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hard_rays import all_hits, hard_rays
from landed import Landed, by_kernels, in_torch, on_device
from scenes import DEVICES, random_surface, table_of

from lensforge.kernels.bicubic import surface_bounds
from lensforge.kernels.fate import Fate
from lensforge.light.device_trace import DeviceTable, first_crossing
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.search.searches import device_of
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

GRID = TableGrid(64)
SCENE, DISTANCE = Scene(Media(Medium(1.4936)), GRID), 100.0
pytestmark = pytest.mark.parametrize("device", DEVICES)


def _tables(seed: int, roughness: float, *radii: float) -> list[torch.Tensor]:
    inner, outer = radii or (0.8, 2.45)
    surfaces = random_surface(seed, inner, roughness), random_surface(seed + 1, outer, 0.8 * roughness)
    return [table_of(surface, GRID).requires_grad_() for surface in surfaces]


def _both(device: str, tables: list[torch.Tensor], rays: RayBundle, scene: Scene = SCENE) -> tuple[Landed, Landed]:
    """By the kernels, and on the device, copied back."""
    return by_kernels(tables, scene, rays, DISTANCE), in_torch(on_device(tables, scene, rays, device), DISTANCE)


def _agree(kernels: Landed, found: Landed) -> None:
    """The same to rounding, which the way to the receiver multiplies: some rays land 50 m aside."""
    assert torch.equal(found.fates, kernels.fates)
    assert torch.allclose(found.carried, kernels.carried, rtol=1e-10, atol=0.0)
    assert torch.allclose(found.sin2_exit, kernels.sin2_exit, rtol=0.0, atol=1e-11)
    gentle = kernels.sin2_exit < 0.99  # nearer to the critical angle, rounding grows on the way to the receiver
    apart, far = (found.hits - kernels.hits).norm(dim=1), kernels.hits.norm(dim=1)
    assert (apart <= 1e-9 + 5e-10 * far)[gentle].all()
    assert torch.allclose(found.hits, kernels.hits, rtol=1e-7, atol=1e-7)


def test_every_fate_is_that_of_the_kernels(device: str) -> None:
    """From everywhere to everywhere, through lenses that reflect, and whose surfaces cross."""
    rng, count = np.random.default_rng(0), 4000
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = rng.normal(size=(count, 3)) * 0.5
    origins[:10], directions[10:20] = 0.0, [0.0, 0.0, 1.0]
    origins[20], directions[21] = np.nan, np.nan
    rays = RayBundle(origins, directions, rng.random(count))
    seen: set[int | str] = set()
    for seed, roughness, radii in ((1, 0.06, (0.8, 1.6)), (3, 0.15, (1.0, 1.3)), (5, 0.0, (1.0, 0.5))):
        kernels, found = _both(device, _tables(seed, roughness, *radii), rays, replace(SCENE, media=Media(Medium(1.6))))
        _agree(kernels, found)
        assert torch.equal(found.missed_receiver, kernels.missed_receiver)
        seen |= set(kernels.fates.tolist()) | ({"missed_receiver"} if kernels.missed_receiver.any() else set())
    assert seen == set(Fate) - {Fate.NOT_CONVERGED, Fate.MORE_EVENTS, Fate.FLANGE} | {"missed_receiver"}


@pytest.mark.parametrize(("seed", "roughness"), [(1, 0.01), (2, 0.03), (3, 0.06)])
def test_hard_rays_cross_where_the_kernel_says(device: str, seed: int, roughness: float) -> None:
    count, grid = 4000, TableGrid(100)
    table = tabulate(grid, random_surface(seed, 2.0, roughness, levels=(25, 81, 289)))
    starts, directions = hard_rays(table, grid, count, seed)
    bounds = surface_bounds(table, grid.origin, grid.step)
    lengths, hit, lost = all_hits(starts, directions, table, grid)
    table_there = DeviceTable.of(torch.from_numpy(table), grid, bounds, torch.device(device))
    found = first_crossing(table_there, *(torch.from_numpy(array).to(device) for array in (starts, directions)))
    paths = found.lengths.cpu().numpy()
    above = starts[:, 2] + paths * directions[:, 2] >= 0.0
    assert np.array_equal(found.found.cpu().numpy() & above, hit)
    assert not lost.any() and not found.lost.any()
    assert np.abs(paths - lengths)[hit].max() < 1e-9


def test_a_device_is_found_by_its_name(device: str) -> None:
    assert device_of(device) == (None if device == "cpu" else torch.device("cuda"))
