"""A ray is traced the same whichever packet it is in, and beside whichever other rays."""

import numpy as np
import pytest
from scenes import random_surface

from lensforge.kernels.ray_packet import SIZE, WIDTH
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import Media, Medium
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

GRID = TableGrid(60)
SCENE = Scene(Media(Medium(1.6)), GRID)
COUNT = 2 * SIZE + 3


def _tables() -> list[np.ndarray]:
    return [tabulate(GRID, random_surface(seed, radius, 0.05)) for seed, radius in ((1, 0.9), (2, 1.7))]


def _rays() -> RayBundle:
    """From everywhere to everywhere, so that rays of all fates lie beside each other."""
    rng = np.random.default_rng(0)
    led = SquareEmitter(0.8).sample(COUNT, 0)
    origins = led.origins.copy()
    directions = led.directions.copy()
    origins[::5] = rng.normal(size=origins[::5].shape) * 0.6
    directions[::5] = rng.normal(size=directions[::5].shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins[7] = np.nan
    return RayBundle(origins, directions, led.flux)


def _fields(exits: ExitRays) -> tuple[np.ndarray, ...]:
    return exits.points, exits.directions, exits.flux, exits.sin2_exit, exits.fates


@pytest.mark.parametrize("size", [1, WIDTH - 1, WIDTH + 1, SIZE - 1, SIZE, SIZE + 1])
def test_parts_of_a_bundle_are_traced_as_the_whole(size: int) -> None:
    tables = _tables()
    rays = _rays()
    whole = _fields(TracedBundle.of(tables, SCENE, rays).exits)
    assert len(set(whole[-1].tolist())) >= 4, "rays of several fates"
    starts = range(0, COUNT, size) if size > WIDTH + 1 else range(0, 6 * size, size)
    parts = [TracedBundle.of(tables, SCENE, rays.take(slice(start, start + size))).exits for start in starts]
    for name, field, pieces in zip("pdfsf", whole, zip(*map(_fields, parts), strict=True), strict=True):
        joined = np.concatenate(pieces)
        assert np.array_equal(joined, field[: len(joined)]), name


def test_gradients_are_the_sum_of_those_of_the_parts() -> None:
    tables = _tables()
    rays = _rays()
    rng = np.random.default_rng(1)
    by = Sensitivities(rng.normal(size=(COUNT, 3)), rng.normal(size=(COUNT, 3)))
    by_flux = rng.normal(size=COUNT)
    by_sin2 = rng.normal(size=COUNT)
    by_flux[::3] = 0.0
    by_sin2[::3] = 0.0
    # these matter to nothing: their places are others'
    by.by_points[::3] = 0.0
    by.by_directions[::3] = 0.0
    whole = TracedBundle.of(tables, SCENE, rays).gradients(by, by_flux, by_sin2)
    total = [np.zeros_like(gradient) for gradient in whole]
    for start in range(0, COUNT, 101):
        part = slice(start, start + 101)
        traced = TracedBundle.of(tables, SCENE, rays.take(part))
        gradients = traced.gradients(
            Sensitivities(by.by_points[part], by.by_directions[part]), by_flux[part], by_sin2[part]
        )
        total = [a + b for a, b in zip(total, gradients, strict=True)]
    for summed, at_once in zip(total, whole, strict=True):
        assert np.allclose(summed, at_once, rtol=1e-11, atol=1e-11 * np.abs(at_once).max())


def test_no_rays_are_no_light() -> None:
    traced = TracedBundle.of(_tables(), SCENE, _rays().take(slice(0, 0)))
    assert len(traced.exits.flux) == 0
    inner, outer = traced.gradients(Sensitivities(np.zeros((0, 3)), np.zeros((0, 3))), np.zeros(0), np.zeros(0))
    assert not inner.any() and not outer.any()


def test_fields_of_a_ray_lie_in_different_sets_of_a_cache() -> None:
    """Of 64 sets of 64 bytes, as the first caches of processors have: 256 rays would take two of them, or four."""
    for kind in (np.float64, np.float32):
        places = np.arange(64) * SIZE * np.dtype(kind).itemsize
        assert len(set((places // 64 % 64).tolist())) >= 32
