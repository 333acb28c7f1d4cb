"""Folders stored before the program had all the fields it has now are read as they are."""

import json
from pathlib import Path

import pytest

import lensforge as lf
from lensforge.light.photometry_result import Photometry
from lensforge.results.stage_result import with_checksum
from lensforge.scene.lens import Lens

NEWEST_TABLE = "routes"  # of applications, which folders stored before it do not have


@pytest.fixture
def before(small_run: lf.Run, tmp_path: Path) -> Path:
    """The file of the lens of a small run, as a version without the newest table has written it."""
    content = json.loads((small_run.folder / "lens.json").read_text(encoding="utf-8"))
    del content["spec"][NEWEST_TABLE]
    path = tmp_path / "lens.json"
    path.write_text(json.dumps(with_checksum(content)), encoding="utf-8")
    return path


def test_a_lens_stored_without_a_new_field_keeps_the_hash_that_its_results_name(
    small_run: lf.Run, before: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lens = lf.load_lens(before)
    assert lens == small_run.lens

    def as_before(self: Lens) -> dict[str, object]:
        content = whole(self)
        return {**content, "spec": {name: value for name, value in content["spec"].items() if name != NEWEST_TABLE}}

    whole = Lens.to_json
    stated = lf.load_lens(small_run.folder / "lens.json").sha256
    monkeypatch.setattr(Lens, "to_json", as_before)
    designed = Lens(small_run.lens.surfaces, small_run.lens.spec, lens.seed, lens.accuracy, lens.version)
    assert lens.sha256 == designed.sha256 != stated


def test_another_spec_of_a_lens_that_was_read_has_another_hash(before: Path) -> None:
    from dataclasses import replace

    lens = lf.load_lens(before)
    changed = replace(lens, spec=lens.spec.replace({"evaluate.rays": 4097}))
    assert changed.sha256 != lens.sha256 and replace(lens).sha256 == replace(changed, spec=lens.spec).sha256


def test_photometry_leaves_out_a_new_table_where_it_is_empty(whole_run: lf.Run) -> None:
    stored = json.loads((whole_run.folder / "photometry.json").read_text(encoding="utf-8"))
    assert NEWEST_TABLE in Photometry.model_fields and NEWEST_TABLE not in stored
    assert {"offices", "roads", "sports"} <= set(stored), "as in all folders before"
