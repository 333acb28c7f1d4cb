"""Slips of the hand in a TOML file: each is named with its line, its place and the line as it was meant."""

import tomllib
from pathlib import Path

import pytest

from lensforge.errors import InputError, WrongFields
from lensforge.spec import load_spec
from lensforge.spec.toml_slips import tables_of

SPEC = Path("own.toml")
# A line as it was typed, and as it was meant.
SLIPS = [
    ("material = PMMA", 'material = "PMMA"'),
    ('material = PMMA"', 'material = "PMMA"'),
    ('material = "PMMA', 'material = "PMMA"'),
    ("material = “PMMA”", 'material = "PMMA"'),
    ('material: "PMMA"', 'material = "PMMA"'),
    ('material "PMMA"', 'material = "PMMA"'),
    ("material := PC  # clear", 'material = "PC"'),
    ("width_mm = 100,5", "width_mm = 100.5"),
    ("width_mm = -,5", "width_mm = -0.5"),
    ("width_mm = 1.234,5", "width_mm = 1234.5"),
    ("width_mm = 1,234.5", "width_mm = 1234.5"),
    ("width_mm = 1'200", "width_mm = 1200"),
    ("width_mm = 007.50", "width_mm = 7.50"),
    ("width_mm = 5.", "width_mm = 5.0"),
    ("width_mm = 100 mm", "width_mm = 100"),
    ("width_mm = 2,5mm  # wide", "width_mm = 2.5"),
    ("tilt_deg = 10°", "tilt_deg = 10"),
    ("date = 27.11.2026", "date = 2026-11-27"),
    ("date = 11/27/2026", "date = 2026-11-27"),
    ("date = 2026/1/9", "date = 2026-01-09"),
    (r'file = "C:\rays\led.ray"', r"file = 'C:\rays\led.ray'"),
    (r"file = C:\rays\led.ray", r"file = 'C:\rays\led.ray'"),
    ("file = leds/own led.ray", 'file = "leds/own led.ray"'),
    ("required = True", "required = true"),
    ("required = no", "required = false"),
    ("side_mm = 1.5;", "side_mm = 1.5"),
    ('kind = "disc",', 'kind = "disc"'),
    ("side_mm = 1.5 // wide", "side_mm = 1.5 # wide"),
    ("max radius-mm = 10", "max_radius_mm = 10"),
    ("levels = [50; 100]", "levels = [50, 100]"),
    ("pitch_mm = [1,5; 2,5]", "pitch_mm = [1.5, 2.5]"),
    ("levels = (50, 100)", "levels = [50, 100]"),
    ("levels = 50, 100, 200", "levels = [50, 100, 200]"),
    ("names = [left, right]", 'names = ["left", "right"]'),
    ("[lens", "[lens]"),
    ("[lens]]", "[lens]"),
    ("[[limits]", "[[limits]]"),
    ("// a word", "# a word"),
]


def refused(text: str) -> WrongFields:
    with pytest.raises(WrongFields) as caught:
        tables_of(text, SPEC)
    return caught.value


@pytest.mark.parametrize(("typed", "meant"), SLIPS)
def test_a_slip_is_told_with_the_line_as_it_was_meant(typed: str, meant: str) -> None:
    error = refused(f"# two lines\nseed_of = 7\n{typed}\n")
    assert len(error.lines) == 1
    assert error.lines[0].startswith("own.toml: line 3, column ")
    written = error.lines[0].rpartition("; write ")[2]
    assert tomllib.loads(written) == tomllib.loads(meant)


@pytest.mark.parametrize(("typed", "phrase"), [
    ("side_mm =", "its value is missing"),
    ("side_mm = none", "a field without a value is left out"),
    ("width_mm = 10 cm", "width_mm is in mm; write the number of mm, without a unit"),
    ("width_mm = 1,200", "write 1200, or 1.200"),
    ("date = 3/4/2026", "write 2026-03-04 or 2026-04-03"),
    ("side_mm = 1/2", "not readable as TOML (expected newline or end of document after a statement)"),
])  # fmt: skip
def test_what_can_be_meant_in_two_ways_is_not_decided(typed: str, phrase: str) -> None:
    assert refused(f"\n{typed}\n").lines[0].endswith(phrase)


def test_all_slips_are_named_at_once_each_with_its_place_beneath() -> None:
    error = refused("[lens]\n  material = PMMA\n[target]\nwidth_mm = 100,5\nwidth_mm = 6\n[lens]\n")
    assert error.lines == (
        'own.toml: line 2, column 14: text needs quotes; write material = "PMMA"',
        "own.toml: line 4, column 15: a number has a decimal point, and no other marks; write width_mm = 100.5",
        "own.toml: line 5, column 1: width_mm stands in line 4, too; keep one",
        "own.toml: line 6, column 1: [lens] stands in line 1, too; keep one",
    )
    assert error.beneath[0] == "    material = PMMA\n               ^"
    assert error.beneath[1] == "  width_mm = 100,5\n                ^"
    assert error.__notes__ == ["\n".join(error.beneath)]


def test_a_long_line_is_shown_around_its_place() -> None:
    line = f"names = [{', '.join(f'{k}.5' for k in range(80))}, x]"
    text, caret = refused(line).beneath[0].splitlines()
    assert len(text) <= 102 and text[caret.index("^")] == "x"


def test_the_content_of_a_file_that_is_no_spec_is_not_shown() -> None:
    with pytest.raises(WrongFields) as caught:
        tables_of("root:x:0:0\n", Path("/etc/passwd"))
    assert caught.value.beneath == ()


def test_line_ends_of_an_old_macintosh_are_read() -> None:
    assert tables_of("[lens]\rmaterial = 'PC'\r", SPEC) == {"lens": {"material": "PC"}}


def test_a_number_in_quotes_is_cured_as_well(tmp_path: Path) -> None:
    spec = tmp_path / "own.toml"
    spec.write_text('constraints.max_radius_mm = "10 mm"\n[source]\nkind = "rayfile"\nfile = "C:\\temp\\new.ray"\n')
    with pytest.raises(InputError) as caught:
        load_spec(spec)
    assert "must be a number; a number stands without its unit; write 10\n" in f"{caught.value}\n"
    assert r"in double quotes \t and \n are none of a path: write / or single quotes" in str(caught.value)
