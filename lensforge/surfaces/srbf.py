"""The paper's surface: a radius over the sphere as a sum of multi-level spherical radial basis functions.

``rho(u) = h + sum_j w_j exp(-g(u, c_j)^2 / sigma_j^2)``, Eq. (2) of the paper, with ``g`` the angle between
``u`` and the centre ``c_j``. This module is the definition; tables and NURBS approximate it.

Where the paper is silent: the centres are a Fibonacci grid on the *hemisphere*, so that
``arccos(1 - 1/m)`` of Eq. (3) is the half-angle of the cap of each centre; and a surface may be given a
mirror symmetry, in which case each basis function is averaged over its mirror images.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field

from lensforge.errors import InputError
from lensforge.kernels.parallel import in_chunks
from lensforge.results import Number
from lensforge.surfaces.mirror_group import grid_images, group
from lensforge.surfaces.surface import ByContent, Length, Place, Surface, SurfaceRecord, surface_record

# Of a basis. Bounds what a file can ask for: with 10,000 functions the radius at 20,000 directions takes 0.4 s.
MOST_FUNCTIONS = 10_000
MOST_LEVELS = 20
_NEGLIGIBLE = 1e-18  # of a function's peak: a hundredth of what a sum rounds off


def fibonacci_hemisphere(count: int) -> Float[np.ndarray, "m 3"]:
    """``count`` nearly uniform unit directions with z > 0: ``z_j = 1 - (j + 1/2)/m``, golden-angle azimuths."""
    index = np.arange(count)
    z = 1.0 - (index + 0.5) / count
    azimuth = index * np.pi * (3.0 - np.sqrt(5.0))
    sine = np.sqrt(1.0 - z * z)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=-1)


def level_sigma(count: int, sigma_c: float) -> float:
    """Shape parameter (rad) of a level of ``count`` functions, Eq. (3)."""
    return sigma_c * float(np.arccos(1.0 - 1.0 / count))


@dataclass(frozen=True)
class SrbfBasis:
    """Multi-level SRBFs: ``levels`` counts per level, ``sigma_c`` of Eq. (3), and a symmetry group's name."""

    levels: tuple[int, ...]
    sigma_c: float
    symmetry: str = "none"

    def __post_init__(self) -> None:
        if not self.levels or min(self.levels) < 1:
            raise InputError(f"levels = {self.levels}: one or more counts, each at least 1")
        if len(self.levels) > MOST_LEVELS or sum(self.levels) > MOST_FUNCTIONS:
            raise InputError(
                f"levels: {len(self.levels)} of {sum(self.levels)} functions together, must be at most {MOST_LEVELS} "
                f"of {MOST_FUNCTIONS}; leave out the finest"
            )
        if not 0.0 < self.sigma_c < np.inf:
            raise InputError(f"sigma_c = {self.sigma_c}: a finite number above 0; 1.5 to 2 works well")
        group(self.symmetry)

    @property
    def size(self) -> int:
        """Number of weights M."""
        return sum(self.levels)

    @cached_property
    def centres(self) -> Float[np.ndarray, "m 3"]:
        """Centre directions of all levels, coarse first."""
        return np.concatenate([fibonacci_hemisphere(count) for count in self.levels])

    @cached_property
    def sigmas(self) -> Float[np.ndarray, " m"]:
        """Shape parameters (rad) of all functions, coarse first."""
        return np.repeat([level_sigma(count, self.sigma_c) for count in self.levels], self.levels)

    @cached_property
    def reaches(self) -> Float[np.ndarray, " m"]:
        """Squared chord from each centre beyond which the function is left out of a sum."""
        angle = np.minimum(self.sigmas * np.sqrt(-np.log(_NEGLIGIBLE)), np.pi)
        return (2.0 * np.sin(0.5 * angle)) ** 2

    @property
    def detail_rad(self) -> float:
        """Shape parameter (rad) of the narrowest function."""
        return float(self.sigmas.min())

    def evaluate(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n m"]:
        """Value of every function at unit ``directions``."""
        images = group(self.symmetry)
        total = np.zeros((len(directions), self.size))
        for image in images:
            total += gaussians(directions @ image, self.centres, self.sigmas)
        return total / len(images)


def _chord_squared(directions: Float[np.ndarray, "n 3"], centres: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "n m"]:
    chord_squared = np.maximum(2.0 - 2.0 * directions @ centres.T, 0.0)
    rows, columns = np.nonzero(chord_squared < 1e-4)  # the dot product cancels here; the difference does not
    chord_squared[rows, columns] = np.sum((directions[rows] - centres[columns]) ** 2, axis=-1)
    return np.minimum(chord_squared, 4.0)


def gaussians(
    directions: Float[np.ndarray, "n 3"], centres: Float[np.ndarray, "m 3"], sigmas: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "n m"]:
    """``exp(-g^2/sigma^2)`` of unit directions and centres.

    The angle comes from the chord, ``g = 2 asin(|u - c|/2)``: arccos of a dot product loses half of the digits
    near the centre.
    """
    angle = 2.0 * np.arcsin(0.5 * np.sqrt(_chord_squared(directions, centres)))
    return np.exp(-((angle / sigmas) ** 2))


@dataclass(frozen=True, eq=False)
class SrbfSurface(ByContent, Surface):
    """A star-shaped surface: offset ``h`` (mm) and one weight (mm) for each function of the basis."""

    basis: SrbfBasis
    weights_mm: Float[np.ndarray, " m"]
    offset_mm: float

    def __post_init__(self) -> None:
        if self.weights_mm.shape != (self.basis.size,):
            raise InputError(f"weights: {self.weights_mm.shape[0]} given, the basis has {self.basis.size} functions")
        if not (np.isfinite(self.weights_mm).all() and np.isfinite(self.offset_mm)):
            raise InputError("weights: some are not finite; the design has diverged, lower the learning rate")

    @property
    def detail_rad(self) -> float:
        """Sigma of the narrowest function whose weight is not 0."""
        used = self.basis.sigmas[self.weights_mm != 0.0]
        return float(used.min() if len(used) else self.basis.sigmas.max())

    @property
    def symmetry(self) -> str:
        """Largest mirror group, as of the basis."""
        return self.basis.symmetry

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm) at unit ``directions``, by the exact sum in float64."""
        return self._summed(directions, None)

    def radius_on_grid(self, directions: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "n n"]:
        """``rho`` (mm) on a square chart grid centred on the axis: its mirror images come from one evaluation."""
        plain = replace(self, basis=replace(self.basis, symmetry="none"))
        block = plain.radius(directions.reshape(-1, 3)).reshape(directions.shape[:2])
        return grid_images(block, self.basis.symmetry)

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad), orthogonal to ``directions``."""
        return self.radius_and_gradient(directions)[1]

    def radius_and_gradient(
        self, directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Radius and gradient, by one sum over the functions."""
        gradients = np.empty((len(directions), 3))
        return self._summed(directions, gradients), gradients

    def _summed(
        self, directions: Float[np.ndarray, "n 3"], gradients: Float[np.ndarray, "n 3"] | None
    ) -> Float[np.ndarray, " n"]:
        """Radius by the sum over the functions; fill the ``gradients`` unless None.

        Directions go to the kernel as neighbours: it is quick if a block of them covers a small part of the sphere.
        """
        from lensforge.kernels.basis_sum import BLOCK, ROWS, sum_functions

        basis = self.basis
        order = _as_neighbours(directions, BLOCK)
        ordered = np.ascontiguousarray(directions[order])
        sums = np.empty(len(directions))
        slopes = None if gradients is None else np.empty(gradients.shape)
        images = np.stack(group(basis.symmetry))
        functions = basis.centres, basis.sigmas, basis.reaches, np.ascontiguousarray(self.weights_mm)

        def work(_: int, part: slice) -> None:
            space = np.empty((ROWS, BLOCK))
            sum_functions(
                ordered[part], images, *functions, space, sums[part], None if slopes is None else slopes[part]
            )

        in_chunks(work, len(ordered))
        radius = np.empty(len(directions))
        radius[order] = self.offset_mm + sums
        if gradients is not None:
            gradients[order] = slopes
        return radius


def _as_neighbours(directions: Float[np.ndarray, "n 3"], together: int) -> Int[np.ndarray, " n"]:
    """An order that keeps neighbouring directions together: by the cells of a grid, ``together`` in each."""
    across = max(1, int(np.sqrt(len(directions) / together)))
    column, row = (np.floor((0.5 + 0.5 * directions[:, axis]) * across) for axis in (0, 1))
    return np.argsort(column * across + row, kind="stable")


Levels = Annotated[tuple[Annotated[int, Field(strict=True, ge=1)], ...], Field(min_length=1)]
Spread = Annotated[Number, Field(ge=1e-6, le=1e6)]
MirrorGroup = Literal["none", "mirror_x", "mirror_y", "diagonal", "rectangle", "square"]
Weights = Annotated[tuple[Place, ...], Field(max_length=MOST_FUNCTIONS)]


class SrbfRecord(SurfaceRecord):
    """A sum of spherical radial basis functions: those of ``levels``, each with its weight, on a sphere."""

    kind: Literal["srbf"] = "srbf"
    levels: Levels
    sigma_c: Spread
    symmetry: MirrorGroup
    offset_mm: Length
    weights_mm: Weights

    def surface(self) -> SrbfSurface:
        """The surface. Raises :class:`InputError` if the numbers of weights and functions differ."""
        basis = SrbfBasis(self.levels, self.sigma_c, self.symmetry)
        return SrbfSurface(basis, np.array(self.weights_mm, dtype=np.float64), self.offset_mm)


@surface_record.register
def _(surface: SrbfSurface) -> SurfaceRecord:
    numbers = {"offset_mm": surface.offset_mm, "weights_mm": surface.weights_mm.tolist()}
    return SrbfRecord.model_validate({"kind": "srbf", **fields_of(surface.basis), **numbers})


def fields_of(basis: SrbfBasis) -> dict[str, object]:
    """The fields of a basis as records have them."""
    return {"levels": basis.levels, "sigma_c": basis.sigma_c, "symmetry": basis.symmetry}
