"""A command reads each file of its folder once, and what it then writes is kept in memory."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from made_once import copied
from nightly import first_by_day

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.report.results import STAGES
from lensforge.results import files

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each JSON file is read, by its name."""
    counted: Counter[str] = Counter()
    plain: Callable[..., bytes] = files.read_file

    def counting(path: Path, **limits: object) -> bytes:
        if path.suffix == ".json":
            counted[path.name] += 1
        return plain(path, **limits)

    monkeypatch.setattr(files, "read_file", counting)
    return counted


COMMANDS = ["report", "evaluate --pixels 8", "check", "photometry --rays 512", "handover"]


@pytest.mark.parametrize("command", first_by_day(1, COMMANDS))
def test_one_command_reads_each_record_once(
    command: str, small_run: lf.Run, tmp_path: Path, read: Counter[str]
) -> None:
    """With a report beside them, which is written again at the end."""
    folder = copied(small_run.folder, tmp_path / "copy")
    before = (folder / "report.html").stat().st_mtime_ns
    name, *options = command.split()
    done = CliRunner().invoke(cli, [name, str(folder), *options])
    assert done.exit_code == 0, done.exception
    assert (folder / "report.html").stat().st_mtime_ns > before
    assert read == dict.fromkeys(["lens.json", "run.json", *(f"{kind.stage}.json" for kind in STAGES)], 1)
    read.clear()
    assert lf.load(folder).verdict == small_run.verdict, "what was kept in memory is what was written"
    assert set(read.values()) == {1}
