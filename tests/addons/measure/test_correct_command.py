"""``lensforge correct`` as a user meets it: the files, what is read back, and what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from measured_lenses import lens
from second_cuts import machine_error, measured

import lensforge as lf
from lensforge.addons.measure.correction import limited_by_cutter
from lensforge.cad.form_error import face_points
from lensforge.cad.patch import fit_patch
from lensforge.cad.plan import OUTER
from lensforge.cad.step import parse_step
from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.report.lens_page import render_report
from lensforge.shop.face_samples import AirSide, OpticalFace, sample_face
from lensforge.surfaces.surface import scaled

LENS = lens()


def run(*arguments: object):
    return CliRunner().invoke(cli, ["correct", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder with a correction of the inner surface."""
    directory = tmp_path_factory.mktemp("corrected")
    LENS.save(directory / "lens.json")
    points = measured(LENS.inner, lambda u: machine_error(u, 6.0, wave_mm=4.0), 1200)
    np.savetxt(directory / "points.csv", points, delimiter=",", header="x,y,z")
    done = run(directory, "--points", directory / "points.csv", "--surface", "inner", "--wavelength", 2.5)
    assert done.exit_code == 0, done.output
    (directory / "printed.txt").write_text(done.stdout, encoding="utf-8")
    return directory


def test_record_and_step_are_written_and_read_again(folder: Path) -> None:
    content = json.loads((folder / "correct_inner.json").read_text(encoding="utf-8"))
    made = lf.load(folder).of_faces(lf.Correction)["inner"]
    assert made.wavelength_mm == content["wavelength_mm"] == 2.5
    printed = (folder / "printed.txt").read_text("utf-8")
    assert printed.startswith("The inner face, corrected for a second cut\n")
    assert f"{content['correction_um']['rms']:.3g}" in printed
    assert (folder / "lens_corrected_inner.step").read_bytes() == made.step
    assert made.products()[".step"] == made.step
    assert made.expected_um.rms < 0.3 * made.deviation_um.rms
    made.save(folder / "again.step")
    assert (folder / "again.step").read_bytes() == made.step


def test_the_page_shows_it(folder: Path, undrawn: None) -> None:
    page = render_report(lf.load(folder), folder)
    assert "The inner face, corrected for a second cut" in page
    assert "lens_corrected_inner.step" in page and "longer waves pass; given" in page.replace("\u202f", " ")


@pytest.mark.nightly("two seconds; by day other conditions of the light")
def test_other_rays_have_files_of_their_own(folder: Path) -> None:
    done = run(folder, "--points", folder / "points.csv", "--surface", "inner", "--wavelength", 3.0, "--rays", 64)
    assert done.exit_code == 0, done.output
    assert {"correct_inner_64rays.json", "lens_corrected_inner_64rays.step"} <= {path.name for path in folder.iterdir()}
    assert "lens_corrected_inner_64rays.step" in done.stdout and "lens_corrected_inner.step" not in done.stdout
    assert lf.load(folder).of_faces(lf.Correction)["inner"].wavelength_mm == 2.5


def test_another_step_is_refused(folder: Path) -> None:
    path = folder / "lens_corrected_inner.step"
    before = path.read_bytes()
    path.write_bytes(before.replace(b"corrected inner", b"corrected outer"))
    try:
        with pytest.raises(InputError, match=r"correct_inner\.json: not the result whose hash run\.json states"):
            lf.load(folder)
    finally:
        path.write_bytes(before)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--surface", "inner"], "--points"),
        (["--points", "points.csv"], "--surface"),
        (["--points", "points.csv", "--surface", "inner", "--gain", "-1"], "gain = -1: must be above 0"),
        (["--points", "points.csv", "--surface", "inner", "--wavelength", "0"], "0.0 is not in the range"),
    ],
)
def test_bad_input_is_said_in_a_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], message: str
) -> None:
    monkeypatch.chdir(folder)
    done = run(folder, *options)
    assert done.exit_code != 0
    assert message in done.output + str(done.exception)


def test_an_insert_is_judged_as_large_as_it_is_cut_and_its_file_is_signed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mould of a lens that shrinks by 5 %: its radii are those of the scaled face, the file is that of the lens."""
    shop = {"process": "moulded", "shrinkage": 0.05, "author": "Ada", "date": "2026-01-31", "form_tolerance_um": 5.0}
    mould = replace(LENS, spec=LENS.spec.replace({"manufacture": shop}))
    np.savetxt(tmp_path / "points.csv", measured(LENS.outer, lambda u: machine_error(u, 13.0, wave_mm=6.0), 1200))
    balls = []

    def limited(*given):
        balls.append(given[-1])
        return limited_by_cutter(*given)

    monkeypatch.setattr("lensforge.addons.measure.correction.limited_by_cutter", limited)
    made = lf.correct(mould, points=tmp_path / "points.csv", surface="outer", wavelength_mm=4.0, rays=64)
    assert balls == [mould.spec.manufacture.cutter_radius_mm / 1.05], "the ball on the face as large as the lens"
    cut = OpticalFace(fit_patch(scaled(LENS.outer, 1.05)), AirSide.INSIDE)
    assert made.scale == 1.05
    assert made.cutter.concave_radius_before_mm == pytest.approx(-1.0 / sample_face(cut, 161).lowest_curvature(), 1e-3)
    assert made.step_schema == "AP242" and made.step_volume_change <= 1e-9
    assert b"'Ada'" in made.step and b"2026-01-31" in made.step and b"SURFACE_PROFILE_TOLERANCE" in made.step
    top, _ = face_points(parse_step(made.step).faces[OUTER], np.zeros((1, 2)))
    assert top[0, 2] == pytest.approx(LENS.outer.radius(np.array([[0.0, 0.0, 1.0]]))[0], abs=0.05)
