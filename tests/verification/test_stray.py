import json

import numpy as np
import pytest
from lens_meshes import Quadric, lambertian, lens_mesh, oracle

from lensforge.errors import InputError
from lensforge.verification.nonsequential import Limits
from lensforge.verification.picture import Receiver
from lensforge.verification.stray import trace_stray

INDEX, DISTANCE, SIDE, PIXELS = 1.4936, 150.0, 300.0, 32
INNER = Quadric((0.3, -0.2, 0.1), (6.0, 6.5, 5.5))
OUTER = Quadric((-0.4, 0.3, -0.5), (13.7, 13.0, 14.0))
RAYS = lambertian(1500, 2.0, seed=7)


@pytest.fixture(scope="module")
def stl(tmp_path_factory):
    path = tmp_path_factory.mktemp("stray") / "lens.stl"
    lens_mesh(INNER.radius, OUTER.radius, 30, (16.0, 2.0)).export(path)
    return path


def run(stl, folder, **changes):
    given = {
        "rays": RAYS,
        "refractive_index": INDEX,
        "absorption_per_mm": 0.0,
        "distance_mm": DISTANCE,
        "receiver": Receiver(SIDE, PIXELS, 0.0),
        "window_mm": SIDE,
    }
    return trace_stray(stl, folder, **{**given, **changes})


def test_pictures_hold_the_flux_of_the_account(stl, tmp_path):
    content = run(stl, tmp_path)
    pixel = (SIDE / PIXELS * 1e-3) ** 2
    with np.load(tmp_path / "stray.npz") as images:
        assert images["stray"].sum() * pixel == pytest.approx(content["flux"]["detected_stray"], rel=1e-12)
        assert images["direct"].sum() * pixel == pytest.approx(content["flux"]["detected_direct"], rel=1e-12)
        np.testing.assert_allclose(images["direct"], images["sequential"], rtol=1e-9, atol=1e-12)
    assert json.loads((tmp_path / "stray.json").read_text(encoding="utf-8")) == content
    assert all(gate["passed"] for gate in content["gates"])
    assert content["balance_error"] < 1e-9
    assert sum(content["detected_stray_by_cause"].values()) == pytest.approx(content["flux"]["detected_stray"])
    assert content["misjudged_flux"] == pytest.approx(content["flux"]["detected_stray"], rel=1e-6)


def test_the_sequential_share_is_the_closed_form_of_the_lens(stl, tmp_path):
    hits, flux, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
    inside = np.abs(hits).max(axis=1) <= SIDE / 2
    assert run(stl, tmp_path)["efficiency_sequential"] == pytest.approx(flux[inside].sum(), rel=2e-3)


def test_absorption_dims_by_beer_and_lambert(stl, tmp_path):
    """To first order in the coefficient, direct light loses the coefficient times its mean path of about 7.5 mm."""
    clear, dim, dimmer = (run(stl, tmp_path, absorption_per_mm=alpha)["flux"] for alpha in (0.0, 1e-4, 2e-4))
    losses = [clear["detected_direct"] - other["detected_direct"] for other in (dim, dimmer)]
    assert losses[1] == pytest.approx(2.0 * losses[0], rel=2e-3)
    assert 6.0 < losses[0] / (1e-4 * clear["detected_direct"]) < 9.0
    assert dim["absorbed"] > losses[0]


def test_a_black_base_takes_light_that_a_polished_one_lets_go(stl, tmp_path):
    polished, black = (run(stl, tmp_path, base=base)["flux"] for base in ("polished", "black"))
    assert polished["base"] == 0.0 < black["base"]
    assert black["detected_direct"] == pytest.approx(polished["detected_direct"], rel=1e-12)
    assert black["outside_stray"] <= polished["outside_stray"]
    assert black["backward"] < polished["backward"]


def test_a_cut_off_that_leaves_too_much_out_fails(stl, tmp_path):
    content = run(stl, tmp_path, limits=Limits(cut_off=0.1))
    assert {gate["name"] for gate in content["gates"] if not gate["passed"]} == {"stray_too_dim"}


def test_a_file_that_is_no_mesh_is_input_error(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        run(tmp_path / "lens.stl", tmp_path)
