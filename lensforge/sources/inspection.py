"""Inspection of a file of light by its content: rays, or the far field of a photometric file."""

from pathlib import Path
from typing import TYPE_CHECKING

from lensforge.sources.photometric import is_photometric
from lensforge.sources.photometric.summary import PhotometricSummary, summarise_photometric

if TYPE_CHECKING:
    from lensforge.sources.rayfiles.summary import RayFileSummary

_SUFFIXES = (".ies", ".ldt", ".iesxml")


def holds_far_field(path: Path) -> bool:
    """True for a photometric file, whatever its name, and for one that is only named so and holds no rays."""
    from lensforge.sources.rayfiles import is_rayfile

    if not path.is_file() or is_rayfile(path):
        return False
    return is_photometric(path) or path.suffix.lower() in _SUFFIXES


def inspect(path: Path) -> "RayFileSummary | PhotometricSummary":
    """Summarise a ray file or a photometric file. Raises :class:`InputError` if it is neither."""
    from lensforge.sources.rayfiles import describe, read_rayfile

    return summarise_photometric(path) if holds_far_field(path) else describe(read_rayfile(path))
