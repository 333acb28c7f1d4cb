"""What a killed process leaves is deleted by the next command; what belongs to a living one or to others stays."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from lensforge.results import files
from lensforge.results.files import (
    FOLDER,
    WRITING,
    delete_left_files,
    delete_left_folders,
    file_bytes,
    is_dead,
    own_mark,
    replacing,
)
from lensforge.results.folder_lock import locked

pytestmark = pytest.mark.skipif(os.name != "posix", reason="looks for processes")
_WRITE = """
import sys, time
from pathlib import Path
from lensforge.results.files import replacing, temporary_folder
with replacing(Path(sys.argv[1]) / "lens.step") as path, temporary_folder("lens.stl") as folder:
    path.write_text("half")
    (folder / "lens.stl").write_text("half")
    print("writing", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def own_temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return tmp_path / "tmp"


def writing(folder: Path) -> subprocess.Popen[str]:
    """A process that has begun to write a file in ``folder`` and another one in a temporary folder."""
    process = subprocess.Popen([sys.executable, "-c", _WRITE, str(folder)], stdout=subprocess.PIPE, encoding="utf-8")
    assert process.stdout is not None and process.stdout.readline() == "writing\n"
    return process


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("way", ["replacing", "locked"])
def test_what_a_kill_leaves_is_deleted_by_the_next_command(way: str, tmp_path: Path, own_temporary: Path) -> None:
    made = tmp_path / "made"
    process = writing(made)
    (made / ".writing-old.step").write_text("the user's own", encoding="utf-8")
    (own_temporary / "lensforge-abc.log").write_text("of a bug report", encoding="utf-8")
    with locked(made):
        pass
    assert len(names(made)) == 2 and len(names(own_temporary)) == 2, "its process is alive"
    process.send_signal(signal.SIGKILL)
    if way == "locked":
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)  # dead, and not yet collected: a zombie
        with locked(made):
            pass
    else:
        process.wait()
        folder = tmp_path / "link"
        folder.symlink_to(made)
        with replacing(folder / "lens.json") as path:
            path.write_text("{}", encoding="utf-8")
        (made / "lens.json").unlink()
        file_bytes("lens.3mf", lambda path: path.write_text("whole", encoding="utf-8"))
    process.wait()
    assert names(made) == [".writing-old.step"]
    assert names(own_temporary) == ["lensforge-abc.log"]


def marked(**change: str) -> str:
    parts = dict(zip(("machine", "pid", "start"), own_mark().split("-"), strict=True))
    return "-".join((parts | change).values())


def test_only_a_process_of_this_machine_that_has_ended_is_dead() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert is_dead(marked(pid=str(ended.pid)))
    assert is_dead(marked(start="12345678")), "another process with this number, at another time"
    assert not is_dead(own_mark())
    assert not is_dead(marked(start="00000000")), "a system that does not tell the start"
    assert not is_dead(marked(machine="00000000", pid=str(ended.pid))), "of another machine"
    for hostile in ("", "-", "0-0-0", marked(pid="0"), marked(pid="-1"), marked(pid="9" * 11), marked(pid="１")):
        assert not is_dead(hostile), hostile


def test_a_number_that_no_process_can_have_is_dead_and_harms_nothing() -> None:
    assert is_dead(marked(pid="9" * 9)) and not is_dead(marked(pid="9" * 10))


def test_the_process_of_another_user_is_alive(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_pid: int, _signal: int) -> None:
        raise PermissionError

    monkeypatch.setattr(files.os, "kill", refused)
    assert not is_dead(marked(pid="1", start="12345678"))


def test_links_are_not_followed_and_folders_in_place_of_files_stay(tmp_path: Path, own_temporary: Path) -> None:
    dead = marked(pid="9" * 9)
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "file").write_text("kept", encoding="utf-8")
    (own_temporary / f"{FOLDER}{dead}-a").symlink_to(precious)
    inside = own_temporary / f"{FOLDER}{dead}-b"
    inside.mkdir()
    (inside / "link").symlink_to(precious)
    (tmp_path / f"{WRITING}{dead}-x.step").mkdir()
    (tmp_path / f"{WRITING}{dead}-y.step").symlink_to(precious / "file")
    delete_left_folders()
    delete_left_files(tmp_path)
    assert (precious / "file").read_text(encoding="utf-8") == "kept"
    assert not inside.exists()
    assert (tmp_path / f"{WRITING}{dead}-x.step").is_dir()
    assert not (tmp_path / f"{WRITING}{dead}-y.step").is_symlink()


def test_no_temporary_folder_and_no_folder_are_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise FileNotFoundError(2, "No usable temporary directory found")

    monkeypatch.setattr(files.tempfile, "gettempdir", none)
    delete_left_folders()
    delete_left_files(tmp_path / "none")
