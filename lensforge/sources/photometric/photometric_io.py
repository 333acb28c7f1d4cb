"""Reading, writing and conversion of photometric files; the format is recognised by the content.

Encoding, line ends and end marks vary by program and age. The report of a conversion goes through the fields of the
record, and lists those that the new format cannot hold.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from lensforge.errors import InputError, shortened
from lensforge.results.files import MIB, read_file, write_file
from lensforge.results.text_dialect import decoded
from lensforge.sources.photometric import ies
from lensforge.sources.photometric.eulumdat import FORMAT as EULUMDAT
from lensforge.sources.photometric.ies import FORMAT as IES
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion
from lensforge.sources.photometric.opening import NO_OPENING, LuminousOpening
from lensforge.sources.photometric.photometric_file import (
    UNDEFINED,
    LampSet,
    PhotometricFile,
    PhotometricFormat,
    UnknownFarField,
)
from lensforge.sources.photometric.tm33 import FORMAT as TM33
from lensforge.sources.photometric.tm33_document import INDEX, KELVIN, whole_in

_LINE_END = re.compile(r"\r*\n|\r")  # Unix, DOS (also with the carriage return doubled), old Macintosh
_END_OF_TEXT = "\x1a"  # Ctrl-Z, after which DOS reads nothing
_PADDING = "\0\x1a \t\n"


def text_of(content: bytes) -> tuple[str, tuple[str, ...]]:
    """Text of a file with "\\n" for line ends, up to its end mark; and warnings on text left out.

    UTF-8 and UTF-16, with a byte-order mark or without, then Windows-1252, in which byte 85 hex is an ellipsis and not,
    as in Unicode, the end of a line.
    """
    text = _LINE_END.sub("\n", decoded(content).replace("\x85", "…"))
    text, mark, behind_mark = text.partition(_END_OF_TEXT)
    left_out = behind_mark.strip(_PADDING)
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
    raise UnknownFarField(f"{name}: neither IES LM-63 nor EULUMDAT nor TM-33; export one of these")


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
    write_file(path, encoded(Path(path), photometric, ies_version))


def encoded(path: Path, photometric: PhotometricFile, ies_version: IesVersion = NEWEST) -> bytes:
    """Content of the file that :func:`write_photometric` writes. Raises :class:`InputError` for another suffix."""
    entry = _FORMATS.get(path.suffix.lower())
    if entry is None:
        raise InputError(f"{path}: its suffix must be one of {', '.join(_FORMATS)}")
    text = ies.encode(photometric, ies_version) if entry is IES else entry.encode(photometric)
    return text.encode(entry.encoding, "replace")


_SAME = 1e-6  # relative: numbers are written with seven digits
_SAME_STATED = 1e-4  # of numbers of a header


@dataclass(frozen=True)
class PhotometricConversion:
    """Conversion of a photometric file: formats, size of the table, and what the new file lost."""

    from_format: str
    to_format: str
    planes: int
    gammas: int
    bytes: int
    lost: tuple[str, ...]
    warnings: tuple[str, ...]


def convert_photometric(path_in: Path, path_out: Path, *, ies_version: IesVersion = NEWEST) -> PhotometricConversion:
    """Convert ``path_in`` to the format of the suffix of ``path_out``; the new file is read back and compared.

    ``ies_version``: year of LM-63 that an IES file follows.
    Raises :class:`InputError` for a suffix of another format.
    """
    original = read_photometric(path_in)
    warnings = []
    written = replace(
        original, test=f"{original.test} (converted from {shortened(Path(path_in).name)} by lensforge)".strip()
    )
    if Path(path_out).suffix.lower() == ".ldt" and original.absolute:
        warnings.append(
            "absolute photometry: the lumens of the luminaire are written as lumens of its lamps, whose number is -1"
        )
    elif original.per_1000_lm and Path(path_out).suffix.lower() != ".ldt":
        warnings.append("the lumens of its lamps are not known: 1000 lm are written, for which its intensities are")
    write_photometric(path_out, written, ies_version=ies_version)
    back = read_photometric(path_out)
    if not _same_intensities(written, back):
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
    """True if both have the same table, to the digits written."""
    first = before.intensity
    second = after.intensity
    if first.values.shape != second.values.shape:
        return False
    peak = float(first.values.max())
    return bool(
        np.allclose(first.gamma_deg, second.gamma_deg, rtol=_SAME, atol=1e-9)
        and np.allclose(first.c_deg, second.c_deg, rtol=_SAME, atol=1e-9)
        and np.allclose(first.values, second.values, rtol=0.0, atol=_SAME * peak)
    )


def _lost(before: PhotometricFile, after: PhotometricFile) -> Iterator[str]:
    """Statements of ``before`` that ``after`` lacks or contradicts."""
    if after.test.startswith(before.test):  # which a conversion adds to
        after = replace(after, test=before.test)
    after = replace(after, stated_lumens=after.stated_lumens or after.intensity.flux())
    yield from _differences(before, after)
    yield from _differences(before.lamps[0], after.lamps[0])
    further = before.lamps[1:]
    if further != after.lamps[1:]:
        yield f"{len(further)} other sets of lamps ({'; '.join(map(str, further))})"
    left = list(after.others)
    for entry in before.others:
        if entry in left:
            left.remove(entry)
        else:
            yield f"{entry[0]} ({shortened(entry[1])})" if entry[1] else entry[0]
    if before.photometric_type != after.photometric_type:
        yield f"photometric type {before.photometric_type}: the angles are now of type {after.photometric_type}"


def _differences(before: PhotometricFile | LampSet, after: PhotometricFile | LampSet) -> Iterator[str]:
    """Labels of the fields of ``before`` whose statements differ in ``after``."""
    for field in fields(before):
        label = field.metadata.get("label")
        had = getattr(before, field.name)
        has = getattr(after, field.name)
        if not label or not had or had in (UNDEFINED, _UNSTATED.get(field.name)) or _same(had, has, field.name):
            continue
        if isinstance(had, tuple) and isinstance(had[0], str):
            yield from (f"{label} ({shortened(entry)})" for entry in had if entry not in has)
        elif isinstance(had, tuple):
            yield f"{label} ({', '.join(f'{number:.6g}' for number in had)})"
        elif had is True:
            yield label
        else:
            yield f"{label} ({had:.6g})" if isinstance(had, float) else f"{label} ({had})"


# Values of fields that state nothing.
_UNSTATED = {"ballast_factor": 1.0, "opening": NO_OPENING, "housing_mm": (0.0, 0.0, 0.0)}
_WHOLE = {"colour": KELVIN, "rendering": INDEX}  # texts that TM-33 has as numbers


def _same(had: object, has: object, name: str) -> bool:
    """True if two values agree: numbers to the digits of a header, also numbers that TM-33 holds as text."""
    if isinstance(had, LuminousOpening) and isinstance(has, LuminousOpening):
        return had.shape == has.shape and _close(_sizes(had), _sizes(has))
    if name in _WHOLE and isinstance(had, str) and isinstance(has, str):
        return had == has or "" != whole_in(had, _WHOLE[name]) == whole_in(has, _WHOLE[name])
    if isinstance(had, float) and isinstance(has, float):
        return _close((had,), (has,))
    if isinstance(had, tuple) and isinstance(has, tuple) and not isinstance(had[0], str):
        return _close(had, has)
    return had == has


def _sizes(opening: LuminousOpening) -> tuple[float, ...]:
    return (opening.width_mm, opening.length_mm, *opening.heights_mm)


def _close(had: tuple[float, ...], has: tuple[float, ...]) -> bool:
    return len(had) == len(has) and np.allclose(had, has, rtol=_SAME_STATED, atol=1e-9)
