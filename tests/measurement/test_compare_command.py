"""``lensforge compare`` as a user meets it."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from measured_lenses import lens, probed
from PIL import Image

from lensforge.cli import cli
from lensforge.errors import CriterionMissed, InputError
from lensforge.pipeline import run_evaluate

LENS = lens()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("measured")
    LENS.save(directory / "lens.json")
    run_evaluate(directory)
    return directory


def run(*arguments: object):
    return CliRunner().invoke(cli, ["compare", *map(str, arguments)])


def test_a_photograph_of_the_simulated_light_is_found_alike(folder: Path) -> None:
    with np.load(folder / "evaluate.npz") as stored:
        light = stored["map"]
    # The camera looks straight at the target: 8 of its pixels for each of the simulation, row 0 on top.
    seen = np.kron(light[::-1] / light.max(), np.ones((8, 8)))
    Image.fromarray(np.round(60000 * np.pad(seen, 10)).astype(np.uint16)).save(folder / "on.png")
    low, high = 9.5, 9.5 + 8 * len(light)
    done = run(
        folder,
        "--on",
        folder / "on.png",
        "--corners",
        f"{low},{low}",
        f"{high},{low}",
        f"{high},{high}",
        f"{low},{high}",
    )
    assert done.exit_code == 0, done.output
    content = json.loads((folder / "compare.json").read_text(encoding="utf-8"))
    assert f"ssim\t{content['ssim']}" in done.output
    assert content["ssim"] > 0.995
    assert np.abs(content["displacement_mm"]).max() < 1.0


def test_measured_points_are_compared(folder: Path) -> None:
    np.savetxt(folder / "cloud.csv", probed(LENS.inner, 4000, noise_mm=0.0005), delimiter=",", header="x,y,z")
    done = run(folder, "--points", folder / "cloud.csv", "--surface", "inner", "--rays", 8192)
    assert done.exit_code == 0, done.output
    content = json.loads((folder / "compare_inner_8192rays.json").read_text(encoding="utf-8"))
    assert content["rays"] == 8192
    assert content["residual_rms_um"] == pytest.approx(0.5, rel=0.1)
    assert content["form_deviation_um"]["pv"] < 1.5


def test_a_part_of_the_surface_fails_its_criterion(folder: Path) -> None:
    cloud = probed(LENS.inner, 3000)
    np.savetxt(folder / "half.csv", cloud[cloud[:, 0] > 0.0], delimiter=",")
    done = run(folder, "--points", folder / "half.csv", "--surface", "inner", "--rays", 1024, "--registration", "none")
    assert isinstance(done.exception, CriterionMissed)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "--on PHOTO"),
        (["--on", "a.png", "--points", "b.csv"], "--on PHOTO"),
        (["--on", "a.png"], "a.png: no such file"),
        (["--points", "b.csv"], "--surface"),
        (["--points", "b.csv", "--surface", "outer"], "no such file"),
    ],
)
def test_what_is_missing_is_said_in_a_line(folder: Path, options: list[str], message: str) -> None:
    done = run(folder, *options)
    assert isinstance(done.exception, InputError)
    assert message in str(done.exception)


def test_a_corner_is_two_numbers(folder: Path) -> None:
    done = run(folder, "--on", "a.png", "--corners", "1,2", "3", "5,6", "7,8")
    assert done.exit_code == 2
    assert "column,row" in done.output
