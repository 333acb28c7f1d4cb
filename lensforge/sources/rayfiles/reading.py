"""Reading, writing and conversion of ray files; the format is recognised by the content, never by the name."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.sources.rayfiles.binary import FileImage, release_pages, scaled
from lensforge.sources.rayfiles.format import HEAD_BYTES, Format
from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.formats.zemax_binary import NM_PER_MICRON
from lensforge.sources.rayfiles.rayfile import RayFile
from lensforge.sources.rayfiles.summary import Conversion

# Suffixes of formats whose layout is not public, and the programs that write them.
_PRIVATE = {
    ".fcr": "FRED",
    ".frbs": "FRED",
    ".rs8": "SimuLux",
    ".oml": "TracePro",
    ".ray": "TracePro, LucidShape, FRED or OPTICAD",
    ".dat": "OPTICAD or TracePro",
    ".raydat": "Photopia",
}
_MICRONS_BELOW = 100.0  # no light has a wavelength of less than 100 nm here; such a number is in µm
_COPIED = 2**24  # bytes copied at a time
_SAMPLE = 1000  # wavelengths looked at to tell µm from nm


def read_rayfile(path: Path) -> RayFile:
    """Read ``path``, whatever its format; binary files are mapped, not loaded.

    Raises :class:`InputError`, one line, if the file is missing, damaged, or of no known format.
    """
    image = FileImage.open(path)
    return decode(image)


def decode(image: FileImage) -> RayFile:
    """Decode a mapped file, whatever its format."""
    rayfile = replace(_in_nanometres(_format_of(image).decode(image)), path=str(image.path))
    object.__setattr__(rayfile, "verbatim", image.data)
    return rayfile


def write_rayfile(path: Path, rayfile: RayFile, format: str | None = None) -> Format:
    """Write ``rayfile`` as ``format``, or as the format of the suffix of ``path``; return the format used.

    A file that was read and not changed is written to its own format byte for byte. Elsewhere lengths become mm, and
    fluxes absolute: they are scaled so that the file written means the same total as the file read.
    Raises :class:`InputError` if the format is unknown or cannot hold these rays, or the path cannot be written.
    """
    chosen = _format_named(format) if format else _format_for(Path(path))
    with replacing(Path(path)) as temporary, temporary.open("wb") as stream:
        if rayfile.verbatim is not None and rayfile.format == chosen.name:
            stream.writelines(_bytes(rayfile.verbatim))
        else:
            stream.writelines(chosen.encode(rayfile))
    return chosen


def _bytes(content: UInt8[np.ndarray, " bytes"]) -> Iterator[memoryview]:
    for start in range(0, len(content), _COPIED):
        yield content[start : start + _COPIED].data
        release_pages(content)


def convert(path_in: Path, path_out: Path, format: str | None = None) -> Conversion:
    """Convert ``path_in`` to ``path_out``; report the formats, the number of rays, and any lost data."""
    rayfile = read_rayfile(path_in)
    chosen = write_rayfile(path_out, rayfile, format)
    back = read_rayfile(path_out)
    lost = ["wavelengths"] * (rayfile.wavelengths_nm is not None and back.wavelengths_nm is None)
    lost += ["spectral tables"] * (bool(rayfile.spectral_tables) and "spectral_tables" not in back.header)
    lost += ["spectral table of each ray"] * (rayfile.spectrum_numbers is not None and back.spectrum_numbers is None)
    return Conversion(
        from_format=rayfile.format,
        to_format=chosen.name,
        rays=len(rayfile),
        bytes=Path(path_out).stat().st_size,
        lost=tuple(lost),
        warnings=rayfile.warnings,
    )


def _format_of(image: FileImage) -> Format:
    head = image.part(0, HEAD_BYTES)
    for entry in FORMATS.values():
        if entry.matches(head, image.size):
            return entry
    suffix = image.path.suffix.lower()
    known = ", ".join(entry.title for entry in FORMATS.values())
    if suffix in _PRIVATE:
        raise image.refuse(
            f"none of the known formats; if it is a file of {_PRIVATE[suffix]}, its layout is not public: "
            f"export TM-25 (.tm25ray), LightTools or Zemax from there"
        )
    raise image.refuse(f"its content is none of the known formats ({known}); export one of these")


def _format_named(name: str) -> Format:
    if name not in FORMATS:
        raise InputError(f"format {name!r}: one of {', '.join(FORMATS)}")
    return FORMATS[name]


def _format_for(path: Path) -> Format:
    fitting = [entry for entry in FORMATS.values() if path.suffix.lower() in entry.suffixes]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(
            f"{path}: {path.suffix} may be {' or '.join(entry.name for entry in fitting)}; say which format"
        )
    suffixes = sorted({suffix for entry in FORMATS.values() for suffix in entry.suffixes})
    raise InputError(f"{path}: not the suffix of a ray-file format; one of {', '.join(suffixes)}")


def _in_nanometres(rayfile: RayFile) -> RayFile:
    """Convert wavelengths that can only be µm, whatever their format says, to nm, with a warning."""
    if rayfile.wavelengths_nm is None:
        return rayfile
    with np.errstate(invalid="ignore"):
        sample = np.nan_to_num(rayfile.wavelengths_nm[:_SAMPLE].astype(np.float64), posinf=0.0, neginf=0.0)
    if not 0.0 < sample.max() < _MICRONS_BELOW:
        return rayfile
    warning = f"wavelengths below {_MICRONS_BELOW:g} nm: taken as µm"
    nanometres = scaled(rayfile.wavelengths_nm, NM_PER_MICRON)
    return replace(rayfile, wavelengths_nm=nanometres, warnings=(*rayfile.warnings, warning))
