"""The pixels of an image: a centred square, cut into equal squares."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class PixelGrid:
    """``side_mm`` wide, ``pixels`` x ``pixels``. Images are indexed [row = y, column = x], y upwards."""

    side_mm: float
    pixels: int

    @property
    def pitch_mm(self) -> float:
        """Width of a pixel."""
        return self.side_mm / self.pixels

    def axis_mm(self) -> Float[np.ndarray, " p"]:
        """Coordinates of the pixel centres along either axis."""
        return (np.arange(self.pixels) + 0.5) * self.pitch_mm - self.side_mm / 2.0

    def rectangle_mask(self, width_mm: float, height_mm: float) -> Bool[np.ndarray, "p p"]:
        """Pixels whose centres lie within a centred rectangle, ``width_mm`` along x."""
        distance = np.abs(self.axis_mm())
        mask: Bool[np.ndarray, "p p"] = (distance <= height_mm / 2.0)[:, None] & (distance <= width_mm / 2.0)[None, :]
        return mask

    def square_mask(self, side_mm: float) -> Bool[np.ndarray, "p p"]:
        """Pixels whose centres lie within a centred square of ``side_mm``."""
        return self.rectangle_mask(side_mm, side_mm)
