"""The line of a refusal."""

import pytest

import lensforge as lf


def one_line(caught: pytest.ExceptionInfo[lf.InputError]) -> str:
    """The line of an error that was expected."""
    line = str(caught.value)
    assert line.isprintable() and len(line) < 1000, line
    return line
