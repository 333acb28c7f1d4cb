"""The exact trace behind the stated errors, and the errors that a preset is said to have on a scene."""

from dataclasses import replace

import numpy as np
import pytest
from nightly import NIGHTLY
from scenes import random_surface, small_spec

from lensforge.light.evaluation import measure_preset
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.bicubic_table import TableGrid, tabulate


@pytest.fixture(scope="module")
def lens():
    inner, outer = (random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2))
    return Lens.double(inner, outer, small_spec(), 0, "draft")


@pytest.fixture(scope="module")
def source(lens):
    return build_source(lens.spec.source)


def _tables(lens, grid):
    return {name: tabulate(grid, getattr(lens, name)) for name in ("inner", "outer")}


def _traced(lens, grid, **moved):
    tables = [table * (1.0 + moved.get(name, 0.0)) for name, table in _tables(lens, grid).items()]
    return TracedLens(Scene(lens.media, grid), np.stack(tables), table_error_nm={"": 0.0})


def _landed(lens, exits):
    return receivers_of(lens.spec, 16)[0].land(exits)


def test_the_standard_errors_are_the_scatter_over_seeds(lens, source):
    traced = _traced(lens, TableGrid(40))
    errors = [
        measure_preset(replace(lens, seed=seed), source, traced, traced).design for seed in range(12 if NIGHTLY else 6)
    ]
    for name in ("hit_mm", "irradiance_nmse"):
        scatter = np.std([getattr(error, name).value for error in errors], ddof=1)
        stated = np.mean([getattr(error, name).standard_error for error in errors])
        assert 0.4 < stated / scatter < 2.5


def test_the_tables_of_broad_functions_with_large_weights_resolve_their_shape(source):
    """Their sum is finer than they are; a proof compares the part with the tables, to 7.5 um here."""
    inner, outer = (
        random_surface(seed, radius, rough, (9,)) for seed, radius, rough in ((3, 3.0, 0.1), (4, 6.0, 0.05))
    )
    broad = Lens.double(inner, outer, small_spec(), 0, "draft")
    rays = source.sample(4096, 1)
    coarse, fine = (
        _landed(broad, TracedLens.of(broad, nodes).trace(rays))
        for nodes in (PRESETS["draft"].evaluate_nodes_per_sigma, 64.0)
    )
    both = coarse.landed & fine.landed
    assert both.sum() > 4000
    assert np.sqrt(np.mean(np.sum((coarse.hits - fine.hits)[both] ** 2, axis=1))) < 3e-3
