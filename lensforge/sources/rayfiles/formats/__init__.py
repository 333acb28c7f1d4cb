"""One module for each ray-file format, and the table of all: a new format is one file and one line here.

A module ends with ``FORMAT``, a :class:`Format`. Files are offered to the formats in this order.
"""

from collections.abc import Mapping

from lensforge.sources.rayfiles.format import Format
from lensforge.sources.rayfiles.formats import (
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

_MODULES = (
    asap, csv_table, lighttools_binary, lighttools_text, speos, speos_text, tm25, zemax_binary, zemax_text,
)  # fmt: skip

FORMATS: Mapping[str, Format] = {module.FORMAT.name: module.FORMAT for module in _MODULES}
