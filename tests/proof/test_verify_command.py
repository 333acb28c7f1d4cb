"""``lensforge verify --stray`` on the files of a small lens."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from presets import COARSE_SPLINES
from scenes import random_surface, small_spec

from lensforge.cli.cli import cli
from lensforge.scene.lens import Lens
from lensforge.verbs import EVALUATE, EXPORT


@pytest.fixture(scope="module")
def verified(tmp_path_factory):
    folder = tmp_path_factory.mktemp("verified")
    spec = small_spec(lens__absorption_per_mm=0.002)
    surfaces = [random_surface(seed, offset, 0.002, (9, 25)) for seed, offset in ((1, 3.0), (2, 6.0))]
    Lens.double(*surfaces, spec, 0, COARSE_SPLINES).save(folder / "lens.json")
    EVALUATE.run(folder)
    EXPORT.run(folder, rings=24)  # a mesh for the cast, not for the shop
    done = CliRunner().invoke(cli, ["verify", str(folder), "--rays", "512", "--stray", "--base", "black", "--json"])
    assert done.exit_code == 0, (done.output, done.exception)
    return folder, json.loads(done.stdout)


def test_the_step_is_cast_beside_the_mesh(verified):
    folder, printed = verified
    brep = json.loads((folder / "verify_512rays.json").read_text(encoding="utf-8"))["receivers"][0]["brep"]
    assert brep["rays"] == 512
    assert brep["against_design"]["rms"] < 5e-5 * 100.0
    assert printed["verify_512rays"]["receivers"][0]["brep"] == brep


def test_stray_light_is_followed_with_what_the_spec_absorbs(verified):
    folder, printed = verified
    stray = json.loads((folder / "stray_512rays.json").read_text(encoding="utf-8"))
    assert (stray["base"], stray["absorption_per_mm"]) == ("black", 0.002)
    assert sum(stray["flux"].values()) == pytest.approx(1.0, abs=1e-9)
    # About 3 mm of way through the bulk: 1 - exp(-0.006) of the flux, and little more by reflections.
    assert 0.004 < stray["flux"]["absorbed"] < 0.012
    assert stray["flux"]["base"] > 0.0
    assert printed["stray_512rays"]["efficiency"] == stray["efficiency"]
    verify = json.loads((folder / "verify_512rays.json").read_text(encoding="utf-8"))
    assert stray["efficiency_sequential"] == pytest.approx(verify["efficiency"], rel=1e-12)
    with np.load(folder / "stray_512rays.npz") as images:
        assert images["receivers.0.stray"].shape == images["receivers.0.sequential"].shape == (16, 16)
