"""What holds for every lens and index: étendue is kept, and the single pass through a window is a known number."""

import numpy as np
import pytest
import torch
from extremes import bundle, fuzzed, quick_table_of, sound
from hypothesis import given
from hypothesis import strategies as st
from known_refraction import normal_transmittance
from landed import plane_at, trace_tables
from scenes import hemisphere_directions, random_surface, sphere

from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

INDEX = st.one_of(st.sampled_from([1.0, 4.0]), st.floats(1.0, 4.0))


@fuzzed(20)
@given(INDEX)
def test_multiple_reflections_are_what_a_single_pass_lacks_to_a_window(index: float) -> None:
    """A window passes 2n/(n^2+1); one pass through both faces, (1-R)^2, is that times 1 - R^2."""
    flux = sound(sphere(1.0), sphere(2.0), bundle(np.zeros(3), [[0.0, 0.0, 1.0]]), index, nodes=24).flux.item()
    reflected = 1.0 - normal_transmittance(index)
    assert flux == pytest.approx((4.0 * index / (index + 1.0) ** 2) ** 2, rel=1e-13)
    assert flux / (1.0 - reflected**2) == pytest.approx(2.0 * index / (index**2 + 1.0), rel=1e-13)


def _phase_space(states: np.ndarray, tables: list, index: float, grid: TableGrid) -> np.ndarray:
    """(x, y, p, q) behind the lens from those in the source plane: at a plane behind it; NaN: not arrived."""
    directions = np.column_stack([states[:, 2:], np.sqrt(1.0 - np.sum(states[:, 2:] ** 2, axis=1))])
    origins = np.column_stack([states[:, :2], np.zeros(len(states))])
    rays = RayBundle(origins, directions, np.ones(len(states)))
    exits = trace_tables(tables, Scene(Media(Medium(index)), grid), rays)
    seen = plane_at(4.0).land_by_arrays(exits)
    state = np.column_stack([seen.hits, exits.directions[:, :2]])
    return np.where(seen.landed[:, None], state, np.nan)


def _liouville_error(
    states: np.ndarray, tables: list[torch.Tensor], index: float, grid: TableGrid, h: float
) -> np.ndarray:
    """How far the determinant of the map is from 1, by central differences; they lose digits where it stretches."""
    columns = []
    for axis in range(4):
        ahead, behind = (_phase_space(states + s * h * np.eye(4)[axis], tables, index, grid) for s in (1, -1))
        columns.append((ahead - behind) / (2.0 * h))
    jacobian = np.stack(columns, axis=-1)
    return np.abs(np.linalg.det(jacobian) - 1.0) / np.linalg.norm(jacobian, axis=(1, 2)) ** 2


@fuzzed(10)
@given(INDEX, st.integers(0, 2**31))
def test_etendue_is_kept_by_any_lens(index: float, seed: int) -> None:
    """The map of (x, y, p, q) through both surfaces has determinant 1 (Liouville)."""
    grid = TableGrid(60)
    tables = [quick_table_of(random_surface(seed + k, r, 0.01, (9, 25)), grid) for k, r in ((0, 1.0), (1, 2.0))]
    count, rng = 40, np.random.default_rng(seed)
    states = np.column_stack([rng.uniform(-0.3, 0.3, (count, 2)), 0.6 * hemisphere_directions(count, seed)[:, :2]])
    # where a knot of the spline lies between, its third derivative jumps: then the other step tells
    error = np.fmin(*(_liouville_error(states, tables, index, grid, h) for h in (1e-5, 3e-6)))
    assert np.isfinite(error).sum() > 20
    assert np.nanmax(error) < 1e-8
