"""Rays of a chain that end before their last event."""

from dataclasses import replace

import numpy as np
from chains import clear, collimator, tables_of, upwards

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.scene.exit_rays import Sensitivities
from lensforge.surfaces.bicubic_table import TableGrid


def test_a_ray_that_ends_at_a_tangent_has_no_derivative() -> None:
    """Its squared sine is not that at the wall, which reflected it before; at the last event it counts."""
    body, grid, rays = collimator(), TableGrid(81), upwards(400, 1, 0.5)
    tables, nothing, one = tables_of(body, grid), Sensitivities(*np.zeros((2, 400, 3))), np.ones(400)
    shorter = TracedBundle.of(tables, Scene(clear(), grid, chain=body.chain(2)), rays)
    reflected = shorter.exits.fates == Fate.TOTAL_REFLECTION
    assert reflected.sum() > 50 and np.abs(shorter.gradients(nothing, 0.0 * one, one * reflected)).max() > 0.0

    traced = TracedBundle.of(tables, Scene(clear(), grid, chain=body.chain(6)), rays)
    met = np.where(np.arange(6) < 2, traced.met, -1).astype(np.int8)
    fates = np.where(reflected, Fate.TOTAL_REFLECTION, traced.exits.fates).astype(np.int8)
    tangent = replace(traced, met=met, exits=replace(traced.exits, fates=fates))
    assert (met[reflected, 1] >= 0).all()
    assert not tangent.gradients(nothing, 0.0 * one, one * reflected).any()
