"""Surfaces whose curvature, best sphere and cutter are known in closed form, written as radii over the sphere."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.cad.patch import fit_patch
from lensforge.shop.face_samples import AirSide, FaceSamples, OpticalFace, sample_face
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface

INNER_LEVELS = (9, 25, 81)


@dataclass(frozen=True)
class OfRadius(Surface):
    """A surface by the radius (mm) of unit directions alone."""

    radius: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]
    detail_rad: float = 0.3


@dataclass(frozen=True)
class Ellipsoid(Surface):
    """Semi-axes and centre (mm); the origin must be inside."""

    axes: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    detail_rad: float = 0.3

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        scaled, shift = directions / np.array(self.axes), np.array(self.centre) / np.array(self.axes)
        quadratic, linear = np.sum(scaled**2, axis=1), scaled @ shift
        return (linear + np.sqrt(linear**2 - quadratic * (shift @ shift - 1.0))) / quadratic

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        radius = self.radius(directions)[:, None]
        outward = (radius * directions - np.array(self.centre)) / np.square(self.axes)
        return radius * (directions - outward / np.sum(outward * directions, axis=1, keepdims=True))


def sphere(radius: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Ellipsoid:
    return Ellipsoid((radius, radius, radius), centre)


def random_surface(offset: float, roughness: float, seed: int, levels: tuple[int, ...] = INNER_LEVELS) -> SrbfSurface:
    basis = SrbfBasis(levels, 1.75)
    size = offset * roughness * np.repeat(0.5 ** np.arange(len(levels)), levels)
    return SrbfSurface(basis, np.random.default_rng(seed).normal(size=basis.size) * size, offset)


def exported(surface: Surface, air: AirSide, nodes: int = 96) -> OpticalFace:
    """The face that a part with ``nodes`` spline nodes has."""
    return OpticalFace(fit_patch(surface, nodes), air)


def sampled(surface: Surface, air: AirSide, nodes: int = 81, spline_nodes: int = 96) -> FaceSamples:
    return sample_face(exported(surface, air, spline_nodes), nodes)


def order(coarse: float, fine: float) -> float:
    """Convergence order from the errors at a step and at half of it."""
    return float(np.log2(coarse / fine))
