"""The third referee against closed forms; only where Mitsuba is installed and its LLVM is named.

An LLVM that is too old, as Mitsuba may find by itself, ends the whole process.
"""

import importlib.util
import os
from pathlib import Path

import numpy as np
import pytest
from lens_meshes import Quadric, lambertian, lens_mesh, oracle

from lensforge.verification.part import part_of
from lensforge.verification.passage import Fate

pytest.importorskip("mitsuba")
if "DRJIT_LIBLLVM_PATH" not in os.environ:
    pytest.skip("DRJIT_LIBLLVM_PATH is not set", allow_module_level=True)
INDEX, DISTANCE = 1.4936, 150.0
INNER = Quadric((0.3, -0.2, 0.1), (6.0, 6.5, 5.5))
OUTER = Quadric((-0.4, 0.3, -0.5), (13.7, 13.0, 14.0))


@pytest.fixture(scope="module")
def check():
    path = Path(__file__).parents[2] / "benchmarks" / "mitsuba_check.py"
    content = importlib.util.spec_from_file_location("mitsuba_check", path)
    module = importlib.util.module_from_spec(content)
    content.loader.exec_module(module)
    return module


def deviations(check, rings):
    rays = lambertian(4000, 2.0, seed=11)
    hits, flux, _ = oracle(INNER, OUTER, rays, INDEX, DISTANCE)
    part = part_of(lens_mesh(INNER.radius, OUTER.radius, rings, (16.0, 2.0)))
    passage = check.send_through_mitsuba(check.mitsuba_scene(part), rays, INDEX, DISTANCE)
    landed = (passage.fates == Fate.LANDED) & np.isfinite(hits[:, 0])
    assert np.mean(landed == np.isfinite(hits[:, 0])) > 0.995
    np.testing.assert_allclose(passage.flux[landed], flux[landed], rtol=0.02)
    seen = landed & (np.abs(hits).max(axis=1) < 150.0)
    return np.sqrt(np.mean(np.sum((passage.landings[seen] - hits[seen]) ** 2, axis=1)))


def test_mitsuba_lands_rays_where_the_closed_form_does(check):
    coarse, fine = deviations(check, 30), deviations(check, 60)
    assert fine < 0.05
    assert coarse / fine > 3.0  # second order in the edge length, as interpolated normals are
