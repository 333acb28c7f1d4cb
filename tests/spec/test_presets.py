"""Presets of a script's own: what a lens keeps of them, what its stages take, and what is refused."""

import json
from pathlib import Path
from typing import Any

import pytest
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.report.stored import RunRecord
from lensforge.scene.lens import load_lens
from lensforge.spec.accuracy import PRESETS, Preset, accuracy_of, for_preview, preset_of

OWN = FEW.replace(
    "own",
    evaluate_rays=2**11,
    photometry_rays=(2**12, 2**12),
    nodes_per_sigma=1.5,
    evaluate_nodes_per_sigma=2.0,
    studies={"sensitivity_rays": 320, "compared_rays": 2**10},
)


def lens_of(accuracy: Any) -> lf.Lens:
    surfaces = (random_surface(seed, 3.0 * seed, 0.01, (9, 25)) for seed in (1, 2))
    return lf.Lens.double(*surfaces, small_spec(evaluate={}), 0, accuracy)


def test_every_stage_takes_the_preset_that_the_lens_keeps(tmp_path: Path) -> None:
    lens_of(OWN).save(tmp_path / "lens.json")
    lens = load_lens(tmp_path / "lens.json")
    assert lens == lens_of(OWN) and lens.accuracy == OWN and preset_of(lens.accuracy) is not OWN
    light, changes = lf.evaluate(lens), lf.sensitivity(lens)
    assert (light.rays, light.conditions, light.preset_error) == (2**11, None, None)
    finer = lf.evaluate(lens, accuracy=OWN.replace("own", evaluate_nodes_per_sigma=4.0))
    assert light.table_nodes < 0.6 * finer.table_nodes
    assert (changes.rays, changes.conditions) == (320, None)
    assert lf.photometry(lens).rays == 2**12
    part = lf.build(lens)
    assert part.triangulation.rings == 24
    assert len(lf.check(part).chart_axis) == 61


def test_other_settings_are_other_conditions_under_any_name() -> None:
    lens = lens_of(OWN)
    other = OWN.replace("own", evaluate_rays=2**10)
    assert lf.evaluate(lens, accuracy=OWN.replace("own", verify_rays=OWN.verify_rays)).conditions is None
    conditions = lf.evaluate(lens, accuracy=other).conditions
    assert conditions is not None and conditions.accuracy == str(other) != str(OWN)
    assert str(other).startswith("own_") and conditions.name.startswith(str(other))
    assert lens_of(OWN) != lens_of(other) and lens_of(OWN).sha256 != lens_of(other).sha256


def test_a_preset_of_the_table_is_its_name(tmp_path: Path) -> None:
    for name, preset in PRESETS.items():
        assert (str(preset), accuracy_of(preset), preset_of(name)) == (name, name, preset)
        lens_of(preset).save(tmp_path / "lens.json")
        assert load_lens(tmp_path / "lens.json").accuracy == name and lens_of(preset) == lens_of(name)
    assert for_preview(PRESETS["draft"]).effort.steps == (25, 50)


def test_a_run_states_all_settings_of_its_preset(small_run: lf.Run) -> None:
    stated = RunRecord.read(small_run.folder)
    assert stated is not None and stated.accuracy == small_run.lens.accuracy
    assert isinstance(stated.accuracy, Preset) and stated.accuracy.name not in PRESETS


STATED = OWN.model_dump(mode="json")
STATED_WRONGLY: dict[str, tuple[Any, str]] = {
    "an unknown name": ("fine", "accuracy = 'fine': must be 'draft', 'standard' or 'reference'"),
    "no text": (3, "accuracy = 3: "),
    "a name alone": ({"name": "own"}, r"accuracy\.nodes_per_sigma: Field required"),
    "another setting": ({**STATED, "rays": 5}, r"accuracy\.rays = 5: "),
    "no rays": ({**STATED, "evaluate_rays": 0}, r"accuracy\.evaluate_rays = 0: .* at least 1"),
    "a name of the table": ({**STATED, "name": "draft"}, "name = 'draft': that of a preset of the program"),
    "text within": ({**STATED, "studies": {"worst_rays": "9"}}, r"accuracy\.studies\.worst_rays = '9': "),
}


@pytest.mark.parametrize("case", STATED_WRONGLY)
def test_no_accuracy_that_is_not_whole_is_read(case: str, tmp_path: Path) -> None:
    stated, message = STATED_WRONGLY[case]
    (tmp_path / "lens.json").write_text(json.dumps({**lens_of(OWN).to_json(), "accuracy": stated}), encoding="utf-8")
    with pytest.raises(lf.InputError, match=message) as error:
        load_lens(tmp_path / "lens.json")
    assert "\n" not in str(error.value) and "lens.json: accuracy" in str(error.value)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: OWN.replace("draft"), "preset 'draft': name = 'draft': that of a preset of the program"),
        (lambda: OWN.replace("a/b"), "preset 'a/b': name = 'a/b': "),
        (lambda: OWN.replace("b", part={"rings": 4}), r"preset 'b': part\.rings: unknown; known here: spline_nodes"),
        (lambda: lf.design(small_spec(), accuracy="fine"), "accuracy = 'fine': one of draft, standard, reference, or"),
        (
            lambda: lf.evaluate(lens_of(OWN), accuracy=PRESETS["draft"].model_copy(update={"evaluate_rays": 3})),
            "accuracy: name = 'draft': that of a preset of the program with other settings; take another",
        ),
    ],
)
def test_a_preset_with_what_it_cannot_have_is_refused_in_one_line(made: Any, message: str) -> None:
    with pytest.raises(lf.InputError, match=message):
        made()
