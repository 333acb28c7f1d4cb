"""Ctrl-C, SIGTERM and SIGHUP, in processes of their own: one line, an exit code, no crash, advice where it holds."""

import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import suppress
from pathlib import Path

import pytest
from click.testing import CliRunner
from kills import default_signals
from made_once import copied
from nightly import first_by_day
from scenes import small_spec

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.cli.interrupts import Interrupts, _is_cleaning_up
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.verbs import YIELD_PARTS

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX systems")

INTERRUPTS = """
import os, signal, sys, time
from lensforge.cli.interrupts import Interrupts

def send(number=signal.SIGINT):
    os.kill(os.getpid(), number)

interrupts = Interrupts().install()
"""


def script(text: str, start: str = INTERRUPTS, **options: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", start + textwrap.dedent(text)]
    options = {"preexec_fn": default_signals, **options}
    return subprocess.run(command, capture_output=True, encoding="utf-8", timeout=120, check=False, **options)


def test_an_interrupt_that_a_destructor_swallows_is_raised_again() -> None:
    done = script("""
        class Swallows:
            def __del__(self):
                send()
                time.sleep(0.01)
        try:
            with interrupts.raised():
                Swallows()
                time.sleep(30.0)
        except KeyboardInterrupt:
            print(interrupts.line, interrupts.exit_code)
    """)
    assert (done.stdout, done.stderr, done.returncode) == ("interrupted 130\n", "", 0)


def test_an_import_is_not_interrupted_half_way(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time\nimport __main__\n__main__.send()\ntime.sleep(0.25)\ndone = True\n")
    done = script(
        """
        sys.path.insert(0, sys.argv[0] and ".")
        try:
            with interrupts.raised():
                try:
                    import slow
                finally:
                    print(slow.done)
                time.sleep(30.0)
        except KeyboardInterrupt:
            print("interrupted")
        """,
        cwd=tmp_path,
    )
    assert (done.stdout, done.stderr) == ("True\ninterrupted\n", "")


def test_clean_up_is_not_interrupted_by_the_same_signal_again() -> None:
    done = script("""
        try:
            with interrupts.raised():
                try:
                    send()
                    time.sleep(30.0)
                finally:
                    send()  # as wrappers do, which pass the signal on
                    time.sleep(0.4)
                    print("cleaned")
        except KeyboardInterrupt:
            print("interrupted")
    """)
    assert (done.stdout, done.stderr) == ("cleaned\ninterrupted\n", "")


def test_clean_up_goes_on_through_errors_of_its_own() -> None:
    """An error that is raised and caught on the way out has the interrupt as its context, not as its cause."""
    seen = [_is_cleaning_up()]
    for interrupt in (KeyboardInterrupt, GeneratorExit, ValueError):
        try:
            raise interrupt
        except interrupt:
            with suppress(OSError):
                try:
                    raise OSError
                finally:
                    seen.append(_is_cleaning_up())
    assert seen == [False, True, True, False]


def test_a_second_ctrl_c_ends_a_clean_up_that_takes_long() -> None:
    done = script("""
        with interrupts.raised():
            try:
                send()
                time.sleep(30.0)
            finally:
                time.sleep(1.2)
                send()
                time.sleep(30.0)
    """)
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 130)


def test_an_interrupt_before_the_command_is_kept_until_it_begins() -> None:
    done = script("""
        send(signal.SIGTERM)
        try:
            with interrupts.raised():
                print("begun")
        except KeyboardInterrupt:
            interrupts.resumable = lambda: True
            print(interrupts.exit_code, interrupts.line)
    """)
    expected = "143 terminated; the same command with --resume continues from the last checkpoint\n"
    assert (done.stdout, done.stderr) == (expected, "")


def test_nohup_and_the_library_leave_signals_alone() -> None:
    start = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n" + INTERRUPTS
    assert script("send(signal.SIGHUP); print(interrupts.received)", start).stdout == "None\n"
    done = script(
        """
        import signal
        before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
        import lensforge
        lensforge.run
        print(before == [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)])
        """,
        "",
    )
    assert done.stdout == "True\n", done.stderr


def started(*arguments: object, **options: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "lensforge", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        preexec_fn=default_signals,
        **options,
    )


def test_sigterm_saves_the_search_and_says_so(tmp_path: Path) -> None:
    spec = tmp_path / "small.toml"
    small_spec(optimise__steps_per_level=[2, 4000], optimise__rays=256).save(spec)
    process = started("design", spec, "--accuracy", "draft", "--out", tmp_path / "out")
    assert process.stderr is not None
    assert process.stderr.readline().startswith("level 1/2")
    process.send_signal(signal.SIGTERM)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 143
    message = "lensforge: terminated; the same command with --resume continues from the last checkpoint"
    assert stderr.splitlines()[-1] == message  # after the lines of further steps, on a fast machine
    assert [path.name for path in (tmp_path / "out").iterdir()] == [CHECKPOINT]


@pytest.mark.parametrize("seconds", first_by_day(1, [0.3, 1.0], "another moment of the same"))
def test_an_early_ctrl_c_advises_nothing_that_is_not_there(seconds: float, tmp_path: Path) -> None:
    """While the libraries load, or before the first step."""
    spec = tmp_path / "small.toml"
    small_spec(optimise__steps_per_level=[4000, 4000]).save(spec)
    process = started("design", spec, "--accuracy", "draft", "--out", tmp_path / "out")
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=120)
    assert "Traceback" not in stderr
    if (tmp_path / "out" / CHECKPOINT).exists():  # a fast machine
        assert "--resume" in stderr and process.returncode == 130
    elif stderr:
        nothing = "; there is nothing to resume yet: run the same command again"  # once the command has begun
        assert stderr in ("lensforge: interrupted\n", f"lensforge: interrupted{nothing}\n")
        assert process.returncode == 130
    else:
        assert process.returncode == -signal.SIGINT, "before Python had begun the program"


@pytest.mark.nightly("ten seconds")
def test_ctrl_c_while_nearest_points_are_searched_is_no_crash(small_run: lf.Run, tmp_path: Path) -> None:
    """It was a segmentation fault with the threads of ``cKDTree.query``."""
    folder = copied(small_run.folder, tmp_path / "copy")
    done = script(
        f"""
        import os, signal, sys, threading
        from lensforge.shop import ball_cutter as cutter
        search = cutter._shrink
        def interrupted(*arguments):
            threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
            while True:
                search(arguments[0].copy(), *arguments[1:])
        cutter._shrink = interrupted
        sys.argv = ["lensforge", "check", {str(folder)!r}]
        from lensforge.cli.cli import main
        main()
        """,
        "",
    )
    assert (done.returncode, done.stderr) == (130, "lensforge: interrupted\n")


MOMENTS = [(command, moment) for command in ("check", "export", "verify", "report") for moment in range(12)]


@pytest.mark.nightly("four minutes")
@pytest.mark.parametrize(("command", "moment"), MOMENTS)
def test_ctrl_c_at_any_moment_is_one_line_and_leaves_nothing(
    command: str, moment: int, small_run: lf.Run, tmp_path: Path
) -> None:

    folder, temporary = copied(small_run.folder, tmp_path / "copy"), tmp_path / "tmp"
    temporary.mkdir()
    process = started(command, folder, env={**os.environ, "TMPDIR": str(temporary)}, cwd=tmp_path)
    time.sleep(0.7 + 0.6 * moment)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    if process.returncode == -signal.SIGINT:  # all is done, and Python ends: there is nothing to say
        assert re.fullmatch(rf"{command} +[\d.]+ s", stderr.splitlines()[-1]), stderr
    elif process.returncode not in (0, 1):
        *stages, message = stderr.splitlines()  # a stage that has ended left its line
        assert (process.returncode, message) == (130, "lensforge: interrupted") and len(stages) <= 1
    assert not list(temporary.iterdir()) and not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_an_interrupted_yield_says_that_the_same_command_goes_on(tmp_path: Path) -> None:
    """Where it has measured parts, by the file that holds them; it takes no --resume."""
    heard = Interrupts()
    CliRunner().invoke(cli, ["yield", str(tmp_path)], obj=heard)
    assert heard.line == "interrupted; there is nothing to resume yet: run the same command again"
    (tmp_path / YIELD_PARTS).touch()
    assert heard.line == f"interrupted; the same command goes on with what it has measured ({YIELD_PARTS})"
