"""A text that is being written is refused at once where its reading would take memory or time by the square."""

import time
from pathlib import Path

import pytest

from lensforge.addons.studio.spec_text import SpecText
from lensforge.addons.studio.toml_edit import edited
from lensforge.errors import InputError
from lensforge.spec.toml_bounds import TooLarge, bounded_tables

SPEC = Path("own.toml")
_AT_ONCE_S = 2.0  # of processor time; by the square they took from ten seconds to hours


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
    hinted = [line for _, line in lines if "did you mean pixels?" in line]
    assert len(hinted) == 10 and lines[10] == ("evaluate.pixels10", "evaluate.pixels10: unknown")


def test_edits_of_a_text_keep_the_bounds() -> None:
    with pytest.raises(InputError, match="change the text"):
        edited("a." * 20_000 + "a = 1", ("name",), "x")
    with pytest.raises(TooLarge):
        bounded_tables("a." * 64 + "a = 1")
    assert SpecText.of("", SPEC).edited(("name",), {"toml": "[" * 5000}).tables == {"name": "[" * 5000}
