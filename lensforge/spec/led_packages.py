"""Classes of LED packages by name, such as ``3030`` or ``COB LES 9``: the ``[source]`` that each stands for.

The table holds sizes that are common to a class. A chip in a dome of index n is seen n times as large, as the étendue
of its light is n² times that of the bare chip (Winston, Minano and Benitez, Nonimaging Optics, 2005, chapter 2).
"""

from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from math import cos, log, radians
from pathlib import Path
from typing import Any

from lensforge.results.text_table import shipped_rows
from lensforge.spec.source_sections import DiscSource, RectangleSource, SquareSource

_TABLE = Path(__file__).with_name("led_packages.csv")
_SIZES = {
    "square": SquareSource.in_a_word,
    "rectangle": RectangleSource.in_a_word,
    "disc": DiscSource.in_a_word,
}
_NUMBERS = ("width_mm", "height_mm", "dome_index", "beam_deg", "least", "most")
_LAMBERTIAN_DEG = 120.0  # full width at half intensity of a cosine


@dataclass(frozen=True)
class LedPackage:
    """A class of LED packages.

    ``shape``: kind of its source, square, rectangle or disc. ``width_mm``, ``height_mm``: of the area that emits.
    ``dome_index``: of the dome around it, 1 without one. ``beam_deg``: full width at half intensity. ``least``,
    ``most``: flux of a weak and of a strong one, in ``unit``, lm or W.
    """

    name: str
    shape: str
    unit: str
    width_mm: float
    height_mm: float
    dome_index: float
    beam_deg: float
    least: float
    most: float

    @property
    def source(self) -> dict[str, Any]:
        """The ``[source]`` for it: the area as it is seen, through its dome."""
        seen_mm = [round(self.dome_index * size, 3) for size in (self.width_mm, self.height_mm)]
        table = {"kind": self.shape, **dict(zip(_SIZES[self.shape], seen_mm, strict=False))}
        if self.beam_deg == _LAMBERTIAN_DEG:
            return table
        power = log(0.5) / log(cos(radians(0.5 * self.beam_deg)))
        return {**table, "intensity": {"kind": "cosine", "power": round(power, 3)}}

    @property
    def phrase(self) -> str:
        """The area that emits, its dome and its flux in a few words."""
        disc = f"disc of {self.width_mm:g} mm"
        area = disc if self.shape == "disc" else f"{self.width_mm:g} × {self.height_mm:g} mm"
        dome = f" in a dome of index {self.dome_index:g}" if self.dome_index > 1.0 else ""
        beam = "" if self.beam_deg == _LAMBERTIAN_DEG else f", beam of {self.beam_deg:g}°"
        return f"{area}{dome}{beam}, {self.least:g} to {self.most:g} {self.unit}"


@cache
def led_packages() -> dict[str, LedPackage]:
    """All packages by their names."""
    rows = shipped_rows(_TABLE, ("name", "shape", "unit"), _NUMBERS)
    return {row["name"]: LedPackage(**row) for row in rows}


def led_package(name: str) -> LedPackage | None:
    """The package of that ``name``, in which case and hyphens do not count; None if there is none."""
    return {_plain(known): package for known, package in led_packages().items()}.get(_plain(name))


def near_packages(name: str) -> list[str]:
    """Names of a few packages that are spelt like ``name``; empty if none is."""
    known = {_plain(package): package for package in led_packages()}
    return [known[near] for near in get_close_matches(_plain(name), known, n=4)]


def _plain(name: str) -> str:
    return " ".join(name.lower().replace("-", " ").replace("_", " ").split())
