"""``lensforge compile``: each spec through all stages by few rays, and what is kept of it."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from scenes import small_spec

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.report import pipeline


def test_specs_are_run_by_few_rays_in_a_folder_that_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[lf.Spec, Path, dict[str, Any]]] = []
    monkeypatch.setattr(pipeline, "run", lambda spec, folder, **rest: asked.append((spec, folder, rest)))
    small_spec(evaluate__rays=2**20).save(tmp_path / "small.toml")
    for specs, names in ((["small.toml"], ["small"]), ([], ["quickstart", "spot"])):
        monkeypatch.chdir(tmp_path)
        done = CliRunner().invoke(cli, ["compile", *specs, "--threads", "1", "--json"])
        assert done.exit_code == 0, done.output
        assert [spec.name for spec, _, _ in asked] == names
        for spec, folder, rest in asked:
            assert spec.evaluate.rays == rest["accuracy"].evaluate_rays < 2**15
            assert rest["threads"] == 1 and not folder.parent.exists()
        told = json.loads(done.stdout)
        kernels = [file for folder in told["folders"] for file in Path(folder).glob("*.nbc")]
        assert told["kernels"] == len(kernels) and {Path(folder).name[:8] for folder in told["folders"]} == {"kernels-"}
        assert told["mib"] == pytest.approx(sum(file.stat().st_size for file in kernels) / 2**20)
        asked.clear()


def test_a_spec_that_is_wrong_is_refused_before_the_first_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "run", lambda *_, **__: pytest.fail("compiled"))
    small_spec().save(tmp_path / "small.toml")
    refused = CliRunner().invoke(cli, ["compile", str(tmp_path / "small.toml"), str(tmp_path / "none.toml")])
    assert isinstance(refused.exception, lf.InputError) and "none.toml" in str(refused.exception)


@pytest.mark.nightly("a whole run")
def test_all_stages_are_taken(tmp_path: Path) -> None:
    """Whatever becomes of the lens of a few steps."""
    small_spec().save(tmp_path / "small.toml")
    done = CliRunner().invoke(cli, ["compile", str(tmp_path / "small.toml"), "--quiet"])
    assert (done.exit_code, done.output) == (0, "")
