"""A sphere anywhere around the origin, whose offset, normal and height are known in closed form."""

from dataclasses import dataclass

import numpy as np

from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class Ball(Surface):
    """Centre (mm) and radius (mm)."""

    centre: tuple[float, float, float]
    size: float

    @property
    def detail_rad(self) -> float:
        return 0.4

    def radius(self, directions: np.ndarray) -> np.ndarray:
        along = directions @ np.array(self.centre)
        return along + np.sqrt(along**2 - np.dot(self.centre, self.centre) + self.size**2)

    def gradient(self, directions: np.ndarray) -> np.ndarray:
        radius, centre = self.radius(directions), np.array(self.centre)
        along = directions @ centre
        slope = radius / (radius - along)
        return slope[:, None] * (centre - along[:, None] * directions)
