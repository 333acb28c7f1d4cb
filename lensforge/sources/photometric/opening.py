"""Luminous opening of a luminaire: its shape and sizes, and the signs by which LM-63 tells the shapes apart.

LM-63 states width, length and height; a size below 0 is that of a rounded edge, and its signs changed in 2002. Until
1995 one of the sizes of a round shape may be 0, where it is a diameter, too. The table of 2002 is that of its section
on the luminous opening, the one before is Ashdown's ("Parsing the IESNA LM-63 photometric data file", 1998); Radiance's
ies2rad has both. Files mix them: signs that only the other table has are read by that one. EULUMDAT and TM-33 know
rectangles and circles, with the heights of four sides. Lengths keep their names from format to format.
"""

from dataclasses import dataclass

import numpy as np

POINT = "point"
RECTANGLE = "rectangle"
BOX = "box"
CIRCLE = "circle"
ELLIPSE = "ellipse"
_CYLINDER = "vertical cylinder"
_ELLIPTICAL_CYLINDER = "vertical elliptical cylinder"
_NO_SHAPE = "unknown"
_Signs = tuple[int, int, int]  # of width, length and height

# The shape where the sizes of its rounded edges are equal, and where they are not.
_SHAPES: dict[_Signs, tuple[str, str]] = {
    (0, 0, 0): (POINT, POINT),
    (1, 1, 0): (RECTANGLE, RECTANGLE),
    (1, 1, 1): (BOX, BOX),
    (1, 0, 1): ("vertical rectangle across C 0", "vertical rectangle across C 0"),
    (0, 1, 1): ("vertical rectangle along C 0", "vertical rectangle along C 0"),
    (-1, -1, 0): (CIRCLE, ELLIPSE),
    (-1, -1, 1): (_CYLINDER, _ELLIPTICAL_CYLINDER),
    (-1, -1, -1): ("sphere", "ellipsoid"),
    (-1, 1, -1): ("horizontal cylinder along C 0", "horizontal elliptical cylinder along C 0"),
    (1, -1, -1): ("horizontal cylinder across C 0", "horizontal elliptical cylinder across C 0"),
    (-1, 0, -1): ("vertical circle", "vertical ellipse"),
}
_SIGNS = {shape: signs for signs, shapes in _SHAPES.items() for shape in shapes}
# Signs until 1995, and those of the same shape since 2002.
_UNTIL_1995: dict[_Signs, _Signs] = {
    (-1, 0, 0): (-1, -1, 0),
    (-1, 0, 1): (-1, -1, 1),
    (-1, 0, -1): (-1, -1, -1),
    (0, 1, -1): (-1, 1, -1),
    (1, 0, -1): (1, -1, -1),
    (-1, 1, 0): (-1, -1, 0),
    (1, -1, 0): (-1, -1, 0),
    (-1, 1, 1): (-1, -1, 1),
    (1, -1, 1): (-1, -1, 1),
    (-1, 1, -1): (-1, -1, -1),
    (1, -1, -1): (-1, -1, -1),
}
_ROUND = (CIRCLE, _CYLINDER, "sphere")
_SAME = 1e-3  # relative: sizes are rounded, in feet or metres


@dataclass(frozen=True)
class LuminousOpening:
    """Shape of the light that leaves a luminaire, and its sizes (mm); ``heights_mm`` at C 0, 90, 180 and 270."""

    shape: str = POINT
    width_mm: float = 0.0
    length_mm: float = 0.0
    heights_mm: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @classmethod
    def disc(cls, diameter_mm: float) -> "LuminousOpening":
        """A round opening without height."""
        return cls(CIRCLE, diameter_mm, diameter_mm)

    @classmethod
    def of_signs(cls, sizes_mm: tuple[float, float, float], year: int) -> "LuminousOpening":
        """The opening by width, length and height with the signs of LM-63 of the ``year``."""
        signs = (_sign(sizes_mm[0]), _sign(sizes_mm[1]), _sign(sizes_mm[2]))
        newer = _UNTIL_1995.get(signs, signs) if year < 2002 or signs not in _SHAPES else signs
        sizes = np.abs(sizes_mm)
        diameter = max(-min(sizes_mm), 0.0)
        width, length, height = (
            diameter if size == 0.0 and sign < 0 else float(size) for size, sign in zip(sizes, newer, strict=True)
        )
        rounded = [size for size, sign in zip((width, length, height), newer, strict=True) if sign < 0]
        equal = not rounded or np.ptp(rounded) <= _SAME * max(rounded)
        regular, irregular = _SHAPES.get(newer, (_NO_SHAPE, _NO_SHAPE))
        return cls(regular if equal else irregular, width, length, (height,) * 4)

    @classmethod
    def of_area(
        cls, length_mm: float, width_mm: float, heights_mm: tuple[float, float, float, float], circular: bool
    ) -> "LuminousOpening":
        """The opening by the sizes of its lower face and the heights of its sides."""
        high = max(heights_mm) > 0.0
        equal = abs(length_mm - width_mm) <= _SAME * max(length_mm, width_mm)
        if circular:
            flat, tall = (CIRCLE, _CYLINDER) if equal else (ELLIPSE, _ELLIPTICAL_CYLINDER)
            return cls(tall if high else flat, width_mm, length_mm, heights_mm)
        signs = (_sign(width_mm), _sign(length_mm), int(high))
        return cls(_SHAPES.get(signs, (_NO_SHAPE,))[0], width_mm, length_mm, heights_mm)

    @property
    def height_mm(self) -> float:
        """Largest height of its sides."""
        return max(self.heights_mm)

    @property
    def diameter_mm(self) -> float:
        """Diameter of an opening that is round as seen along the axis; 0 for any other."""
        return self.width_mm if self.shape in _ROUND else 0.0

    @property
    def known(self) -> bool:
        """False if the signs belong to no shape."""
        return self.shape != _NO_SHAPE

    @property
    def rounded(self) -> bool:
        """True if its lower face is a circle or an ellipse."""
        return self.shape in (*_ROUND, ELLIPSE, _ELLIPTICAL_CYLINDER)

    def signed_mm(self) -> tuple[float, float, float]:
        """Width, length and height with the signs of LM-63 since 2002."""
        width, length, height = _SIGNS.get(self.shape, (1, 1, 1))
        return width * self.width_mm, length * self.length_mm, height * self.height_mm

    def __str__(self) -> str:
        heights = self.heights_mm if len(set(self.heights_mm)) > 1 else self.heights_mm[:1]
        high = " / ".join(f"{height:.6g}" for height in heights)
        return f"{self.shape}, width {self.width_mm:.6g}, length {self.length_mm:.6g}, height {high} mm"


NO_OPENING = LuminousOpening()
"""That of a file that states none: a point."""


def _sign(size: float) -> int:
    return int(np.sign(size))
