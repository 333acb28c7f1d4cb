"""The paper's source: a square Lambertian emitter in the plane z = 0."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.bundle import RayBundle
from lensforge.sources.qmc import sobol


@dataclass(frozen=True)
class SquareEmitter:
    """Uniform, Lambertian, ``side_mm`` wide, centred on the axis; total flux ``flux_w``. ``side_mm = 0``: a point."""

    side_mm: float
    flux_w: float = 1.0
    symmetry: str = "square"
    ray_count: int | None = None

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays of equal flux: position uniform, direction cosine-distributed (Malley's method)."""
        if count < 1:
            raise InputError(f"{count} rays: at least 1")
        points = sobol(count, 4, seed)
        origins = np.zeros((count, 3))
        for axis in (0, 1):
            origins[:, axis] = (points[:, axis] - 0.5) * self.side_mm
        # Owen-scrambled points lie in [0, 1): 1 - u keeps the cosine above zero, so no ray grazes the chip.
        sine, azimuth = np.sqrt(points[:, 2]), 2.0 * np.pi * points[:, 3]
        directions = np.empty((count, 3))
        np.multiply(sine, np.cos(azimuth), out=directions[:, 0])
        np.multiply(sine, np.sin(azimuth), out=directions[:, 1])
        np.sqrt(1.0 - points[:, 2], out=directions[:, 2])
        return RayBundle(origins, directions, np.full(count, self.flux_w / count))

    def radiances(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """Radiance (W/(mm^2 sr)) of each ray of a sample: the same in all places and directions."""
        area = np.pi * self.side_mm**2
        return np.full(count, self.flux_w / area if area > 0.0 else np.inf)

    def outline(self) -> Float[np.ndarray, "4 3"]:
        """Corners (mm) of the square."""
        half = self.side_mm / 2.0
        return np.array([[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]])
