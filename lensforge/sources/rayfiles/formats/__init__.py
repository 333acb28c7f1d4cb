"""Formats of ray files: every module of this folder is one, or a binary and a text one, and registers what it has."""

from importlib import import_module
from pkgutil import iter_modules

from lensforge.sources.rayfiles.ray_file import FORMATS, Format
from lensforge.sources.rayfiles.ray_file_rows import HEAD_BYTES, FileImage

__all__ = ["FORMATS", "format_of"]

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")


def format_of(image: FileImage) -> Format | None:
    """The format of a file by its content, damaged or not; None of any other file."""
    head = image.part(0, HEAD_BYTES)
    return next((entry for entry in FORMATS.values() if entry.matches(head, image.size)), None)
