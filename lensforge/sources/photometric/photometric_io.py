"""Reading and writing of photometric files; the format is recognised by the content.

Encoding, line ends and end marks vary by program and age.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensforge.errors import InputError
from lensforge.results.files import MIB, read_file, replacing
from lensforge.results.text_dialect import decoded
from lensforge.sources.photometric import ies
from lensforge.sources.photometric.eulumdat import FORMAT as EULUMDAT
from lensforge.sources.photometric.ies import FORMAT as IES
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion
from lensforge.sources.photometric.photometric_file import PhotometricFile, PhotometricFormat
from lensforge.sources.photometric.tm33 import FORMAT as TM33

_LINE_END = re.compile(r"\r*\n|\r")  # Unix, DOS (also with the carriage return doubled), old Macintosh
_END_OF_TEXT = "\x1a"  # Ctrl-Z, after which DOS reads nothing
_PADDING = "\0\x1a \t\n"


def text_of(content: bytes) -> tuple[str, tuple[str, ...]]:
    """Text of a file with "\\n" for line ends, up to its end mark; and warnings on anything that was left out.

    UTF-8 and UTF-16, with a byte-order mark or without, then Windows-1252, in which byte 85 hex is an ellipsis and
    not, as in Unicode, the end of a line.
    """
    text = _LINE_END.sub("\n", decoded(content).replace("\x85", "…"))
    text, mark, rest = text.partition(_END_OF_TEXT)
    left_out = rest.strip(_PADDING)
    warning = f"{len(left_out)} characters after its end mark (Ctrl-Z) are left out"
    return text.rstrip(_PADDING), (warning,) if mark and left_out else ()


_FORMATS = {entry.suffix: entry for entry in (IES, EULUMDAT, TM33)} | {".xml": TM33}
TITLES = {"ies": IES.title, "eulumdat": EULUMDAT.title, "tm33": TM33.title}

_MOST_BYTES = 16 * MIB  # a million numbers of 16 characters: more than any table that is read


def read_photometric(path: Path) -> PhotometricFile:
    """Read an IES LM-63, EULUMDAT or TM-33 file. Raises :class:`InputError`, one line, if it cannot be used."""
    missing = "give an IES LM-63, EULUMDAT or TM-33 file"
    return photometric_of(read_file(Path(path), missing=missing, most_bytes=_MOST_BYTES), str(path))


def photometric_of(content: bytes, name: str) -> PhotometricFile:
    """The far field in the ``content`` of a file, ``name`` in errors; else as :func:`read_photometric`."""
    text, warnings = text_of(content)
    for entry in _FORMATS.values():
        if entry.matches(text):
            file = entry.decode(text, name)
            return replace(file, warnings=(*warnings, *file.warnings))
    # loaded where a file is none of these: few that read them need the formats of rays
    from lensforge.sources.rayfiles.formats import format_of
    from lensforge.sources.rayfiles.ray_file_rows import FileImage, as_plain_text

    image = FileImage(Path(name), np.frombuffer(content, dtype=np.uint8))
    if (rays := format_of(as_plain_text(image))) is not None:
        raise InputError(f'{name}: a ray file ({rays.title}): use it as a source of kind "rayfile"')
    raise InputError(f"{name}: neither IES LM-63 nor EULUMDAT nor TM-33; export one of these")


def photometric_format(path: Path) -> PhotometricFormat | None:
    """The format of the content of ``path``, damaged or not; None of any other file, or one that cannot be read."""
    try:
        text, _ = text_of(read_file(path, missing="", most_bytes=_MOST_BYTES))
    except InputError:
        return None
    return next((entry for entry in _FORMATS.values() if entry.matches(text)), None)


def write_photometric(path: Path, photometric: PhotometricFile, *, ies_version: IesVersion = NEWEST) -> None:
    """Write ``path``; its suffix, .ies, .ldt, .iesxml or .xml, chooses the format.

    ``ies_version``: year of LM-63 that an IES file follows, 2019 or 2002.
    """
    content = encoded(Path(path), photometric, ies_version)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(content)


def encoded(path: Path, photometric: PhotometricFile, ies_version: IesVersion = NEWEST) -> bytes:
    """Content of the file that :func:`write_photometric` writes. Raises :class:`InputError` for another suffix."""
    entry = _FORMATS.get(path.suffix.lower())
    if entry is None:
        raise InputError(f"{path}: its suffix must be one of {', '.join(_FORMATS)}")
    text = ies.encode(photometric, ies_version) if entry is IES else entry.encode(photometric)
    return text.encode(entry.encoding, "replace")
