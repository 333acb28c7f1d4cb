"""Reading, writing and conversion of ray files; the format is recognised by the content, never by the name."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from lensforge.errors import InputError
from lensforge.results.files import replacing
from lensforge.sources.rayfiles.formats import FORMATS, format_of
from lensforge.sources.rayfiles.formats.zemax import NM_PER_MICRON
from lensforge.sources.rayfiles.ray_file import SAME_FLUX, FluxUnit, Format, RayFile, UnknownRayFormat, column_product
from lensforge.sources.rayfiles.ray_file_rows import FileImage, as_float64, as_plain_text, release_pages, scaled

_MICRONS_BELOW = 100.0  # no light has a wavelength of less than 100 nm here; such a number is in µm
_COPIED = 2**24  # bytes copied at a time
_SAMPLE = 1000  # wavelengths looked at to tell µm from nm


def read_rayfile(path: Path) -> RayFile:
    """Read ``path``, whatever its format; binary files are mapped, not loaded.

    Raises :class:`InputError`, one line, if the file is missing, damaged, or of no known format.
    """
    return decode(FileImage.open(path))


def is_rayfile(path: Path) -> bool:
    """True if the content of ``path`` is recognised as one of the formats, damaged or not."""
    try:
        image = FileImage.open(path)
    except InputError:
        return False
    return format_of(as_plain_text(image)) is not None


def decode(image: FileImage) -> RayFile:
    """Decode a mapped file, whatever its format."""
    text = as_plain_text(image)
    layout = format_of(text)
    if layout is None:
        titles = ", ".join(entry.title for entry in FORMATS.values())
        refused = image.refuse(
            f"its content is none of the known formats ({titles}); the layouts of other programs are not public: "
            "export TM-25 (.tm25ray), LightTools or Zemax from there"
        )
        raise UnknownRayFormat(str(refused))
    rayfile = _with_checked_directions(replace(_in_nanometres(layout.decode(text)), path=str(image.path)))
    object.__setattr__(rayfile, "verbatim", image.data)
    return rayfile


def write_rayfile(path: Path, rayfile: RayFile, format: str | None = None) -> Format:
    """Write ``rayfile`` as ``format``, or as the format of the suffix of ``path``; return the format used.

    A file that was read and not changed is written to its own format byte for byte. Elsewhere lengths become mm, and
    fluxes absolute: they are scaled so that the file written means the same total as the file read.
    Raises :class:`InputError` if the format is unknown or cannot hold these rays, or the path cannot be written.
    """
    if format and format not in FORMATS:
        raise InputError(f"format {format!r}: one of {', '.join(FORMATS)}")
    chosen = FORMATS[format] if format else _format_for(Path(path))
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


@dataclass(frozen=True)
class Conversion:
    """Conversion of a ray file: formats, size, and the data that the new format could not hold."""

    from_format: str
    to_format: str
    rays: int
    bytes: int
    lost: tuple[str, ...]
    warnings: tuple[str, ...]


def convert(path_in: Path, path_out: Path, format: str | None = None) -> Conversion:
    """Convert ``path_in`` to ``path_out``; report the formats, the number of rays, and all that was lost on the way.

    Rays, and the total in their unit, are kept by every format; the total in the other unit, wavelengths and spectra
    are kept where the new format has a place for them.
    """
    rayfile = read_rayfile(path_in)
    chosen = write_rayfile(path_out, rayfile, format)
    return Conversion(
        from_format=rayfile.format,
        to_format=chosen.name,
        rays=len(rayfile),
        bytes=Path(path_out).stat().st_size,
        lost=tuple(_lost(rayfile, read_rayfile(path_out))),
        warnings=rayfile.warnings,
    )


def _lost(before: RayFile, after: RayFile) -> Iterator[str]:
    """Statements of ``before`` that ``after``, the same rays in another format, lacks."""
    if after.format == before.format:
        return  # copied byte for byte
    units: tuple[FluxUnit, ...] = ("W", "lm")
    for unit in units:
        had = before.flux_in(unit)
        has = after.flux_in(unit)
        if had and (has is None or abs(has / had - 1.0) > SAME_FLUX):
            yield f"total flux in {unit} ({had:.6g})"
    if before.wavelengths_nm is not None and after.wavelengths_nm is None:
        yield "wavelengths"
    if before.spectral_tables and not after.spectral_tables:
        yield "spectral tables"
    if before.spectrum_numbers is not None and after.spectrum_numbers is None:
        yield "spectral table of each ray"
    columns = before.header.get("unused_columns")
    if isinstance(columns, list) and columns:
        yield f"columns: {', '.join(map(str, columns))}"


def _format_for(path: Path) -> Format:
    fitting = [entry for entry in FORMATS.values() if path.suffix.lower() in entry.suffixes]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(
            f"{path}: {path.suffix} may be {' or '.join(entry.name for entry in fitting)}; choose by --format "
            f"{fitting[0].name}, in a script format={fitting[0].name!r}"
        )
    suffixes = sorted({suffix for entry in FORMATS.values() for suffix in entry.suffixes})
    raise InputError(f"{path}: not the suffix of a ray-file format; one of {', '.join(suffixes)}")


def _in_nanometres(rayfile: RayFile) -> RayFile:
    """Convert wavelengths that can only be in µm, whatever their format states, to nm, with a warning."""
    warnings = list(rayfile.warnings)
    header = dict(rayfile.header)
    waves = rayfile.wavelengths_nm
    if waves is not None:
        with np.errstate(invalid="ignore"):
            sample = np.nan_to_num(waves[:_SAMPLE].astype(np.float64), posinf=0.0, neginf=0.0)
        if 0.0 < sample.max() < _MICRONS_BELOW:
            warnings.append(f"wavelengths below {_MICRONS_BELOW:g} nm: taken as µm")
            waves = scaled(waves, NM_PER_MICRON)
    tables = rayfile.spectral_tables
    longest = max((float(table.wavelengths_nm.max(initial=0.0)) for table in tables), default=0.0)
    if 0.0 < longest < _MICRONS_BELOW:
        warnings.append(f"wavelengths of the spectral tables below {_MICRONS_BELOW:g} nm: taken as µm")
        header["spectral_tables"] = [
            {
                "wavelength_nm": (NM_PER_MICRON * table.wavelengths_nm).tolist(),
                "weight": (table.power_density / NM_PER_MICRON).tolist(),
            }
            for table in tables
        ]
    return replace(rayfile, wavelengths_nm=waves, header=header, warnings=tuple(warnings))


_UNIT_LENGTH = 0.01  # error of a direction's length: two digits of its cosines
_VECTORS = 0.1, 10.0  # typical lengths beyond this, and not all the same, are of angles in degrees, or of no vectors


def _with_checked_directions(rayfile: RayFile) -> RayFile:
    """The rays, with a warning where their directions are not of length 1, by some of them.

    Raises :class:`InputError` for numbers that can be no direction cosines, such as angles in degrees.
    """
    cosines = as_float64(rayfile.directions[:: max(1, len(rayfile) // _SAMPLE)])
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.sqrt(column_product(cosines, cosines))
    lengths = lengths[(lengths > 0.0) & (lengths < np.inf)]
    if not len(lengths) or np.mean(np.abs(lengths - 1.0) > _UNIT_LENGTH) <= _UNIT_LENGTH:
        return rayfile
    low, typical, high = np.quantile(lengths, (0.01, 0.5, 0.99))
    fault = f"its direction cosines have lengths of {low:.4g} to {high:.4g}, must be 1"
    alike = high - low < _UNIT_LENGTH * typical
    if not (alike or _VECTORS[0] <= typical <= _VECTORS[1]):
        raise InputError(f"{rayfile.path}: {fault}: are they angles? Export direction cosines")
    return replace(rayfile, warnings=(*rayfile.warnings, f"{fault}: taken for the directions of such vectors"))
