"""Hashes of what a spec names: the content of a file counts, and its name, not the folder in which it lies."""

import shutil
from pathlib import Path

import lensforge as lf
from lensforge.spec.files import section_sha256

LED = Path(__file__).parents[2] / "examples" / "led.tm25ray"


def test_a_copy_of_a_file_in_another_folder_is_the_same_source(tmp_path: Path) -> None:
    folder = tmp_path / 'größe "1"'
    folder.mkdir()
    for name in ("led.tm25ray", "other.tm25ray"):
        shutil.copy(LED, folder / name)
    own, copied, renamed = (
        section_sha256(lf.RayfileSource(file=file)) for file in (LED, folder / "led.tm25ray", folder / "other.tm25ray")
    )
    assert own == copied
    assert own != renamed
    (folder / "led.tm25ray").write_bytes(LED.read_bytes()[:-1] + b"\0")
    assert section_sha256(lf.RayfileSource(file=folder / "led.tm25ray")) != own
