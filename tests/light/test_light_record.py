"""The record of a light on two receivers: what it says of itself, what it refuses, and which receiver is the first."""

import json
from pathlib import Path
from typing import Any

import pytest
from addon_rows import has_addon
from scenes import random_surface, small_spec

from lensforge.errors import InputError
from lensforge.light import evaluation
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.evaluation_result import Light
from lensforge.light.light_facts import light_facts
from lensforge.light.simulation import TracedLens
from lensforge.optics.efficacy import Efficacy
from lensforge.results.stage_result import with_checksum
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS

WALL = {"kind": "plane", "name": "wall", "centre_mm": [0.0, 0.0, 60.0], "width_mm": 90.0, "height_mm": 60.0,
        "targets": [{"kind": "disc", "diameter_mm": 40.0, "uniform_mm": 20.0}]}  # fmt: skip
SKY = {"kind": "far_field", "name": "sky", "half_angle_deg": 60.0, "targets": [{"kind": "beam", "fwhm_deg": 30.0}]}


def bumpy(spec: Spec) -> Lens:
    return Lens.double(random_surface(1, 3.0, 0.02, (9,)), random_surface(2, 6.0, 0.02, (9,)), spec, 0, "draft")


@pytest.fixture(scope="module")
def scene() -> tuple[TracedLens, Any, Any]:
    spec = small_spec(target=None, receivers=[WALL, SKY], source__flux_w=2.5)
    return TracedLens.of(bumpy(spec), 2.0), spec, build_source(spec.source)


@pytest.fixture(scope="module")
def light(scene) -> Light:
    traced, spec, source = scene
    return evaluate_traced(traced, spec, source, 512, 3, pixels=12)


def test_receivers_of_lamps_have_rasters_of_their_own() -> None:
    """A pitch is a whole number of pixels, on a receiver of each size another number."""
    sizes = {"near": (90.0, 90.0), "far": (210.0, 130.0)}
    planes = [{**WALL, "name": name, "width_mm": w, "height_mm": h} for name, (w, h) in sizes.items()]
    lamps = {"kind": "grid", "columns": 2, "rows": 3, "pitch_mm": [17.0, 23.0]}
    spec = small_spec(target=None, receivers=planes, lamps=lamps, base={"kind": "none"})
    light = evaluate_traced(TracedLens.of(bumpy(spec), 2.0), spec, build_source(spec.source), 512, 3, pixels=128)
    pixels = [receiver.pixels for receiver in light.receivers]
    assert light.pixels == 128 and len(set(pixels)) == 2 and all(abs(count - 128) < 16 for count in pixels)


def test_evenness_is_a_fact_of_the_receiver_that_has_an_even_region(light: Light, scene: tuple[Any, Spec, Any]) -> None:
    groups = light_facts(light, bumpy(scene[1]))
    for group, receiver in zip(groups, light.receivers, strict=False):
        facts = {fact.key: fact.value for fact in group.facts}
        for name in ("uniformity", "rsd"):
            measured = getattr(receiver, name)
            assert facts.get(name) == (measured and measured.value)
    assert [receiver.rsd is None for receiver in light.receivers] == [False, True]


def test_maps_count_by_their_hash_alone(light: Light, tmp_path: Path) -> None:
    """Neither those beside a record that states none, nor those in it."""
    light = light.model_copy(update={"inputs": dict.fromkeys(Light.made_from, "0" * 64)})
    light.write(tmp_path)
    assert Light.read(tmp_path) == light
    path = tmp_path / "evaluate.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    del content["arrays_sha256"]
    for maps in ((), ("map", "raw_map", "target_map")):
        for record, receiver in zip(content["receivers"], light.receivers, strict=True):
            record |= {name: getattr(receiver, name).tolist() for name in maps}
        path.write_text(json.dumps(with_checksum(content)), encoding="utf-8")
        with pytest.raises(InputError, match=r"npz: not the arrays that evaluate.json describes; run `.*` again$"):
            Light.read(tmp_path)


@pytest.mark.parametrize(
    ("given", "of_spec", "wanted"),
    [
        ({}, None, (PRESETS["draft"].evaluate_rays, 16, 5)),
        ({}, 640, (640, 16, 5)),
        ({"rays": 77, "pixels": 20, "seed": 0}, 640, (77, 20, 0)),
        ({"seed": 8}, 640, (640, 16, 8)),
    ],
)
def test_rays_pixels_and_seed_are_those_given_or_those_of_spec_and_lens(
    given, of_spec, wanted, light, monkeypatch
) -> None:
    spec = small_spec(target=None, receivers=[WALL, SKY], evaluate={"rays": of_spec, "pixels": 16})
    limit = {"kind": "points", "at_mm": [[0.0, 0.0]], "unit": "lx", "at_least": 3.0}
    lens = Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), spec.replace(limits=[limit]), 5, "draft")
    asked: list[Any] = []
    monkeypatch.setattr(
        evaluation, "evaluate_traced", lambda *positional, **named: asked.append((positional, named)) or light
    )
    monkeypatch.setattr(evaluation, "measure_preset", lambda *positional: asked.append(positional) or None)
    monkeypatch.setattr(evaluation.TracedLens, "of", lambda lens, nodes: nodes)
    source = build_source(spec.source)
    preset = PRESETS["draft"]
    result = evaluation.evaluate_lens(lens, source, preset, efficacy=Efficacy(250.0), **given)
    ((traced, *inputs, rays, seed), named), measured = asked
    assert (rays, named["pixels"], seed) == wanted and inputs == [lens.spec, source]
    assert (traced, measured) == (preset.evaluate_nodes_per_sigma, (lens, source, preset.nodes_per_sigma, traced))
    (limit_there,) = named["limits"]
    assert limit_there.readings.shape[1] == wanted[1] * round(wanted[1] * 2 / 3)
    assert result.lumens_per_watt == 250.0 and result.inputs == {"lens": lens.sha256}


def test_the_map_of_one_lens_does_not_stand_for_its_lamp_or_a_road(light: Light, scene: tuple[Any, Spec, Any]) -> None:
    """Of several lenses it is said to be of one; where a road judges the light of all, that is told instead."""
    road = {"lighting_class": "M4", "width_m": 7.0, "pole_height_m": 8.0, "pole_spacing_m": 30.0, "lamp_lm": 5e3}
    receivers = [WALL, {**SKY, "half_angle_deg": 90.0}]

    def labels(**fields: Any) -> set[str]:
        spec = small_spec(target=None, receivers=receivers, **fields)
        groups = [fact for fact in light_facts(light, bumpy(spec)) if fact.key == "light"]
        return {fact.label for group in groups for fact in group.facts if fact.key in ("level", "u0", "u1", "peak")}

    assert labels() >= {"Mean irradiance", "U0", "U1"}
    assert labels(photometry={"lenses": 12}) >= {"Mean irradiance, one lens of 12", "U0", "U1"}
    if has_addon("road"):
        assert labels(roads=[road]) == set()
