"""Reading, writing and conversion of photometric files; the format is recognised by the content.

Encoding, line ends and end marks vary by program and age. A conversion has an account of what the new file says
differently.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensforge.errors import InputError
from lensforge.results import Count, Record, Text
from lensforge.results.files import MIB, read_file, replacing
from lensforge.results.validation import shortened
from lensforge.sources.photometric import ies
from lensforge.sources.photometric.eulumdat import FORMAT as EULUMDAT
from lensforge.sources.photometric.ies import FORMAT as IES
from lensforge.sources.photometric.ies import NEWEST, IesVersion
from lensforge.sources.photometric.photometric_file import UNDEFINED, PhotometricFile
from lensforge.sources.photometric.tm33 import FORMAT as TM33

_LINE_END = re.compile(r"\r*\n|\r")  # Unix, DOS (also with the carriage return doubled), old Macintosh
_END_OF_TEXT = "\x1a"  # Ctrl-Z, after which DOS reads nothing
_PADDING = "\0\x1a \t\n"
_SAMPLE = 512  # bytes that tell UTF-16 without a mark
_NUL_SHARE = 0.8  # at least, of every second byte in UTF-16 of mostly ASCII; other encodings have NULs as padding only


def text_of(content: bytes) -> tuple[str, tuple[str, ...]]:
    """Text of a file with "\\n" for line ends, up to its end mark; and warnings on anything that was left out.

    UTF-8 and UTF-16, with a byte-order mark or without, then Windows-1252, in which byte 85 hex is an ellipsis and
    not, as in Unicode, the end of a line.
    """
    text = _LINE_END.sub("\n", _decoded(content))
    text, mark, rest = text.partition(_END_OF_TEXT)
    left_out = rest.strip(_PADDING)
    warning = f"{len(left_out)} characters after its end mark (Ctrl-Z) are left out"
    return text.rstrip(_PADDING), (warning,) if mark and left_out else ()


def _decoded(content: bytes) -> str:
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, "replace")
    head = content[:_SAMPLE]
    for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
        if _NUL_SHARE * len(zeros) < zeros.count(0) > 0.5 * head.count(0):
            return content.decode(encoding, "replace")
    for encoding in ("utf-8", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    return content.decode("latin-1").replace("\x85", "…")


_FORMATS = {entry.suffix: entry for entry in (IES, EULUMDAT, TM33)} | {".xml": TM33}

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
    raise InputError(f"{name}: neither IES LM-63 nor EULUMDAT nor TM-33; export one of these")


def is_photometric(path: Path) -> bool:
    """True where the content of ``path`` is recognised as one of the formats; False where it cannot be read."""
    try:
        text, _ = text_of(read_file(path, missing="", most_bytes=_MOST_BYTES))
    except InputError:
        return False
    return any(entry.matches(text) for entry in _FORMATS.values())


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


_FIELDS = {
    "lamp_lumens": "lumens of the lamps",
    "stated_lumens": "stated lumens of the luminaire",
    "watts": "watts",
    "diameter_mm": "diameter of the opening",
    "title": "name of the luminaire",
    "maker": "maker",
    "catalogue": "catalogue number",
    "laboratory": "laboratory",
    "issued": "date of issue",
    "generated": "generation of the data",
}


_SAME = 1e-6  # relative: numbers are written with seven digits


class PhotometricConversion(Record):
    """Conversion of a photometric file: formats, size of the table, and what the new file lost."""

    from_format: Text
    to_format: Text
    planes: Count
    gammas: Count
    bytes: Count
    lost: tuple[Text, ...]
    warnings: tuple[Text, ...]


def convert_photometric(path_in: Path, path_out: Path, *, ies_version: IesVersion = NEWEST) -> PhotometricConversion:
    """Convert ``path_in`` to the format of the suffix of ``path_out``; the new file is read back and compared.

    ``ies_version``: year of LM-63 that an IES file follows.
    Raises :class:`InputError` for a suffix of another format.
    """
    original, warnings = read_photometric(path_in), []
    kept = replace(
        original, test=f"{original.test} (converted from {shortened(Path(path_in).name)} by lensforge)".strip()
    )
    if Path(path_out).suffix.lower() == ".ldt" and original.lamp_lumens is None:
        warnings.append(
            "absolute photometry: the lumens of the luminaire are written as lumens of its lamps, whose number is -1"
        )
    write_photometric(path_out, kept, ies_version=ies_version)
    back = read_photometric(path_out)
    if not _same_intensities(kept, back):
        raise InputError(f"{path_out}: its intensities read back are not those of {path_in}; report this")
    return PhotometricConversion(
        from_format=original.format,
        to_format=back.format,
        planes=max(len(back.intensity.c_deg) - 1, 1),
        gammas=len(back.intensity.gamma_deg),
        bytes=Path(path_out).stat().st_size,
        lost=tuple(_lost(original, back)),
        warnings=(*original.warnings, *warnings),
    )


def _same_intensities(before: PhotometricFile, after: PhotometricFile) -> bool:
    """True where both have the same table, to the digits written."""
    one, other = before.intensity, after.intensity
    if one.values.shape != other.values.shape:
        return False
    peak = float(one.values.max())
    return bool(
        np.allclose(one.gamma_deg, other.gamma_deg, rtol=_SAME, atol=1e-9)
        and np.allclose(one.c_deg, other.c_deg, rtol=_SAME, atol=1e-9)
        and np.allclose(one.values, other.values, rtol=0.0, atol=_SAME * peak)
    )


def _lost(before: PhotometricFile, after: PhotometricFile) -> Iterator[str]:
    """List the statements of ``before`` that ``after`` does not make, or makes differently."""
    for name, words in _FIELDS.items():
        had, has = getattr(before, name), getattr(after, name)
        same = abs(has - had) <= 1e-4 * abs(had) if isinstance(had, float) and isinstance(has, float) else has == had
        if had and had != UNDEFINED and not same:
            yield f"{words} ({had:.6g})" if isinstance(had, float) else f"{words} ({had})"
    if before.photometric_type != after.photometric_type:
        yield f"photometric type {before.photometric_type}: the angles are now of type {after.photometric_type}"
