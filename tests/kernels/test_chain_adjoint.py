"""Rays of a chain that end before their last event."""

from dataclasses import replace

import numpy as np
from chains import clear, collimator, tables_of, upwards

from lensforge.kernels.traced_body import Ways
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.scene.exit_rays import Sensitivities
from lensforge.surfaces.bicubic_table import TableGrid


def test_a_ray_that_ends_at_a_tangent_adds_nothing() -> None:
    """Its squared sine is not that at the wall, which reflected it before; that counts where it is the last event."""
    body = collimator()
    grid = TableGrid(81)
    by = (Sensitivities(*np.zeros((2, 400, 3))), np.zeros(400))
    base = TracedBundle.of(tables_of(body, grid), Scene(clear(), grid, chain=body.chain(2)), upwards(400, 1, 0.5))
    ways = Ways(*(np.pad(array, ((0, 0), (0, 1)), constant_values=-1) for array in (base.lengths, base.met)))
    tangent = replace(base, lens=replace(base.lens, ways=ways))
    by_sin2 = 1.0 * (base.exits.fates == 4)
    assert base.gradients(*by, by_sin2).any() and not tangent.gradients(*by, by_sin2).any()
