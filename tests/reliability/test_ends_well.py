"""Streams that close or are full, folders that cannot be written, full disks, and pages that belong to others."""

import errno
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from made_once import copied
from nightly import first_by_day

import lensforge as lf
from lensforge.cli import cli
from lensforge.cli.streams import _lasting
from lensforge.errors import InputError
from lensforge.report.page import write_page
from lensforge.results.files import replacing, require_writable

pytestmark = pytest.mark.skipif(os.name != "posix", reason="shells and limits of POSIX systems")

PAGE = '<!DOCTYPE html>\n<meta name="generator" content="lensforge 0.1.0">\n<title>old</title>\n'
FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")


def shell(line: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """``line`` in a shell in which ``lensforge`` is the command line; the status is that of a pipe's first failure."""
    prelude = f'set -o pipefail; lensforge() {{ {sys.executable} -m lensforge "$@"; }}; '
    return subprocess.run(
        ["bash", "-c", prelude + line],
        capture_output=True,
        encoding="utf-8",
        cwd=cwd,
        env={**os.environ, **environment},
        timeout=300,
        check=False,
    )


@pytest.fixture
def ray_file(examples: Path, tmp_path: Path) -> Path:
    """A file whose summary is printed at once."""
    return Path(shutil.copy(examples / "led.tm25ray", tmp_path / "led-π.ray"))


# Exit code, and the lines on stderr.
STREAMS: list[tuple[str, int, list[str]]] = [
    (
        "lensforge rays led-π.ray >/dev/full",
        2,
        [
            "lensforge: stdout: cannot be written (No space left on device); "
            "the command is done, and its files are written"
        ],
    ),
    ("lensforge rays led-π.ray --to led.csv | true", 0, []),
    ("lensforge rays nowhere 2>&-", 2, []),
    ("lensforge --help | head -1 >/dev/null", 0, []),
    ("lensforge rays led-π.ray >&-", 0, []),
    ("lensforge rays led-π.ray 2>&- >/dev/null", 0, []),
    ("LC_ALL=C PYTHONIOENCODING=ascii lensforge rays led-π.ray >/dev/null", 0, []),
    ("LC_ALL=C PYTHONCOERCECLOCALE=0 PYTHONUTF8=0 lensforge rays led-π.ray >/dev/null", 0, []),
]  # fmt: skip


@FULL
@pytest.mark.parametrize(("line", "code", "messages"), first_by_day(2, STREAMS, "a process each"))
def test_a_stream_that_fails_costs_one_line_at_most(
    line: str, code: int, messages: list[str], ray_file: Path, tmp_path: Path
) -> None:
    done = shell(line, tmp_path)
    assert (done.returncode, done.stderr.splitlines()) == (code, messages)
    if "--to" in line:
        assert (tmp_path / "led.csv").read_text(encoding="utf-8").count("\n") > 20_000, "the work is done"


@pytest.mark.nightly("ten seconds; by day a conversion does")
def test_a_stage_whose_reader_has_left_does_all_its_work(small_run: lf.Run, tmp_path: Path) -> None:
    folder = copied(small_run.folder, tmp_path / "copy")
    (folder / "evaluate.json").unlink()
    (folder / "report.html").unlink()  # which would be drawn again
    done = shell(f"lensforge evaluate {folder} | true", tmp_path)
    assert done.returncode in (0, 1) and "Traceback" not in done.stderr
    assert np.array_equal(lf.load(folder).light.map, small_run.light.map)


def unusable(tmp_path: Path) -> dict[str, Path]:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    (tmp_path / "folder").mkdir()
    paths = {
        "a file in the way": tmp_path / "file" / "page.html",
        "a folder": tmp_path / "folder",
        "a NUL": tmp_path / "a\0b",
        "a long name": tmp_path / ("n" * 300),
        "a long folder": tmp_path / ("n" * 300) / "page.html",
        "a long path": tmp_path.joinpath(*["n" * 200] * 30),
        "not a disk": Path("/proc/nowhere/page.html"),
    }
    if os.geteuid() != 0:  # who may write anywhere
        (tmp_path / "read-only").mkdir(mode=0o500)
        paths["read-only"] = tmp_path / "read-only" / "new" / "page.html"
    return paths


def test_a_place_that_cannot_be_written_is_said_before_the_work(tmp_path: Path) -> None:
    for name, path in unusable(tmp_path).items():
        before = sorted(tmp_path.rglob("*"))
        with pytest.raises(InputError, match="cannot be written") as error:
            require_writable(path)
        assert len(str(error.value)) < 1200, name
        with pytest.raises(InputError, match="cannot be written"), replacing(path) as temporary:
            temporary.write_bytes(b"new")
        assert sorted(tmp_path.rglob("*")) == before, name
    require_writable(tmp_path / "new" / "folders" / "page.html")
    assert not (tmp_path / "new").exists()


def test_the_old_file_is_named_only_where_there_is_one(tmp_path: Path) -> None:
    def fail(path: Path) -> str:
        with pytest.raises(InputError) as error, replacing(path):
            raise OSError(errno.ENOSPC, "No space left on device")
        return str(error.value)

    (tmp_path / "old").write_bytes(b"old")
    assert "the old file is kept" in fail(tmp_path / "old") and (tmp_path / "old").read_bytes() == b"old"
    assert "old file" not in fail(tmp_path / "new") and "make room" in fail(tmp_path / "new")


PAGES: list[tuple[str, bytes, bool]] = [
    ("a page of an earlier version", PAGE.encode(), True),
    ("an empty file", b"", True),
    ("a page by somebody else", b"<!DOCTYPE html><title>Offer</title>", False),
    ("a page that mentions it far below", b"<html>" + b" " * 8192 + PAGE.encode(), False),
    ("no page", b"\x89PNG", False),
]


@pytest.mark.parametrize(("content", "ours"), [page[1:] for page in PAGES], ids=[page[0] for page in PAGES])
def test_only_own_pages_are_overwritten(content: bytes, ours: bool, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_bytes(content)
    if ours:
        write_page("new", path)
        assert path.read_text() == "new"
        return
    with pytest.raises(InputError, match="move it away"):
        write_page("new", path)
    assert path.read_bytes() == content


def test_commands_leave_the_pages_of_others_alone(
    small_run: lf.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copied(small_run.folder, tmp_path / "copy")
    for path in (folder / "report.html", tmp_path / "compare.html"):
        path.write_text("<title>Offer</title>", encoding="utf-8")
    with pytest.raises(InputError, match="move it away"):
        lf.load(folder).report(folder / "report.html")
    with pytest.raises(InputError, match="move it away"):  # before the search
        lf.run(small_run.spec, folder, accuracy="draft", progress=lambda step: pytest.fail("searched"))
    monkeypatch.chdir(tmp_path)
    for folders, page in (([folder], folder / "report.html"), ([folder, small_run.folder], "compare.html")):
        done = CliRunner().invoke(cli.cli, ["report", *map(str, folders)])
        assert isinstance(done.exception, InputError) and str(done.exception).startswith(f"{page}: not a page")
    assert (folder / "report.html").read_text() == "<title>Offer</title>" == (tmp_path / "compare.html").read_text()


@pytest.mark.parametrize("usable", first_by_day(1, [False, True], "a process each"))
def test_a_bug_is_one_line_wherever_its_details_go(usable: bool, tmp_path: Path) -> None:
    code = (
        "import sys, lensforge.cli.cli as c; c.cli.main = lambda **k: 1 / 0; "
        "import tempfile; tempfile.tempdir = sys.argv.pop(); c.main()"
    )
    place = tmp_path if usable else tmp_path / "nowhere"
    done = subprocess.run([sys.executable, "-c", code, place], capture_output=True, encoding="utf-8", check=False)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1 and line.startswith("lensforge: internal error: ZeroDivisionError: division by zero; ")
    if usable:
        assert "ZeroDivisionError" in Path(line.rpartition(" ")[2]).read_text()
    else:
        assert "raised at" in line and "set TMPDIR" in line


@pytest.mark.parametrize(
    ("error", "message"), [(EOFError("ends"), "internal error: EOFError: ends"), (KeyboardInterrupt(), "interrupted")]
)
def test_the_end_of_a_file_is_no_interrupt(
    error: BaseException, message: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def end(**_: object) -> None:
        raise error

    monkeypatch.setattr(cli.cli.commands["examples"], "callback", end)
    with pytest.raises(SystemExit):
        cli.main(arguments=["examples"])
    assert capfd.readouterr().err.startswith(f"lensforge: {message}")


COMMANDS = (
    "check", "evaluate", "photometry --rays 4096", "export", "verify", "handover", "report", "sensitivity --rays 1024",
)  # fmt: skip


@pytest.mark.parametrize("command", first_by_day(1, COMMANDS, "ten seconds each"))
def test_a_full_disk_is_one_line_and_old_files_stay(command: str, small_run: lf.Run, tmp_path: Path) -> None:
    """A limit on the size of files instead of a disk: each write beyond it fails, in every library."""
    folder, temporary = copied(small_run.folder, tmp_path / "copy"), tmp_path / "tmp"
    temporary.mkdir()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    name, *options = command.split()
    done = subprocess.run(
        [sys.executable, "-m", "lensforge", name, folder, *options],
        capture_output=True,
        encoding="utf-8",
        # Python 3.11 keeps a compiled module that the limit has cut short: no later command would start.
        env={**os.environ, "TMPDIR": str(temporary), "PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1500, 1500)),
        timeout=300,
        check=False,
    )
    *progress, line = done.stderr.splitlines()
    assert [row for row in progress if name != "sensitivity" or not row.startswith("sensitivity  ")] == []
    assert done.returncode == 2 and ("File too large" in line or "full disk" in line), line
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert not list(temporary.iterdir())


def test_a_reader_of_progress_that_leaves_costs_no_work(examples: Path, tmp_path: Path) -> None:
    """The clock of the stages writes to stderr: no line of it may end the command."""
    code = (
        "import os; r, w = os.pipe(); os.dup2(w, 2); os.close(w); os.close(r); "
        "from lensforge.cli.streams import lasting_streams; from lensforge.cli.progress import StageClock\n"
        "with lasting_streams():\n"
        "    with StageClock('search') as clock:\n"
        "        clock.note('gone'); clock.warn('gone')\n"
        "    print('done')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "done\n")


def test_a_line_of_stderr_is_in_its_file_at_once(capfd: pytest.CaptureFixture[str]) -> None:
    """Whoever watches the file sees it, and it is there if the command is killed."""
    with open(2, "w", closefd=False) as errors:
        stream, output = _lasting(errors, 2)
        stream.write("half\n")
        assert output is not None and not output.isatty()
        assert capfd.readouterr().err == "half\n"


@pytest.mark.nightly("two processes")
def test_the_module_searches_the_working_folder_last(tmp_path: Path) -> None:
    """Python itself searches it first for ``-m``; with -P it does not search it at all."""
    (tmp_path / "click.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')", encoding="utf-8")
    for safe in ((), ("-P",)):
        done = subprocess.run(
            [sys.executable, *safe, "-m", "lensforge", "--version"], cwd=tmp_path, capture_output=True, encoding="utf-8"
        )
        assert done.returncode == 0, done
        assert not (tmp_path / "ran").exists()
