"""Spheres, aspheres, biconic, toroid, polynomial and Zernike surfaces against their formulas."""

import numpy as np
import pytest
from scenes import hemisphere_directions

from lensforge.errors import InputError
from lensforge.surfaces.asphere import Asphere, Biconic, Toroid, XYPolynomial, noll, sphere, zernike_terms


@pytest.mark.parametrize("centre", [0.0, 3.0, -4.0, -5.9])
def test_a_sphere_is_a_sphere(centre: float) -> None:
    surface, u = sphere(6.0, centre), hemisphere_directions(2000)
    expected = centre * u[:, 2] + np.sqrt(36.0 - centre**2 * (1.0 - u[:, 2] ** 2))
    assert np.allclose(surface.radius(u), expected, rtol=1e-13)
    from_centre = u * surface.radius(u)[:, None] - np.array([0.0, 0.0, centre])
    assert np.allclose(surface.normal(u), from_centre / 6.0, atol=1e-12)


@pytest.mark.parametrize(
    ("vertex", "radius", "conic", "coefficients"),
    [
        (13.5, -11.0, -0.4, (-2e-5, 1e-8)),
        (6.0, -3.0, -2.0, ()),
        (5.0, 30.0, 0.0, (-4e-3,)),
        (7.0, -9.0, -1.0, (0.0, -1e-6)),
    ],
)
def test_an_asphere_has_the_sag_of_the_standard(vertex, radius, conic, coefficients) -> None:
    u = hemisphere_directions(2000)
    x, y, z = (u * Asphere(vertex, radius, conic, coefficients).radius(u)[:, None]).T
    r = np.hypot(x, y)
    sag = r**2 / (radius * (1.0 + np.sqrt(1.0 - (1.0 + conic) * (r / radius) ** 2)))
    sag += sum(a * r ** (4 + 2 * i) for i, a in enumerate(coefficients))
    assert np.allclose(z, vertex + sag, atol=2e-12)
    assert np.allclose(Asphere(vertex, radius, conic, coefficients).sag(r), vertex + sag, rtol=1e-14)


def test_a_conic_goes_on_below_its_equator_where_the_sag_ends() -> None:
    surface = Asphere(8.0, -5.0, -0.2)  # an ellipsoid, its equator 1.75 mm above z = 0
    u = hemisphere_directions(2000)
    x, y, z = (u * surface.radius(u)[:, None]).T
    along = -5.0 / 0.8
    inside = ((z - 8.0 - along) / along) ** 2 + (x**2 + y**2) / (25.0 / 0.8)
    assert np.allclose(inside, 1.0, atol=1e-13)
    assert z[np.argmax(np.hypot(x, y))] == pytest.approx(1.75, abs=0.02)
    assert np.isnan(surface.sag(np.array([5.6]))).all()


@pytest.mark.parametrize(
    "make",
    [
        lambda: sphere(5.0, 5.1),  # the origin is outside
        lambda: Asphere(5.0, 50.0),  # opens upwards
        lambda: Asphere(13.0, -12.0, 0.0, (1e-3,)),  # turns up before it reaches the horizon
        lambda: Asphere(13.0, -12.0, 0.0, (1e9, -1e300)),
        lambda: Asphere(5.0, -8.0, -6.0),  # its cone of directions ends above 120 degrees
    ],
)
def test_what_is_not_star_shaped_is_one_line(make) -> None:
    with pytest.raises(InputError, match=r"not star-shaped.*degrees from the axis") as caught:
        make()
    assert "\n" not in str(caught.value)


def test_the_other_sheet_of_a_hyperboloid_is_no_surface() -> None:
    dented = Asphere(5.0, 1.0, -3.0, (-0.05,))  # the sheet that the sag does not mean begins at z = 4
    u = hemisphere_directions(500)
    points = u * dented.radius(u)[:, None]
    assert np.allclose(points[:, 2], dented.sag(np.hypot(points[:, 0], points[:, 1])), atol=1e-11)


def test_a_vertex_at_the_source_is_refused() -> None:
    with pytest.raises(InputError, match="vertex at 0 mm"):
        Asphere(0.0, -5.0)


U = hemisphere_directions(2000)
# Noll (1976), table I: radial and angular order of the first fifteen
NOLL = [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0), (4, 2), (4, -2)]


def points(surface) -> np.ndarray:
    return (U * surface.radius(U)[:, None]).T


def test_a_biconic_has_the_sag_of_the_standard() -> None:
    surface = Biconic(8.0, -9.0, -11.0, -0.5, 0.3)
    x, y, z = points(surface)
    b, a = x**2 / -9.0 + y**2 / -11.0, 0.5 * x**2 / 81.0 + 1.3 * y**2 / 121.0
    above = z > 3.0  # where the sag's own sheet is
    assert np.allclose(z[above], (8.0 + b / (1.0 + np.sqrt(1.0 - a)))[above], atol=1e-12)
    assert np.allclose(Biconic(8.0, -9.0, -9.0, -0.5, -0.5).radius(U), Asphere(8.0, -9.0, -0.5).radius(U), rtol=1e-13)


def test_a_toroid_is_its_profile_turned_about_a_line() -> None:
    surface = Toroid(8.0, -7.0, -9.0, -0.3, (-1e-5,))
    x, y, z = points(surface)
    height = np.hypot(x, z + 1.0) - 1.0  # the place turned back into x = 0 about the line x = 0, z = -1
    profile = Asphere(8.0, -7.0, -0.3, (-1e-5,)).sag(np.abs(y))
    known = np.isfinite(profile) & (height > 2.0)
    assert known.sum() > 1000 and np.allclose(height[known], profile[known], atol=1e-11)
    assert np.allclose(Toroid(6.0, -6.0, -6.0).radius(U), 6.0, rtol=1e-13)


def test_a_polynomial_is_added_to_the_sag_of_its_conic() -> None:
    terms = ((2, 0, 0.11), (1, 2, -0.05), (0, 1, 0.07), (4, 4, -0.02))
    x, y, z = points(XYPolynomial(8.0, -9.0, -0.4, terms, 8.0))
    added = sum(c * (x / 8.0) ** i * (y / 8.0) ** j for i, j, c in terms)
    sag = Asphere(8.0, -9.0, -0.4).sag(np.hypot(x, y))
    above = np.isfinite(sag) & (z > 3.0)
    assert above.sum() > 1000 and np.allclose(z[above], (sag + added)[above], atol=1e-12)


def test_noll_numbers_are_those_of_his_table() -> None:
    assert [noll(k + 1) for k in range(len(NOLL))] == NOLL


def test_zernike_polynomials_are_orthonormal_over_the_disc() -> None:
    """By a quadrature that is exact for them: Gauss in the squared radius, equal steps around."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    radius, azimuth = np.sqrt(0.5 * (nodes + 1.0)), 2.0 * np.pi * np.arange(32) / 32
    x, y = np.outer(radius, np.cos(azimuth)), np.outer(radius, np.sin(azimuth))
    each = [sum(c * x**i * y**j for i, j, c in zernike_terms({k: 1.0})) for k in range(1, 37)]
    products = np.array([[0.5 * weights @ (a * b).mean(axis=1) for b in each] for a in each])
    assert np.allclose(products, np.eye(36), atol=1e-10)


def test_a_zernike_surface_has_coma_along_x_by_its_formula() -> None:
    x, y, z = points(XYPolynomial(8.0, -9.0, 0.0, zernike_terms({8: 0.02}), 9.0))
    r, phi = np.hypot(x, y) / 9.0, np.arctan2(y, x)
    above = z > 3.0
    wanted = sphere(9.0, -1.0)
    sag = wanted.sag(np.hypot(x, y)) + 0.02 * np.sqrt(8.0) * (3.0 * r**3 - 2.0 * r) * np.cos(phi)
    assert np.allclose(z[above], sag[above], atol=1e-12)


@pytest.mark.parametrize(
    ("make", "symmetry"),
    [
        (lambda: Biconic(8.0, -9.0, -8.0), "rectangle"),
        (lambda: XYPolynomial(8.0, -8.0, 0.0, ((2, 0, 0.1), (0, 2, 0.1)), 8.0), "square"),
        (lambda: XYPolynomial(8.0, -8.0, 0.0, ((2, 0, 0.1), (0, 4, 0.1)), 8.0), "rectangle"),
        (lambda: XYPolynomial(8.0, -8.0, 0.0, ((2, 1, 0.1),), 8.0), "mirror_x"),
        (lambda: XYPolynomial(8.0, -8.0, 0.0, ((1, 2, 0.1),), 8.0), "mirror_y"),
        (lambda: XYPolynomial(8.0, -8.0, 0.0, ((1, 1, 0.1),), 8.0), "none"),
    ],
)
def test_symmetry_is_that_of_the_formula(make, symmetry: str) -> None:
    assert make().symmetry == symmetry


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Biconic(8.0, -9.0, 9.0), "must have one sign"),
        (lambda: Biconic(0.0, -9.0, -9.0), "vertex at 0 mm"),
        (lambda: XYPolynomial(1.0, -9.0, 0.0, ((0, 0, -2.0),)), "lower the vertex to -1 mm"),
        (lambda: XYPolynomial(8.0, -8.0, 0.0, ((0, 3, 20.0),), 8.0), r"not star-shaped: .* at azimuth \d+ degrees"),
        (lambda: Toroid(8.0, -8.0, 20.0), "not star-shaped"),
    ],
)
def test_what_cannot_be_is_one_line(make, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
