"""Errors of mounting and of index, seen by rays that carry indices of their own."""

import numpy as np
from scenes import small_spec

from lensforge.sources.build import build_source
from lensforge.tolerancing.shifted_source import ShiftedSource


def test_an_error_of_index_reaches_rays_with_indices_of_their_own_and_only_these():
    light = {"kind": "line", "wavelength_nm": 450.0}
    dispersed = small_spec(source={"kind": "square", "side_mm": 1.0, "spectrum": light}, lens__material="PMMA")
    plain = small_spec()
    for spec in (dispersed, plain):
        source = build_source(spec.source, spec.lens.dispersion)
        before, after = (s.sample(16, 1) for s in (source, ShiftedSource(source, (0.5, 0.0, 0.0), 1e-3)))
        np.testing.assert_allclose(after.origins - before.origins, np.tile([0.5, 0.0, 0.0], (16, 1)), atol=1e-15)
        np.testing.assert_array_equal(after.weights, before.weights)
        if spec is plain:
            assert after.refractive_indices is None
        else:
            np.testing.assert_allclose(after.refractive_indices - before.refractive_indices, 1e-3, atol=1e-15)
