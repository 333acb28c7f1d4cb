"""Protocol of every surface: a radius over the sphere about the origin, and its gradient."""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float


@runtime_checkable
class Surface(Protocol):
    """A star-shaped surface; ``directions`` are unit vectors, also a little below z = 0, continued smoothly."""

    @property
    def detail_rad(self) -> float:
        """The sigma (rad) of a Gaussian as narrow as its narrowest feature: tables and splines choose nodes by it."""
        ...

    @property
    def symmetry(self) -> str:
        """Largest mirror group, a name of ``surfaces.symmetry``, that it is known to have."""
        return "none"

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm), the distance from the origin, exact in float64."""
        ...

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad), orthogonal to ``directions``."""
        ...

    def radius_on_grid(self, directions: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "n n"]:
        """``rho`` (mm) on a square chart grid centred on the axis; a surface with mirror images may use them."""
        return self.radius(directions.reshape(-1, 3)).reshape(directions.shape[:2])

    def normal(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Unit normals pointing away from the origin: ``u - grad(rho)/rho``, normalised."""
        outward = directions - self.gradient(directions) / self.radius(directions)[:, None]
        unit: Float[np.ndarray, "n 3"] = outward / np.linalg.norm(outward, axis=1, keepdims=True)
        return unit
