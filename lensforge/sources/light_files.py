"""Files of light from outside: rays, or the far field of a lamp; either in place of the other is recognised."""

from pathlib import Path
from typing import TYPE_CHECKING

from lensforge.errors import InputError
from lensforge.sources.photometric import photometric_io
from lensforge.sources.photometric.photometric_file import PhotometricFile, UnknownFarField

if TYPE_CHECKING:
    from lensforge.sources.rayfiles.ray_file import RayFile

_SUFFIXES = (".ies", ".ldt", ".iesxml")


def read_rayfile(path: Path) -> "RayFile":
    """Read the ray file ``path``, whatever its format; binary files are mapped, not loaded.

    Raises :class:`InputError`, one line, if the file is missing, damaged, or no ray file.
    """
    from lensforge.sources.rayfiles import ray_file, ray_file_io

    try:
        return ray_file_io.read_rayfile(path)
    except ray_file.UnknownRayFormat:
        far_field = photometric_io.photometric_format(path)
        if far_field is None:
            raise
    raise InputError(
        f"{path}: a photometric file ({far_field.title}), without rays: use it as the intensity of a source or as "
        'a target, each of kind "photometric"'
    )


def read_photometric(path: Path) -> PhotometricFile:
    """Read the photometric file ``path``. Raises :class:`InputError`, one line, if it cannot be used."""
    try:
        return photometric_io.read_photometric(path)
    except UnknownFarField:
        from lensforge.sources.rayfiles.formats import format_of
        from lensforge.sources.rayfiles.ray_file_rows import FileImage, as_plain_text

        rays = format_of(as_plain_text(FileImage.open(path)))
        if rays is None:
            raise
    raise InputError(f'{path}: a ray file ({rays.title}): use it as a source of kind "rayfile"')


def holds_far_field(path: Path) -> bool:
    """True for a photometric file, whatever its name, and for one that is only named so and holds no rays."""
    from lensforge.sources.rayfiles.ray_file_io import is_rayfile

    if not path.is_file() or is_rayfile(path):
        return False
    return photometric_io.photometric_format(path) is not None or path.suffix.lower() in _SUFFIXES
