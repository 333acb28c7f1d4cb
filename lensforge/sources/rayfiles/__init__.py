"""Vendors' ray files: one module for each format in ``formats``."""

from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.rayfile import RayFile
from lensforge.sources.rayfiles.reading import convert, is_rayfile, read_rayfile, write_rayfile
from lensforge.sources.rayfiles.statistics import describe, outline
from lensforge.sources.rayfiles.summary import Conversion, RayFileHeader, RayFileSummary

__all__ = [
    "FORMATS",
    "Conversion",
    "RayFile",
    "RayFileHeader",
    "RayFileSummary",
    "convert",
    "describe",
    "is_rayfile",
    "outline",
    "read_rayfile",
    "write_rayfile",
]
