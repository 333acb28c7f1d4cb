"""Reading and writing of photometric files; the format is recognised by the content."""

from dataclasses import replace
from pathlib import Path

from lensforge.errors import InputError
from lensforge.files import MIB, read_file, replacing
from lensforge.sources.photometric.eulumdat import FORMAT as EULUMDAT
from lensforge.sources.photometric.ies import FORMAT as IES
from lensforge.sources.photometric.record import PhotometricFile
from lensforge.sources.photometric.text import text_of

_FORMATS = {entry.suffix: entry for entry in (IES, EULUMDAT)}
_MOST_BYTES = 16 * MIB  # a million numbers of 16 characters: more than any table that is read


def read_photometric(path: Path) -> PhotometricFile:
    """Read an IES LM-63 or EULUMDAT file. Raises :class:`InputError`, one line, if it cannot be used."""
    path = Path(path)
    text, warnings = text_of(read_file(path, missing="give an IES LM-63 or EULUMDAT file", most_bytes=_MOST_BYTES))
    for entry in _FORMATS.values():
        if entry.matches(text):
            found = entry.decode(text, str(path))
            return replace(found, warnings=(*warnings, *found.warnings))
    raise InputError(f"{path}: neither IES LM-63 nor EULUMDAT; export one of these")


def is_photometric(path: Path) -> bool:
    """True where the content of ``path`` is recognised as one of the formats; False where it cannot be read."""
    try:
        text, _ = text_of(read_file(path, missing="", most_bytes=_MOST_BYTES))
    except InputError:
        return False
    return any(entry.matches(text) for entry in _FORMATS.values())


def write_photometric(path: Path, photometric: PhotometricFile) -> None:
    """Write ``path``; its suffix, .ies or .ldt, chooses the format."""
    entry = _FORMATS.get(Path(path).suffix.lower())
    if entry is None:
        raise InputError(f"{path}: its suffix must be one of {', '.join(_FORMATS)}")
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(entry.encode(photometric).encode("latin-1", "replace"))
