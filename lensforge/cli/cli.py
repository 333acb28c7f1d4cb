"""The command line. Exit code 0: done; 1: a criterion missed; 2: bad input; 128 + n: ended by signal n.

A command imports heavy libraries when it runs, so that ``--help`` answers at once and only CAD commands load CAD.
Only this module exits.
"""

import atexit
import errno
import os
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from itertools import zip_longest
from typing import Any, NoReturn

import click

from lensforge.addon import addons
from lensforge.cli.compiling import compile_kernels
from lensforge.cli.design import design, preview
from lensforge.cli.interrupts import Interrupts
from lensforge.cli.output import printable, warning_line
from lensforge.cli.rays import rays
from lensforge.cli.specs import examples, new, schema
from lensforge.cli.stages import STAGE_COMMANDS, handover, report
from lensforge.cli.streams import lasting_streams, open_standard_streams
from lensforge.cli.studies import sweep, tradeoff
from lensforge.errors import FileWarning, LensforgeError, SeveralErrors
from lensforge.version import __version__

# Commands by what they are for, those of add-ons behind the core's; those of no heading come last.
_SECTIONS = {
    "Design": ("new", "preview", "design", "sweep", "tradeoff", "examples", "schema", "compile"),
    "One stage of a result folder again": ("evaluate", "export", "check", "verify", "photometry", "report"),
    "Tolerances": ("sensitivity", "yield"),
    "The shop and the machined part": ("handover",),
}
_REST = "Files"
_NOTES = """\b
Units:    lengths in mm, angles in degrees, wavelengths in nm, flux lm or W.
Numbers:  whole numbers may be written as 1e6.
Presets:  --accuracy draft, standard (default) or reference: more rays, finer
          tables and more functions of the surfaces; each takes longer.
Output:   stdout has one screen; --json all digits, --quiet nothing.
          Progress, warnings and errors go to stderr.
Exit:     0 done; 1 photometry or CAD files fail (manufacture, where the spec
          requires it); 2 bad input. lensforge COMMAND --help has the options.
Shell:    completion by eval "$(_LENSFORGE_COMPLETE=bash_source lensforge)"
          in ~/.bashrc; zsh_source for zsh, fish_source for fish."""

# The machine's fault wherever it is met, in a library too; any other error of the system is a bug.
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.ENFILE, errno.EMFILE}
_FAILING = {errno.EIO, errno.ENOMEM, errno.EAGAIN}
_NEW_OPTIONS = {"--anyway": "--force", "--runout": "--extension"}  # by their names in earlier versions
_CLEAN_UP_SECONDS = 2.0  # for what libraries do at the end of a program, after an interrupt


class _Interrupted(Exception):
    """An interrupt on its way through click, which would print an empty line for :class:`KeyboardInterrupt`."""


class _CutShort(Exception):
    """A file that ends too early on its way through click, which would take :class:`EOFError` for an interrupt."""


class _Group(click.Group):
    """The commands of the core and of add-ons; the latter are loaded for a name that the core does not have."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return sorted(all_commands())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a name; None if there is none."""
        return self.commands.get(cmd_name) or all_commands().get(cmd_name)

    def invoke(self, context: click.Context) -> Any:
        try:
            return super().invoke(context)
        except KeyboardInterrupt:
            raise _Interrupted from None
        except EOFError as error:  # which click would take for an interrupt
            raise _CutShort from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings, those of no heading last."""
        sections = {title: (*names, *_added_under(title)) for title, names in _SECTIONS.items()}
        named = {name for names in sections.values() for name in names}
        rest = tuple(name for name in self.list_commands(ctx) if name not in named)
        for title, names in {**sections, _REST: rest}.items():
            commands = [(name, self.get_command(ctx, name)) for name in names]
            limit = formatter.width - 20
            rows = [(name, command.get_short_help_str(limit)) for name, command in commands if command is not None]
            if rows:
                with formatter.section(title):
                    formatter.write_dl([(name.ljust(11), summary) for name, summary in rows])


@click.group(
    cls=_Group,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
    epilog=_NOTES,
    no_args_is_help=False,
    invoke_without_command=True,
)
@click.version_option(__version__, message="%(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """Turn an LED and a target light pattern into a lens that a machine shop can cut."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


for command in (
    *STAGE_COMMANDS,
    design,
    preview,
    new,
    sweep,
    tradeoff,
    report,
    handover,
    rays,
    schema,
    examples,
    compile_kernels,
):
    cli.add_command(command)


@cache
def _commands_of_addons() -> dict[str, Sequence[click.Command]]:
    return {addon.name: addon.commands() for addon in addons()}


def _added_under(heading: str) -> list[str]:
    """Names of the commands that add-ons have under a heading of the help."""
    commands = (_commands_of_addons()[addon.name] for addon in addons() if addon.heading == heading)
    return [command.name or "" for several in commands for command in several]


def all_commands() -> dict[str, click.Command]:
    """Commands by name, those of add-ons among them, which are loaded here."""
    added = {command.name or "": command for several in _commands_of_addons().values() for command in several}
    return {**added, **cli.commands}


def main(interrupts: Interrupts | None = None, arguments: Sequence[str] | None = None) -> None:
    """Entry point: every exit has a code and at most one line on stderr, or one for each wrong field of a spec.

    ``interrupts``: installed already. ``arguments``: of the command; None: those of this process.
    """
    open_standard_streams()
    _show_own_warnings_in_a_line()
    handler = Interrupts().install() if interrupts is None else interrupts
    try:
        with lasting_streams() as stdout_failure:
            code = _run(handler, arguments)
            failure = stdout_failure()
            if failure is not None and code == 0:
                code = _say(
                    f"stdout: cannot be written ({failure.strerror}); the command is done, and its files are written", 2
                )
        if handler.received is not None and code == handler.exit_code:
            _end_at_once(code)
    finally:
        handler.uninstall(at_exit=interrupts is not None)
    sys.exit(code)


def _show_own_warnings_in_a_line() -> None:
    show_warning = warnings.showwarning
    shown = set[str]()

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if issubclass(category, FileWarning):
            if str(message) not in shown:  # a file may be read again by the next stage
                click.echo(warning_line(str(message)), err=True)
            shown.add(str(message))
        else:
            show_warning(message, category, *place, **more)

    warnings.showwarning = show


def _run(interrupts: Interrupts, arguments: Sequence[str] | None) -> int:
    """Run the command, say in one line why it ended early, and return the exit code."""
    try:
        with interrupts.raised():
            cli.main(args=arguments, prog_name="lensforge", standalone_mode=False, obj=interrupts)
    except SystemExit as end:  # of click, for the completion of a shell
        return int(end.code or 0)
    except BaseException as error:
        if interrupts.received is not None or isinstance(error, _Interrupted | KeyboardInterrupt | click.Abort):
            return _say(interrupts.line, interrupts.exit_code)  # whatever a library made of it
        return _failure(error.__cause__ if isinstance(error, _CutShort) and error.__cause__ else error)
    return 0


def _failure(error: BaseException) -> int:
    """Say what is wrong, and return the exit code."""
    if isinstance(error, SeveralErrors):
        both = zip_longest(error.lines, error.beneath, fillvalue="")
        return max(_say(line, error.exit_code, beneath) for line, beneath in both)
    if isinstance(error, LensforgeError):
        return _say(str(error), error.exit_code)
    if isinstance(error, click.NoSuchOption) and error.option_name in _NEW_OPTIONS:
        return _say(f"No such option: {error.option_name}; it is {_NEW_OPTIONS[error.option_name]} now", 2)
    if isinstance(error, click.ClickException):
        return _say(f"{error.format_message().rstrip('.')}; see --help", 2)
    if isinstance(error, MemoryError):
        return _say("out of memory; use fewer --rays or a lower --accuracy", 1)
    if isinstance(error, OSError) and error.errno in _FULL | _FAILING:
        where = "" if error.filename is None else f"{error.filename}: "
        return _say(f"{where}{error.strerror}; a full disk, or a limit of this machine?", 2)
    # a bug: the user gets a line, the developer the details
    return _say(f"internal error: {type(error).__name__}: {error}; {_details(error)}", 1)


def _details(error: BaseException) -> str:
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", errors="backslashreplace", prefix="lensforge-", suffix=".log", delete=False
        ) as log:
            traceback.print_exception(error, file=log)
    except OSError:  # no folder for it
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"raised at {last.filename}:{last.lineno}; set TMPDIR to a folder with room for the details"
    return f"details for a bug report: {log.name}"


def _say(message: str, code: int, beneath: str = "") -> int:
    """Print one line, and the excerpt that may stand beneath it; return ``code``."""
    lines = [f"lensforge: {printable(' '.join(message.split()))}", *map(printable, beneath.splitlines())]
    click.echo("\n".join(lines), err=True)
    return code


def _end_at_once(code: int) -> NoReturn:
    """End the process after an interrupt, while threads of native libraries may still be at work.

    The interpreter's own end would take their memory away under them. What libraries delete at the end (their
    temporary folders) is deleted.
    """
    timer = threading.Timer(_CLEAN_UP_SECONDS, os._exit, (code,))
    timer.daemon = True
    timer.start()
    with suppress(BaseException):
        atexit._run_exitfuncs()
    os._exit(code)
