"""Vendors' ray files: one module for each format in ``formats``, each registers itself."""

from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.reading import convert, read_rayfile, write_rayfile
from lensforge.sources.rayfiles.record import RayFile
from lensforge.sources.rayfiles.statistics import describe, outline

__all__ = ["FORMATS", "RayFile", "convert", "describe", "outline", "read_rayfile", "write_rayfile"]
