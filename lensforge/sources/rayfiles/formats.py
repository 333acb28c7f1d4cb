"""One module for each ray-file format, and the table of all: a new format is one file and one line here.

A module ends with ``FORMAT``, a :class:`Format`. Files are offered to the formats in this order.
"""

from collections.abc import Mapping

from lensforge.sources.rayfiles import (
    asap,
    csv_table,
    lighttools_binary,
    lighttools_text,
    speos,
    speos_text,
    tm25,
    zemax_binary,
    zemax_text,
)
from lensforge.sources.rayfiles.ray_file import Format

_MODULES = (
    asap, csv_table, lighttools_binary, lighttools_text, speos, speos_text, tm25, zemax_binary, zemax_text,
)  # fmt: skip

FORMATS: Mapping[str, Format] = {module.FORMAT.name: module.FORMAT for module in _MODULES}
