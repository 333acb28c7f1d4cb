"""Reading and writing of photometric files; the format is recognised by the content."""

from dataclasses import replace
from pathlib import Path

from lensforge.errors import InputError
from lensforge.files import MIB, read_file, replacing
from lensforge.sources.photometric import ies
from lensforge.sources.photometric.eulumdat import FORMAT as EULUMDAT
from lensforge.sources.photometric.ies import FORMAT as IES
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion
from lensforge.sources.photometric.record import PhotometricFile
from lensforge.sources.photometric.text import text_of
from lensforge.sources.photometric.tm33 import FORMAT as TM33

_FORMATS = {entry.suffix: entry for entry in (IES, EULUMDAT, TM33)} | {".xml": TM33}
_NAMES = "IES LM-63, EULUMDAT or TM-33"
_MOST_BYTES = 16 * MIB  # a million numbers of 16 characters: more than any table that is read


def read_photometric(path: Path) -> PhotometricFile:
    """Read an IES LM-63, EULUMDAT or TM-33 file. Raises :class:`InputError`, one line, if it cannot be used."""
    path = Path(path)
    text, warnings = text_of(read_file(path, missing=f"give an {_NAMES} file", most_bytes=_MOST_BYTES))
    for entry in _FORMATS.values():
        if entry.matches(text):
            found = entry.decode(text, str(path))
            return replace(found, warnings=(*warnings, *found.warnings))
    raise InputError(f"{path}: neither IES LM-63 nor EULUMDAT nor TM-33; export one of these")


def is_photometric(path: Path) -> bool:
    """True where the content of ``path`` is recognised as one of the formats; False where it cannot be read."""
    try:
        text, _ = text_of(read_file(path, missing="", most_bytes=_MOST_BYTES))
    except InputError:
        return False
    return any(entry.matches(text) for entry in _FORMATS.values())


def write_photometric(path: Path, photometric: PhotometricFile, *, ies_version: IesVersion = NEWEST) -> None:
    """Write ``path``; its suffix, .ies, .ldt, .iesxml or .xml, chooses the format.

    ``ies_version``: year of LM-63 that an IES file follows: 2019, 2002, 1995, 1991 or 1986.
    """
    entry = _FORMATS.get(Path(path).suffix.lower())
    if entry is None:
        raise InputError(f"{path}: its suffix must be one of {', '.join(_FORMATS)}")
    text = ies.encode(photometric, ies_version) if entry is IES else entry.encode(photometric)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(text.encode(entry.encoding, "replace"))
