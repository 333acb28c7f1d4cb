"""Fixed surfaces on a conic: an even asphere, a biconic, a toroid, the sphere, polynomials in x and y and Zernike's.

The sag of an even asphere follows ISO 10110-12, ``z(r) = z_v + r^2 / (R (1 + sqrt(1 - (1+k) r^2/R^2))) + A_4 r^4 +
A_6 r^6 + ...``, with R < 0 where the centre of curvature lies on the source's side, as in a dome. Its equation is
``F = ((1+k) s^2 + r^2)/R - 2 s`` with ``s = z - z_v - A_4 r^4 - ...``. Polynomials follow ISO 10110-19.
"""

from dataclasses import dataclass
from functools import cached_property
from math import factorial, sqrt
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
                f"radii {self.radius_x_mm:g} and {self.radius_y_mm:g} mm: must have one sign; take an XY polynomial "
                "for a saddle"
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


@dataclass(frozen=True)
class Toroid(ImplicitSurface):
    """A profile in the y-z plane turned about a line parallel to y, at ``rotation_radius_mm`` R_x from the vertex.

    The profile is an even asphere in y: ``radius_mm``, ``conic``, and A_4, A_6, ... of y (ISO 10110-12). Both radii
    are below 0 for a dome. Raises :class:`InputError` where it is not star-shaped.
    """

    radius_mm: float
    rotation_radius_mm: float
    conic: float = 0.0
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        require_vertex(self.vertex_mm, self.radius_mm, self.rotation_radius_mm)
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "rectangle"

    def equation(self, points_mm: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """``F`` (mm) and its gradient: that of the profile at the height over it to which a point turns."""
        x, y, z = points_mm.T
        from_line = z - self.vertex_mm - self.rotation_radius_mm
        distance = np.maximum(np.hypot(x, from_line), np.finfo(float).tiny)
        side = np.sign(self.rotation_radius_mm)
        series = np.array([0.0, 0.0, *self.coefficients])
        s = self.rotation_radius_mm - side * distance - polynomial.polyval(y**2, series)
        by_s = 2.0 * (1.0 + self.conic) * s / self.radius_mm - 2.0
        by_squared = 1.0 / self.radius_mm - by_s * polynomial.polyval(y**2, polynomial.polyder(series))
        value = ((1.0 + self.conic) * s**2 + y**2) / self.radius_mm - 2.0 * s
        turned = -side * by_s / distance
        return value, np.stack([turned * x, 2.0 * y * by_squared, turned * from_line], axis=1)


def sphere(radius_mm: float, centre_mm: float = 0.0) -> Asphere:
    """A sphere with its centre on the axis at z = ``centre_mm``; the origin must be inside."""
    return Asphere(centre_mm + radius_mm, -radius_mm)


Terms = tuple[tuple[int, int, float], ...]


@dataclass(frozen=True)
class XYPolynomial(ImplicitSurface):
    """A conic of vertex ``z_v``, R and k, and ``sum c_ij (x/N)^i (y/N)^j`` (mm) added to its sag.

    ``terms``: i, j and c_ij (mm) of each; ``normalisation_mm``: N. That of a dome has R < 0. The equation is that of
    an asphere with ``s = z - z_v - sum``. Raises :class:`InputError` where it is not star-shaped.
    """

    radius_mm: float
    conic: float = 0.0
    terms: Terms = ()
    normalisation_mm: float = 1.0

    def __post_init__(self) -> None:
        require_vertex(self.vertex_mm, self.radius_mm)
        if not self.apex_mm > 0.0:
            raise InputError(f"its terms lower the vertex to {self.apex_mm:.6g} mm: it must lie above 0")
        super().__post_init__()

    @property
    def apex_mm(self) -> float:
        """Height at which the surface meets the axis: the vertex of the conic, and the constant term."""
        return self.vertex_mm + sum(value for i, j, value in self.terms if i == j == 0)

    @property
    def symmetry(self) -> str:
        """Largest mirror group by the parity of its powers."""
        used = [(i, j) for i, j, value in self.terms if value != 0.0]
        even_x, even_y = all(i % 2 == 0 for i, _ in used), all(j % 2 == 0 for _, j in used)
        swapped = {(j, i): value for i, j, value in self.terms} == {(i, j): value for i, j, value in self.terms}
        if even_x and even_y:
            return "square" if swapped else "rectangle"
        return "mirror_x" if even_x else "mirror_y" if even_y else "none"

    def equation(self, points_mm: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """``F`` (mm) and its gradient."""
        x, y, z = points_mm.T
        table, scale = self._table, self.normalisation_mm
        at = x / scale, y / scale
        s = z - self.vertex_mm - polynomial.polyval2d(*at, table)
        by_s = 2.0 * (1.0 + self.conic) * s / self.radius_mm - 2.0
        slope_x, slope_y = (polynomial.polyval2d(*at, polynomial.polyder(table, axis=axis)) / scale for axis in (0, 1))
        value = ((1.0 + self.conic) * s**2 + x * x + y * y) / self.radius_mm - 2.0 * s
        by_x, by_y = (2.0 * each / self.radius_mm - by_s * slope for each, slope in ((x, slope_x), (y, slope_y)))
        return value, np.stack([by_x, by_y, by_s], axis=1)

    @property
    def _table(self) -> Float[np.ndarray, "a b"]:
        """Coefficient of each pair of powers; at least 2 x 2, so that each derivative has an entry."""
        highest = 1 + max([1, *(max(i, j) for i, j, _ in self.terms)])
        table = np.zeros((highest, highest))
        for i, j, value in self.terms:
            table[i, j] += value
        return table


def noll(number: int) -> tuple[int, int]:
    """Radial order n and angular order m of the Zernike polynomial of Noll's ``number``, 1 and above; m < 0: sine.

    R. J. Noll, J. Opt. Soc. Am. 66, 207 (1976).
    """
    order = 0
    while (order + 1) * (order + 2) // 2 < number:
        order += 1
    place = number - order * (order + 1) // 2 - 1
    angular = order % 2 + 2 * ((place + (order + 1) % 2) // 2)
    return order, angular if number % 2 == 0 else -angular


def zernike_terms(coefficients_mm: dict[int, float]) -> Terms:
    """Terms in x and y, over the normalisation radius, of a sum of Zernike polynomials by Noll's number.

    Normalised as Noll's: each has an rms of 1 over the disc.
    """
    highest = max((noll(number)[0] for number in coefficients_mm), default=0)
    total = np.zeros((highest + 1, highest + 1))
    for number, value in coefficients_mm.items():
        total += value * _zernike(*noll(number), highest)
    return tuple((int(i), int(j), float(total[i, j])) for i, j in np.argwhere(total != 0.0))


def _zernike(order: int, angular: int, highest: int) -> Float[np.ndarray, "a a"]:
    """Table of the powers of x and y in one polynomial."""
    m = abs(angular)
    found = np.zeros((highest + 1, highest + 1))
    norm = sqrt(order + 1.0) if m == 0 else sqrt(2.0 * (order + 1.0))
    for k in range((order - m) // 2 + 1):
        share = (-1) ** k * factorial(order - k)
        share //= factorial(k) * factorial((order + m) // 2 - k) * factorial((order - m) // 2 - k)
        found += norm * share * _ring(m, angular < 0, (order - m) // 2 - k, highest)
    return found


def _ring(m: int, sine: bool, power: int, highest: int) -> Float[np.ndarray, "a a"]:
    """Powers of x and y in ``(x^2 + y^2)^power`` times the real or imaginary part of ``(x + i y)^m``."""
    found = np.zeros((highest + 1, highest + 1))
    for a in range(power + 1):
        radial = factorial(power) // (factorial(a) * factorial(power - a))  # of x^2a y^(2 (power - a))
        for b in range(m + 1):
            if b % 2 == int(sine):
                sign = (-1) ** (b // 2)
                angular = factorial(m) // (factorial(b) * factorial(m - b))
                found[2 * a + m - b, 2 * (power - a) + b] += sign * radial * angular
    return found
