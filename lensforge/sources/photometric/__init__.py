"""Photometric files, the far field of a luminaire: IES LM-63, EULUMDAT and TM-33, read and written."""

from lensforge.sources.photometric.photometric_file import PhotometricFile
from lensforge.sources.photometric.photometric_io import read_photometric, write_photometric

__all__ = ["PhotometricFile", "read_photometric", "write_photometric"]
