"""Slips on the command line and in a script: the line says what was meant."""

from pathlib import Path

import pytest
from in_this_process import lensforge
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.search.scene_check import angles_that_may_be_radians

NEW = ("new", "--source", "square:1", "--target")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*NEW, "rectangle:200x150@300", "--max-radius", "10,5"), "'10,5': a number has a decimal point; write 10.5"),
        ((*NEW, "rectangle:200,5x150@300"), "a number has a decimal point; write 200.5x150"),
        ((*NEW, "beam:10,5"), "a number has a decimal point; write 10.5"),
        ((*NEW, "disc:20@300,25"), "a number has a decimal point; write 300.25"),
        ((*NEW, "rectangle:20xa@300"), "'20xa' must be WIDTHxHEIGHT in mm, above 0, such as 200x150"),
        (("evaluate", "x", "--temperature", "85,5"), "'85,5': a number has a decimal point; write 85.5"),
        (("handover", "x", "--spacing", "0,5"), "'0,5': a number has a decimal point; write 0.5"),
        (("evaluate", "x", "--rays", "1,000"), "'1,000' is no number; write it without a comma"),
    ],
)
def test_a_decimal_comma_is_named(arguments: tuple[str, ...], message: str) -> None:
    code, _, errors = lensforge(*arguments)
    assert code == 2 and message in errors


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"ISO-10303-21;\nHEADER;\n", "a STEP file"), (b"solid lens\n", "an STL"),
        (b'{"a": 1}', "a record in JSON"), (b"<!DOCTYPE html>", "a page"),
        (b"IESNA:LM-63-2002\n", "photometry of LM-63"), (b"\x89PNG\r\n", "a picture"), (b"%PDF-1.7", "a PDF"),
    ],
)  # fmt: skip
def test_another_kind_of_file_in_the_place_of_a_spec_is_named(content: bytes, kind: str, tmp_path: Path) -> None:
    (tmp_path / "lens.step").write_bytes(content)
    code, _, errors = lensforge("design", tmp_path / "lens.step")
    assert code == 2 and f"this is {kind}" in errors and "give the spec" in errors


def test_a_suffix_of_several_formats_names_the_option(tmp_path: Path) -> None:
    rows = "x_mm,y_mm,z_mm,kx,ky,kz,flux_lm\n0,0,0,0,0,1,1\n"
    (tmp_path / "led.csv").write_text(rows, encoding="utf-8")
    code, _, errors = lensforge("rays", tmp_path / "led.csv", "--to", tmp_path / "own.ray")
    assert code == 2 and "choose by --format lighttools_binary" in errors


def test_the_table_of_a_ray_file_has_words(tmp_path: Path) -> None:
    rows = "x_mm,y_mm,z_mm,kx,ky,kz,flux_lm\n0,0,0,0,0,1,1.5\n1,0,0,0,0,0,1\n0,0,0,0,0,1,0\n"
    (tmp_path / "led.csv").write_text(rows, encoding="utf-8")
    code, screen, _ = lensforge("rays", tmp_path / "led.csv")
    lines = {line[:26].strip(): line[26:].strip() for line in screen.splitlines()}
    assert code == 0
    assert (lines["rays in the file"], lines["rays used"]) == ("3", "1")
    assert (lines["left out: no direction"], lines["left out: no flux"]) == ("1", "1")
    assert (lines["flux of the source"], lines["which is taken from"]) == ("1.5 lm", "rays")
    assert not any("_" in name or "zero direction" in name for name in lines)


@pytest.mark.parametrize(
    ("name", "meant"), [("Desing", "Design"), ("squaresource", "SquareSource"), ("lod_spec", "load_spec"), ("zzz", "")]
)
def test_a_name_that_the_library_has_not_is_told_which_was_meant(name: str, meant: str) -> None:
    with pytest.raises(AttributeError, match=f"no attribute '{name}'" + (f"; did you mean {meant}" if meant else "$")):
        getattr(lf, name)


def test_a_keyword_that_a_verb_has_not_is_told_which_was_meant() -> None:
    calls = {
        "design: acuracy: unknown; did you mean accuracy": lambda: lf.design(small_spec(), acuracy="draft"),  # type: ignore[call-arg]
        "run: acuracy: unknown; did you mean accuracy": lambda: lf.run(small_spec(), "x", acuracy="draft"),  # type: ignore[call-arg]
        "evaluate: zzz: unknown; known here: lens, ": lambda: lf.evaluate(None, zzz=1),  # type: ignore[call-arg,arg-type]
    }
    for message, call in calls.items():
        with pytest.raises(InputError, match=message) as caught:
            call()
        assert isinstance(caught.value, TypeError)


@pytest.mark.parametrize(("fwhm_deg", "told"), [(0.17, "9.74"), (1.57, "89.95"), (1.6, "")])
def test_degrees_that_may_be_radians_are_told(fwhm_deg: float, told: str) -> None:
    message = " ".join(angles_that_may_be_radians(small_spec(target={"kind": "beam", "fwhm_deg": fwhm_deg})))
    assert message == (f"fwhm_deg = {fwhm_deg:g}: angles are in degrees, {fwhm_deg:g} rad are {told}" if told else "")
    assert not list(angles_that_may_be_radians(small_spec()))
