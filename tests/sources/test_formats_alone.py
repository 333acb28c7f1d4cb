"""Ray files and photometric files read and written by their rooms alone, without the rest of the package."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import lensforge as lf

PACKAGE = Path(lf.__file__).parent
BENEATH = ("errors", "public", "version", *(f"results/{name}" for name in (
    "files", "json_npz", "table_names", "text_dialect", "text_table",
)))  # fmt: skip
RAYS = """
import numpy as np
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import convert, read_rayfile, write_rayfile
down = np.array([[0.0, 0.6, -0.8], [0.0, 0.0, 1.0]])
write_rayfile("led.ray", RayFile(np.eye(3)[:2], down, np.array([0.25, 0.5]), "W"), "lighttools_binary")
print(convert("led.ray", "led.tm25ray").to_format, read_rayfile("led.tm25ray").total_flux())
"""
FAR_FIELD = """
import numpy as np
from lensforge.sources.photometric import PhotometricFile, read_photometric, write_photometric
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.photometric_file import LampSet
table = CandelaTable(np.zeros(1), np.linspace(0.0, 90.0, 91), np.ones((1, 91)))
write_photometric("lamp.ldt", PhotometricFile(table, (LampSet(2.0 * np.pi),)))
print(round(read_photometric("lamp.ldt").intensity.flux() / np.pi, 4))
"""


@pytest.mark.parametrize(
    ("room", "code", "printed"), [("rayfiles", RAYS, "tm25 0.75"), ("photometric", FAR_FIELD, "2.0")]
)
def test_a_room_of_formats_is_of_use_alone(room: str, code: str, printed: str, tmp_path: Path) -> None:
    shutil.copytree(PACKAGE / "sources" / room, tmp_path / "lensforge/sources" / room)
    (tmp_path / "lensforge/results").mkdir()
    for folder in ("", "results", "sources"):
        (tmp_path / "lensforge" / folder / "__init__.py").touch()
    for name in BENEATH:
        shutil.copy(PACKAGE / f"{name}.py", tmp_path / f"lensforge/{name}.py")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8"
    )
    assert (done.returncode, done.stdout.strip()) == (0, printed), done.stderr
