"""A command in this process, which has torch and the CAD kernel loaded already."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from typing import NamedTuple

from lensforge.cli.cli import main


class Ended(NamedTuple):
    """Exit code, stdout and stderr of a command."""

    code: int
    stdout: str
    stderr: str


def lensforge(*arguments: object) -> Ended:
    """Run ``lensforge`` with ``arguments``."""
    output, errors, code = StringIO(), StringIO(), 0
    with redirect_stdout(output), redirect_stderr(errors):
        try:
            main(arguments=[*map(str, arguments)])
        except SystemExit as end:
            code = int(end.code or 0)
    return Ended(code, output.getvalue(), errors.getvalue())
