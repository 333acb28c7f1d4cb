"""The command line. Exit code 0: done; 1: a criterion missed; 2: bad input. Only this module exits.

A command imports heavy libraries when it runs, so that ``--help`` answers at once and only CAD commands load CAD.
"""

import sys
import tempfile
import traceback

import click

from lensforge.commands.design import design
from lensforge.commands.part import compare, handover, photometry, sensitivity
from lensforge.commands.rays import rays
from lensforge.commands.stages import check, evaluate, export, report, verify
from lensforge.commands.studies import sweep, tradeoff
from lensforge.errors import LensforgeError
from lensforge.version import __version__


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="%(version)s")
def cli() -> None:
    """Turn an LED and a target light pattern into a lens that a machine shop can cut."""


for command in (
    design, evaluate, export, check, verify, report, rays, tradeoff, sweep, sensitivity, photometry, handover, compare,
):  # fmt: skip
    cli.add_command(command)


def main() -> None:
    """Entry point: every exit has a code and at most one line on stderr."""
    try:
        cli.main(prog_name="lensforge", standalone_mode=False)
    except LensforgeError as error:
        _exit_with(str(error), error.exit_code)
    except click.ClickException as error:
        _exit_with(f"{error.format_message()}; see --help", 2)
    except (click.Abort, KeyboardInterrupt):
        _exit_with(_interrupted(), 130)
    except BrokenPipeError:
        sys.exit(0)
    except MemoryError:
        _exit_with("out of memory; use fewer --rays or a lower --accuracy", 1)
    except Exception as error:  # a bug: the user gets a line, the developer the details
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", prefix="lensforge-", suffix=".log", delete=False
        ) as log:
            traceback.print_exc(file=log)
        _exit_with(f"internal error: {type(error).__name__}: {error}; details for a bug report: {log.name}", 1)


def _interrupted() -> str:
    """Words for an interrupt: some commands can be resumed."""
    command = cli.commands.get(next((word for word in sys.argv[1:] if not word.startswith("-")), ""))
    if command is None or all(parameter.name != "resume" for parameter in command.params):
        return "interrupted"
    return "interrupted; the same command with --resume continues from the last checkpoint"


def _exit_with(message: str, code: int) -> None:
    click.echo(f"lensforge: {' '.join(message.split())}", err=True)
    sys.exit(code)
