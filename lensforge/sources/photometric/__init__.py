"""Photometric files, the far field of a luminaire: IES LM-63, EULUMDAT and TM-33, read and written."""

from lensforge.sources.photometric.reading import is_photometric, read_photometric, write_photometric
from lensforge.sources.photometric.record import PhotometricFile

__all__ = ["PhotometricFile", "is_photometric", "read_photometric", "write_photometric"]
