"""Fixed surfaces on a conic: an even asphere, a biconic, a toroid, the sphere, polynomials in x and y and Zernike's.

The sag of an even asphere follows ISO 10110-12, ``z(r) = z_v + r^2 / (R (1 + sqrt(1 - (1+k) r^2/R^2))) + A_4 r^4 +
A_6 r^6 + ...``, with R < 0 where the centre of curvature lies on the source's side, as in a dome. Its equation is
``F = ((1+k) s^2 + r^2)/R - 2 s`` with ``s = z - z_v - A_4 r^4 - ...``. Polynomials follow ISO 10110-19.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial

from lensforge.errors import InputError
from lensforge.surfaces.implicit import ImplicitSurface, require_vertex


@dataclass(frozen=True)
class Asphere(ImplicitSurface):
    """An even asphere about the axis: vertex at ``z_v`` (mm), R (mm), conic constant k, and A_4, A_6, ... (mm^-3, ...).

    Raises :class:`InputError` where it is not star-shaped about the origin down to 30 degrees below z = 0.
    """

    meridians: ClassVar[int] = 1

    radius_mm: float
    conic: float = 0.0
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        require_vertex(self.vertex_mm, self.radius_mm)
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square"

    def sag(self, r_mm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """``z(r)`` (mm) by the formula of the standard; NaN beyond the equator of its conic."""
        with np.errstate(invalid="ignore"):
            root = np.sqrt(1.0 - (1.0 + self.conic) * r_mm**2 / self.radius_mm**2)
        z_mm: Float[np.ndarray, " n"] = (
            self.vertex_mm + r_mm**2 / (self.radius_mm * (1.0 + root)) + polynomial.polyval(r_mm**2, self._series)
        )
        return z_mm

    @cached_property
    def _series(self) -> Float[np.ndarray, " k"]:
        """Coefficients of the powers of r^2."""
        return np.array([0.0, 0.0, *self.coefficients])

    def equation(self, points_mm: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """``F`` (mm) and its gradient."""
        x, y, z = points_mm.T
        squared = x * x + y * y
        s = z - self.vertex_mm - polynomial.polyval(squared, self._series)
        by_s = 2.0 * (1.0 + self.conic) * s / self.radius_mm - 2.0
        by_squared = 1.0 / self.radius_mm - by_s * polynomial.polyval(squared, polynomial.polyder(self._series))
        value = ((1.0 + self.conic) * s**2 + squared) / self.radius_mm - 2.0 * s
        return value, np.stack([2.0 * x * by_squared, 2.0 * y * by_squared, by_s], axis=1)


@dataclass(frozen=True)
class Biconic(ImplicitSurface):
    """Vertex at ``z_v`` (mm), radii (mm) and conic constants in the x-z and in the y-z plane (ISO 10110-12).

    ``z = z_v + B / (1 + sqrt(1 - A))``, ``B = x^2/R_x + y^2/R_y``, ``A = (1+k_x) x^2/R_x^2 + (1+k_y) y^2/R_y^2``, as
    the equation ``F = B + (A/B) s^2 - 2 s``. Raises :class:`InputError` for radii of two signs, and where it is not
    star-shaped.
    """

    radius_x_mm: float
    radius_y_mm: float
    conic_x: float = 0.0
    conic_y: float = 0.0

    def __post_init__(self) -> None:
        require_vertex(self.vertex_mm, self.radius_x_mm, self.radius_y_mm)
        if self.radius_x_mm * self.radius_y_mm < 0.0:
            raise InputError(
                f"radii {self.radius_x_mm:g} and {self.radius_y_mm:g} mm: must have one sign; give a saddle "
                "as a STEP file or as points"
            )
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "rectangle"

    def equation(self, points_mm: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """``F`` (mm) and its gradient."""
        s = points_mm[:, 2] - self.vertex_mm
        squares, radii = points_mm[:, :2] ** 2, np.array([self.radius_x_mm, self.radius_y_mm])
        conics = (1.0 + np.array([self.conic_x, self.conic_y])) / radii**2
        parabolic, conic = squares @ (1.0 / radii), squares @ conics
        off_axis = np.where(parabolic == 0.0, 1.0, parabolic)
        share = conic / off_axis  # A/B; on the axis, where s is 0, it has no effect
        by_squares = 1.0 / radii + (s**2 / off_axis)[:, None] * (conics - share[:, None] / radii)
        slope = np.column_stack([2.0 * points_mm[:, :2] * by_squares, 2.0 * share * s - 2.0])
        return parabolic + share * s**2 - 2.0 * s, slope


def sphere(radius_mm: float, centre_mm: float = 0.0) -> Asphere:
    """A sphere with its centre on the axis at z = ``centre_mm``; the origin must be inside."""
    return Asphere(centre_mm + radius_mm, -radius_mm)
