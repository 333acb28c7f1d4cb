"""A TOML text is refused in one line, and at once, where its reading would take memory or time by the square."""

import time
import tomllib
from pathlib import Path

import pytest

from lensforge.errors import InputError
from lensforge.live.spec_text import SpecText
from lensforge.live.toml_edit import edited
from lensforge.spec.toml_bounds import TooLarge, bounded_tables
from lensforge.spec.toml_slips import tables_of

SPEC = Path("own.toml")
_AT_ONCE_S = 2.0  # of processor time; by the square they took from ten seconds to hours


@pytest.mark.parametrize(("text", "words"), [
    ("# one\n" + "a." * 20_000 + "a = 1", "line 2: a name of 20001 parts, must be at most 64; is it a spec?"),
    ("[" + "a." * 64 + "a]", "line 1: a name of 65 parts, must be at most 64; is it a spec?"),
    ("'a'.\"b\" . " * 40 + "c = 1", "line 1: a name of 81 parts, must be at most 64; is it a spec?"),
    ("x = 'one.\n" + "a." * 64 + "a = 1", "line 2: a name of 65 parts, must be at most 64; is it a spec?"),
    ("[" * 20_000, "line 1: nested more than 64 deep, which no field is; is it a spec?"),
    ("x = " + "[\n" * 65 + "]" * 65, "line 65: nested more than 64 deep, which no field is; is it a spec?"),
    ("x = " + "{a = " * 65 + "1" + "}" * 65, "line 1: nested more than 64 deep, which no field is; is it a spec?"),
    ("levels = [" + "1," * 500_000 + "]",
     "1.0 MB beside its texts, must be at most 1 MB; rays, pictures and tables go into files of their own"),
])  # fmt: skip
def test_a_text_beyond_the_bounds_is_refused_in_one_line_at_once(text: str, words: str) -> None:
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        tables_of(text, SPEC)
    assert str(caught.value) == f"own.toml: {words}"
    assert time.process_time() - begun < _AT_ONCE_S


@pytest.mark.parametrize("text", [
    "a." * 63 + "a = 1",
    "x = " + "[" * 64 + "]" * 64,
    "x = '" + "a." * 100 + "'  # " + "b." * 100 + "[" * 100,
    "x = \"\"\"\n" + "a." * 100 + "[" * 100 + "\\\"\"\"\"",
    "x = '''\n" + "[{" * 100 + "'''",
    "x = [\n" + "[1,\n" * 3 + "1]]]]",
    f"levels = [{'0.5, ' * 1000}]",
    "packed = \"" + "A" * 2_000_000 + '"',
    "[[limits]]\n" * 100,
])  # fmt: skip
def test_a_text_within_the_bounds_is_read_as_the_standard_library_reads_it(text: str) -> None:
    assert bounded_tables(text) == tomllib.loads(text)


def test_a_bracket_that_is_not_closed_is_told_as_a_slip() -> None:
    with pytest.raises(InputError, match="write \\[lens\\]"):
        tables_of("[lens\nmaterial = 'PC'\n" * 1 + "x = [1, 2\n" * 80, SPEC)


def test_a_slip_that_is_mended_does_not_lift_the_bounds() -> None:
    """Its quotes hid what stands behind them."""
    with pytest.raises(InputError, match="line 2: a name of 65 parts"):
        tables_of('material = PMMA"""\n' + "a." * 64 + "a = 1", SPEC)


@pytest.mark.parametrize("text", [
    "[" * 900 + "\n" + "[" * 900,
    'x="' * 300_000,
    "x y " * 200_000,
    '"""' + '\\"""' * 200_000,
    "x = PMMA\n" * 100_000,
    "[[limits]]\n" * 80_000,
    "".join(f"unknown_{number} = 1\n" for number in range(50_000)),
])  # fmt: skip
def test_no_text_takes_long_to_be_refused(text: str) -> None:
    begun = time.process_time()
    assert SpecText.of(text, SPEC).lines
    assert time.process_time() - begun < 2 * _AT_ONCE_S


def test_names_like_an_unknown_one_are_told_for_the_first_ten() -> None:
    lines = SpecText.of("".join(f"evaluate.pixels{number} = 1\n" for number in range(30)), SPEC).lines
    hinted = [words for _, words in lines if "did you mean pixels?" in words]
    assert len(hinted) == 10 and lines[10] == ("evaluate.pixels10", "evaluate.pixels10: unknown")


def test_edits_of_a_text_keep_the_bounds() -> None:
    with pytest.raises(InputError, match="change the text"):
        edited("a." * 20_000 + "a = 1", ("name",), "x")
    with pytest.raises(TooLarge):
        bounded_tables("a." * 64 + "a = 1")
    assert SpecText.of("", SPEC).edited(("name",), {"toml": "[" * 5000}).tables == {"name": "[" * 5000}
