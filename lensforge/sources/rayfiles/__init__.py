"""Vendors' ray files: one module for each format in ``formats``."""

from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import convert, is_rayfile, read_rayfile, write_rayfile
from lensforge.sources.rayfiles.ray_file_statistics import describe, outline
from lensforge.sources.rayfiles.ray_file_summary import Conversion, RayFileHeader, RayFileSummary

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
