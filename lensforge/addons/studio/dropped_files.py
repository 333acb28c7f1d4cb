"""Files that are dropped onto the page: received beside their place, read, drawn, and only then kept.

A file that is refused leaves nothing, and a file of the same name that was there before stays.
"""

import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from lensforge.errors import InputError, refused
from lensforge.optics.image_reading import read_picture
from lensforge.sources.photometric_summary import PhotometricSummary, rays

DROPPED = "dropped"  # the folder in the results
_PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}
_NAME_CHARACTERS = 80
_RECEIVING = ".lensforge-receiving-"

Use = Literal["source", "target"]


@dataclass(frozen=True)
class DroppedFile:
    """A file by its ``path``, with its ``plot``, ``phrase`` on what is in it, and the uses that it ``fits``."""

    path: Path
    plot: Path
    phrase: str
    fits: tuple[Use, ...]

    @staticmethod
    def read(path: Path) -> "DroppedFile":
        """Read a file and draw it beside it. Raises :class:`InputError` for one of no known format."""
        if path.suffix.lower() in _PICTURES:
            height, width = read_picture(path, missing="drop it again").shape
            return DroppedFile(path, path, f"{path.name}: {width} × {height} pixels", ("target",))
        summary = rays(path)
        plot = path.with_name(f"{path.name}.png")
        summary.save(plot)
        if isinstance(summary, PhotometricSummary):
            figures = f"{summary.lumens:.4g} lm, peak {summary.peak.intensity_cd:.4g} cd"
            return DroppedFile(path, plot, f"{path.name}: {summary.format}, {figures}", ("target",))
        return DroppedFile(path, plot, f"{path.name}: {summary.format}, {summary.rays:,} rays", ("source",))

    def kept(self, folder: Path) -> "DroppedFile":
        """The file in its ``folder``, moved there with its plot."""
        plot = folder / self.plot.name
        for path in dict.fromkeys((self.path, self.plot)):
            path.replace(folder / path.name)
        return DroppedFile(folder / self.path.name, plot, self.phrase, self.fits)

    def table(self, use: Use, before: Mapping[str, Any]) -> dict[str, object]:
        """The table of a spec that names it; a picture takes its size and distance from the target ``before``."""
        if use not in self.fits:
            raise InputError(f"{self.path.name}: no {use}; use it as {' or '.join(self.fits)}")
        if use == "source":
            return {"kind": "rayfile", "file": str(self.path), "origin": "virtual_focus"}
        if self.plot == self.path:
            usual = (("width_mm", 200.0), ("distance_mm", 300.0))
            return {
                "kind": "image",
                "file": str(self.path),
                **{name: before.get(name, default) for name, default in usual},
            }
        return {"kind": "photometric", "file": str(self.path)}


def plain_name(name: str) -> str:
    """The ``name`` of a dropped file in plain characters. Raises :class:`InputError` for a name of no use."""
    plain = "".join(character if character.isalnum() or character in "-_." else "_" for character in Path(name).name)
    plain = plain[-_NAME_CHARACTERS:].lstrip(".")
    if not Path(plain).suffix:
        raise InputError(f"{name[:60]!r}: a file of rays, an IES or LDT file, or a picture, each with its suffix")
    return plain


@contextmanager
def receiving(folder: Path, name: str) -> Iterator[Path]:
    """Yield the place for a file ``name`` on its way into ``folder``.

    What has not been moved from there is deleted at the end, with the folders that were made for it alone.
    """
    if folder.is_symlink():
        raise InputError(f"{folder}: a link; files are kept in a folder of the results alone")
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    place = folder / f"{_RECEIVING}{secrets.token_hex(4)}"
    try:
        with refused(folder, "cannot be written (…); make room, or give another folder", OSError):
            place.mkdir(parents=True)
            yield place / name
    finally:
        shutil.rmtree(place, ignore_errors=True)
        for made in missing:
            with suppress(OSError):  # not empty: the file is there now
                made.rmdir()
