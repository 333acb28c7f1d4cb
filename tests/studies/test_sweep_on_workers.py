"""A sweep on the workers of a cluster: their files, in whatever order they come, make the sweep that is made here."""

import json

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.report import sweep_runs
from lensforge.report.sweep import Sweep
from lensforge.report.sweep_runs import run_sweep
from lensforge.report.variation import parse_variation

pytestmark = pytest.mark.usefixtures("undrawn")

SPEC = small_spec(optimise={"steps_per_level": [2, 2], "rays": 256, "pixels": 16}, base={"kind": "none"})
SETTINGS = {"accuracy": "draft", "seed": 3}
VALUES = parse_variation("constraints.max_radius_mm=7,8", ())


def _design_only(spec, folder, *, accuracy, seed, warn=None):
    design = lf.design(spec, accuracy=accuracy, seed=seed, warn=lambda _: None)
    folder.mkdir(parents=True, exist_ok=True)
    design.lens.save(folder / "lens.json")
    design.write(folder)
    lf.evaluate(design.lens).write(folder)
    (folder / ".lensforge.lock").write_text("stays at the worker")


def _without_times(sweep: Sweep) -> dict:
    content = sweep.plain()
    for row in content["designs"]:
        row.pop("seconds", None)
    return content


@pytest.mark.nightly("four seconds; by day searches on workers")
def test_the_files_of_the_workers_make_the_same_sweep(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("lensforge.report.pipeline.run", _design_only)
    here = run_sweep(
        SPEC, VALUES, tmp_path / "here", lambda spec, folder, _: _design_only(spec, folder, **SETTINGS), **SETTINGS
    )
    asked = []

    def backwards(specs, options, scheduler):
        asked.append((len(specs), options["accuracy"], options["seed"], scheduler))
        for number in reversed(range(len(specs))):
            yield number, sweep_runs.files_of_run(options, specs[number])

    monkeypatch.setattr(sweep_runs, "runs_on_workers", backwards)
    never = pytest.fail
    there = run_sweep(SPEC, VALUES, tmp_path / "there", never, **SETTINGS, scheduler="tcp://host:8786")
    assert asked == [(2, "draft", 3, "tcp://host:8786")]
    assert _without_times(there) == _without_times(here)
    for row in there.designs:
        names = {path.name for path in (tmp_path / "there" / row.folder).iterdir()}
        assert "lens.json" in names
        assert ".lensforge.lock" not in names
    again = run_sweep(SPEC, VALUES, tmp_path / "there", never, **SETTINGS, scheduler="tcp://host:8786", resume=True)
    assert asked[1:] in ([], [(0, "draft", 3, "tcp://host:8786")])
    assert again == there


@pytest.mark.nightly("processes that each load everything, and two whole runs")
def test_a_real_cluster_makes_the_same_lenses(tmp_path) -> None:
    there = run_sweep(SPEC, VALUES, tmp_path, pytest.fail, **SETTINGS, scheduler="local:2")
    for row in there.designs:
        record = json.loads((tmp_path / row.folder / "lens.json").read_text(encoding="utf-8"))
        spec = next(variant.spec for variant in VALUES.variants(SPEC) if variant.spec.name == row.folder)
        own = lf.design(spec, **SETTINGS, warn=lambda _: None)
        assert record["faces"]["inner"] == own.lens.to_json()["faces"]["inner"]
        assert (tmp_path / row.folder / "report.html").exists()


def test_an_address_that_is_none_is_one_line(tmp_path) -> None:
    with pytest.raises(lf.InputError, match="address of a Dask scheduler") as error:
        run_sweep(SPEC, VALUES, tmp_path, pytest.fail, **SETTINGS, scheduler="nowhere")
    assert "\n" not in str(error.value)
