"""Conversion between IES LM-63, EULUMDAT and TM-33, with an account of what the new file says differently."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensforge.errors import InputError
from lensforge.records import Count, Record, Text
from lensforge.records.validation import shortened
from lensforge.sources.photometric.generation import UNDEFINED
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion
from lensforge.sources.photometric.reading import read_photometric, write_photometric
from lensforge.sources.photometric.record import PhotometricFile

_SAME = 1e-6  # relative: numbers are written with seven digits
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
    Raises :class:`InputError` for a suffix of another format, and where the intensities would not be the same.
    """
    found, warnings = read_photometric(path_in), []
    kept = replace(found, test=f"{found.test} (converted from {shortened(Path(path_in).name)} by lensforge)".strip())
    if Path(path_out).suffix.lower() == ".ldt" and found.lamp_lumens is None:
        warnings.append(
            "absolute photometry: the lumens of the luminaire are written as those of its lamps, whose number is -1"
        )
    write_photometric(path_out, kept, ies_version=ies_version)
    back = read_photometric(path_out)
    if not _same_intensities(kept, back):
        raise InputError(f"{path_out}: its intensities read back are not those of {path_in}; report this")
    return PhotometricConversion(
        from_format=found.format,
        to_format=back.format,
        planes=max(len(back.intensity.c_deg) - 1, 1),
        gammas=len(back.intensity.gamma_deg),
        bytes=Path(path_out).stat().st_size,
        lost=tuple(_lost(found, back)),
        warnings=(*found.warnings, *warnings),
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
        yield f"photometric type {before.photometric_type}: the angles are those of type {after.photometric_type}"
