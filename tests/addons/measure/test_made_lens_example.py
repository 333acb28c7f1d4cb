"""The example of a made lens: what its photographs tell is the hidden truth, and so is the face that is cut again."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hidden_errors import FOLDER, FORMS, HIDDEN, LED_MM, polynomials
from second_cuts import CutAgain, cosine

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.surfaces.srbf import fibonacci_hemisphere

U = fibonacci_hemisphere(3000)


def pulls_of(made: lf.Inference) -> np.ndarray:
    """What is wrong in the errors, over their standard errors."""
    wrong = [(error.value.value - HIDDEN.get(error.name, 0.0)) / error.value.standard_error for error in made.errors]
    return np.array(wrong)


def test_few_of_its_photographs_tell_of_its_hidden_errors(tmp_path: Path) -> None:
    """Corners are found, and an LED that is out of place is seen by few rays, too."""
    lens = lf.design(lf.load_spec(FOLDER.with_suffix(".toml")), accuracy="draft").lens
    taken = (0, 1, 3)
    np.testing.assert_array_equal(np.loadtxt(FOLDER / "poses.csv", delimiter=",", skiprows=1), LED_MM)
    np.savetxt(tmp_path / "poses.csv", LED_MM[[*taken]], delimiter=",")
    pictures = [FOLDER / f"led_{number}.png" for number in taken]
    files = {"pictures": pictures, "poses": tmp_path / "poses.csv", "off": FOLDER / "off.png"}
    made = lf.infer(lens, **files, rays=2**15, pixels=40)
    pulls = pulls_of(made)
    assert np.abs(pulls).max() < 3.5 and 0.3 < np.sqrt(np.mean(pulls**2)) < 1.5, pulls
    by_name = {error.name: error.value for error in made.errors}
    assert all(by_name[name].value > 0.0 for name in ("LED x", "LED y", "decentre x"))
    assert {"gap", "index"} < {*made.not_seen} and "LED x" not in made.not_seen


@pytest.mark.nightly("a minute and a half of processor time")
def test_its_commands_lead_to_a_better_second_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the page on the proof has them."""
    monkeypatch.chdir(tmp_path)
    pictures = [f"--pictures made_lens/led_{number}.png" for number in range(len(LED_MM))]
    of_led = "--poses made_lens/poses.csv --off made_lens/off.png --rays 262144"
    for command in (
        "examples made_lens",
        "design made_lens.toml --accuracy draft",
        f"infer cad_out/made_lens {' '.join(pictures)} {of_led}",
        "correct cad_out/made_lens --inferred cad_out/made_lens/infer.json --surface outer",
    ):
        done = CliRunner().invoke(cli, command.split())
        assert done.exit_code == 0, done.output
    run = lf.load("cad_out/made_lens")
    pulls = pulls_of(run.find(lf.Inference))
    assert np.abs(pulls).max() < 3.5 and 0.4 < np.sqrt(np.mean(pulls**2)) < 1.5, pulls
    made = run.of_faces(lf.Correction)["outer"]
    outer = run.lens.outer

    def hidden_mm(u: np.ndarray) -> np.ndarray:
        along_um = sum(HIDDEN.get(f"outer {form}", 0.0) * polynomials(u)[form] for form in FORMS)
        return 1e-3 * along_um / cosine(outer, u)

    areas = outer.radius(U) ** 2 / cosine(outer, U)
    left_um = 1e3 * CutAgain(made.step, "outer", outer, hidden_mm).along_normals(U)
    left = np.sqrt(np.average(left_um**2, weights=areas))
    before = np.sqrt(np.average((1e3 * hidden_mm(U) * cosine(outer, U)) ** 2, weights=areas))
    assert left < 1.6 * made.expected_um.rms and left < 0.5 * before, (left, made.expected_um.rms, before)
    assert made.inferred.left == () and made.inputs["infer"] == run.find(lf.Inference).sha256
