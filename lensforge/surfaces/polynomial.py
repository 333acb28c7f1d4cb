"""A polynomial in x and y, or a sum of Zernike polynomials, on a conic (ISO 10110-19)."""

from dataclasses import dataclass
from math import factorial, sqrt

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial

from lensforge.errors import InputError
from lensforge.surfaces.implicit import ImplicitSurface, require_vertex

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
