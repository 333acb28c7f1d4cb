"""Interface of a ray-file format."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from lensforge.errors import InputError
from lensforge.sources.rayfiles.binary import FileImage
from lensforge.sources.rayfiles.rayfile import RayFile

HEAD_BYTES = 2**14  # what ``matches`` gets to see


@dataclass(frozen=True)
class Format:
    """Ray-file format: ``matches(head, size)`` by content alone, ``decode`` a mapped file, ``encode`` in pieces.

    ``suffixes`` are only what files of this format are usually called; they help to choose a format for writing.
    ``decode`` raises :class:`InputError` for a damaged file, ``encode`` for rays that the format cannot hold.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    matches: Callable[[bytes, int], bool]
    decode: Callable[[FileImage], RayFile]
    encode: Callable[[RayFile], Iterator[bytes]]


def require_watts_with_wavelengths(rayfile: RayFile, title: str) -> None:
    """Refuse lumens with a wavelength for each ray where the format stores spectral flux in W only."""
    if rayfile.flux_unit == "lm" and rayfile.wavelengths_nm is not None:
        raise InputError(
            f"{title} holds wavelengths only with W, these rays are in lm; convert to lighttools_text or csv instead"
        )
