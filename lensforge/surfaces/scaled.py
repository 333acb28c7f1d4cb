"""A surface scaled about the origin: the faces of a mould are those of the lens, larger by what the lens shrinks."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class ScaledSurface(Surface):
    """``surface`` times ``factor`` about the origin: radius and gradient scale, normals stay."""

    surface: Surface
    factor: float

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of its narrowest feature, that of the surface."""
        return self.surface.detail_rad

    @property
    def symmetry(self) -> str:
        """Largest mirror group, as of the surface."""
        return self.surface.symmetry

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm), the distance from the origin."""
        return self.factor * self.surface.radius(directions)

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad)."""
        return self.factor * self.surface.gradient(directions)

    def radius_on_grid(self, directions: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "n n"]:
        """``rho`` (mm) on a square chart grid centred on the axis."""
        return self.factor * self.surface.radius_on_grid(directions)


def scaled(surface: Surface, factor: float) -> Surface:
    """``surface`` times ``factor``; itself where that is 1, so that nothing is rounded."""
    return surface if factor == 1.0 else ScaledSurface(surface, factor)
