"""What a killed process leaves half written is deleted by the next command in the folder."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lensforge.results.folder_lock import locked

pytestmark = pytest.mark.skipif(os.name != "posix", reason="kills a process")
_WRITE = """
import sys, time
from pathlib import Path
from lensforge.results.files import replacing
from lensforge.results.folder_lock import locked
folder = Path(sys.argv[1])
with locked(folder, create=True), replacing(folder / "lens.step") as path:
    path.write_text("half")
    print("writing", flush=True)
    time.sleep(60)
"""


def test_what_a_kill_leaves_is_deleted_by_the_next_command(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", _WRITE, str(tmp_path)], stdout=subprocess.PIPE, encoding="utf-8")
    assert process.stdout is not None and process.stdout.readline() == "writing\n"
    (tmp_path / ".writing-old.step").write_text("the user's own", encoding="utf-8")
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(list(tmp_path.iterdir())) == 3
    with locked(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == [".writing-old.step"]
