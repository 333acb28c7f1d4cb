"""Surfaces that are not quite as designed: moved, turned, or with an error of form; still a radius over the sphere."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

_ROUNDS = 3  # each gains three digits for displacements that are small against the lens
_SAMPLES = 4000


@dataclass(frozen=True)
class Displaced:
    """``surface`` turned about the lens origin by ``tilt_rad`` (about the x axis), then moved by ``shift_mm``."""

    surface: Surface
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_rad: float = 0.0

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the lens origin, by fixed-point steps on ``|x'| = rho(x'/|x'|)`` in the moved frame."""
        cosine, sine = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
        along, shift = directions @ turn, np.array(self.shift_mm) @ turn
        radius = self.surface.radius(along)
        for _ in range(_ROUNDS):
            x = radius[:, None] * along - shift
            length = np.linalg.norm(x, axis=1)
            radius = radius - (length - self.surface.radius(x / length[:, None]))
        return radius


@dataclass(frozen=True)
class WithFormError:
    """``surface`` plus ``error``, a sum of functions whose offset does not count."""

    surface: Surface
    error: SrbfSurface

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the lens origin."""
        radius: Float[np.ndarray, " n"] = self.surface.radius(directions) + self.error.radius(directions)
        return radius - self.error.offset_mm


def with_form_error(surface: Surface, functions: int, sigma_c: float, rms_mm: float, seed: int) -> WithFormError:
    """A random error of as many functions as one level has; ``rms_mm`` is along the normal, even over solid angle."""
    basis = SrbfBasis((functions,), sigma_c)
    weights = np.random.default_rng(seed).normal(size=basis.size)
    u = fibonacci_hemisphere(_SAMPLES)
    error = basis.evaluate(u) @ weights * np.sum(surface.normal(u) * u, axis=1)
    return WithFormError(surface, SrbfSurface(basis, weights * rms_mm / float(np.sqrt(np.mean(error**2))), 1.0))
