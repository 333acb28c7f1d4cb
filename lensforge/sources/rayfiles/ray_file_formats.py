"""Formats of ray files, by name, and which of them a file is by its content."""

from collections.abc import Mapping

from lensforge.sources.rayfiles import asap, csv_table, lighttools, speos, tm25, zemax
from lensforge.sources.rayfiles.ray_file import Format
from lensforge.sources.rayfiles.ray_file_rows import HEAD_BYTES, FileImage

FORMATS: Mapping[str, Format] = {
    entry.name: entry
    for entry in (
        asap.BINARY, csv_table.TEXT, lighttools.BINARY, lighttools.TEXT, speos.BINARY, speos.TEXT, tm25.BINARY,
        zemax.BINARY, zemax.TEXT,
    )
}  # fmt: skip
"""All formats by name: a new one is a module and an entry here. Files are offered to them in this order."""


def format_of(image: FileImage) -> Format | None:
    """The format of a file by its content, damaged or not; None of any other file."""
    head = image.part(0, HEAD_BYTES)
    return next((entry for entry in FORMATS.values() if entry.matches(head, image.size)), None)
