"""Data of a material as its file states them, in plain numbers: a spec keeps them, and needs the file no more."""

from dataclasses import dataclass

from lensforge.materials.formulas import Formula, IndexTable
from lensforge.materials.temperature import UNKNOWN, TemperatureLaw


@dataclass(frozen=True)
class MaterialData:
    """Index, the range (nm) in which it holds, and absorption (1/mm) at wavelengths (nm); ``source``: file and origin.

    ``absorption_nm`` and ``absorption_per_mm`` are empty where the file states none; ``temperature``: what it
    states of a change with temperature.
    """

    name: str
    index: Formula | IndexTable
    range_nm: tuple[float, float]
    absorption_nm: tuple[float, ...]
    absorption_per_mm: tuple[float, ...]
    source: str
    temperature: TemperatureLaw = UNKNOWN
