"""What is refused is refused in one line."""

from collections.abc import Callable

import lensforge as lf


def require_line(read: Callable[[], object], case: str) -> bool:
    """True if ``read`` accepts the case; False if it refuses it in one line, or a spec in a line for each field."""
    try:
        read()
    except lf.InputError as error:
        lines = str(error).splitlines()
    else:
        return True
    assert all(line.isprintable() and len(line) < 1000 for line in lines), (case, lines)
    assert len(lines) == 1 or (lines and case.startswith("spec")), (case, lines)
    return False
