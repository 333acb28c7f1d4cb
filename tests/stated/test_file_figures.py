"""Figures by the rays of a ray file that its model was not fitted to, by docs/definitions.md for these very rays."""

import json
from typing import Any

import crooked
import numpy as np
import pytest
from crooked import FEW_RAYS, Case, Record, led_rays, stored, write_leds
from oracle_light import light_of, stated
from scipy.spatial import KDTree
from test_every_fact import differences
from test_rays_tables_and_files import own_rays

import lensforge as lf
from lensforge.light.light_facts import light_facts

RAYS = 6000  # of the file: a fifth are held back
LED = {
    "kind": "rayfile", "model": "radiance", "flux_w": 0.9, "scale": 1.1, "mirror": "x",
    "rotate_z_deg": -25.0, "tilt_deg": [-3.0, 5.0], "position_mm": [-0.12, 0.2, 0.35],
}  # fmt: skip


@pytest.fixture(scope="module")
def modelled(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The light of the crooked lens "leds" with the model of one leaning, mirrored file."""
    folder = tmp_path_factory.mktemp("modelled")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(crooked.FILES, "far", RAYS)
        write_leds(folder)
    content = json.loads(stored("leds", folder).read_text(encoding="utf-8"))
    content["spec"] |= {"source": LED | {"file": str(folder / "far.tm25ray")}, "sources": []}
    content["spec"]["optimise"].pop("over_sources")
    (folder / "lens.json").write_text(json.dumps(content), encoding="utf-8")
    lens = lf.load_lens(folder / "lens.json")
    record = Record()
    with record.kept():
        record.begins("evaluate")
        light = lf.evaluate(lens, accuracy=FEW_RAYS, seed=3)
    lens.save(folder / "lens.json")
    content = json.loads((folder / "lens.json").read_text(encoding="utf-8"))
    return Case("modelled", folder, content, {"evaluate": light}, {"evaluate": light_facts(light, lens)}, record.rays)


def facts(case: Case) -> dict[str, Any]:
    return {fact.key: fact for _, fact in case.stated()}


def held_back(case: Case) -> Any:
    """Rays that the evaluation drew last, one call of all replicates."""
    return case.rays["evaluate"][-1]


def test_they_are_those_of_the_light_of_these_rays(modelled: Case) -> None:
    record, _ = light_of(modelled, [held_back(modelled)], modelled.lens["spec"]["source"], warm=False)
    oracle = record["receivers"][0]
    by_key = facts(modelled)
    wrong = [*differences(by_key["file_nmse"], stated(oracle["nmse"]))]
    wrong += differences(by_key["file_efficiency"], stated(oracle["efficiency"], 100.0, "%"))
    assert not wrong, "\n".join(wrong)


def test_these_rays_are_a_fifth_of_the_file(modelled: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has the direction of one in the file, all of unlike ones, and the flux that this one has of the whole."""
    monkeypatch.setitem(crooked.FILES, "far", RAYS)
    _, directions, flux, _ = own_rays(modelled.lens["spec"]["source"], held_back(modelled))
    _, of_file, flux_of_file = led_rays("far")
    apart, rows = KDTree(of_file.astype(float)).query(directions * [-1.0, 1.0, 1.0])
    assert len(set(rows)) == len(rows) == RAYS // 5 and apart.max() < 1e-6
    np.testing.assert_allclose(flux / flux.sum(), flux_of_file[rows] / flux_of_file[rows].sum(dtype=float), rtol=1e-6)
