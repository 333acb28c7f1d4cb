"""A TOML text is refused in one line, and at once, where its reading would take memory or time by the square."""

import time
import tomllib
from pathlib import Path

import pytest

from lensforge.errors import InputError
from lensforge.spec.toml_bounds import bounded_tables
from lensforge.spec.toml_slips import tables_of

SPEC = Path("own.toml")
_AT_ONCE_S = 2.0  # of processor time; by the square they took from ten seconds to hours


@pytest.mark.parametrize(("text", "message"), [
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
def test_a_text_beyond_the_bounds_is_refused_in_one_line_at_once(text: str, message: str) -> None:
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        tables_of(text, SPEC)
    assert str(caught.value) == f"own.toml: {message}"
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
