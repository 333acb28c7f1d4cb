"""One module for each ray-file format; being in this folder is all it takes to be known.

A module ends with ``FORMAT``, a :class:`Format`.
"""

from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules

from lensforge.sources.rayfiles.format import Format


def _discover() -> dict[str, Format]:
    found = (import_module(f"{__name__}.{module.name}").FORMAT for module in iter_modules(__path__))
    return {entry.name: entry for entry in found}


FORMATS: Mapping[str, Format] = _discover()
