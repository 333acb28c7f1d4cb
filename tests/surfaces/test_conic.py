"""Fixed surfaces against their closed forms."""

import numpy as np
import pytest
from scenes import hemisphere_directions

from lensforge.errors import InputError
from lensforge.surfaces.asphere import Asphere, sphere
from lensforge.surfaces.reciprocal import ConicFace


def test_distances_from_both_foci_of_a_tilted_ellipsoid_add_up_to_its_length() -> None:
    u = hemisphere_directions(200)
    axis = np.array([2.0, 3.0, 6.0]) / 7.0
    length = 2.0 * 6.0 / (1.0 - 0.7**2)
    points = u * ConicFace(21.0, 6.0, 0.7, (2.0, 3.0, 6.0)).radius(u)[:, None]
    from_near, from_far = (np.linalg.norm(points - focus * axis, axis=1) for focus in (0.0, 0.7 * length))
    assert np.allclose(from_near + from_far, length, rtol=1e-13)


@pytest.mark.parametrize("centre", [0.0, 3.0, -4.0, -5.9])
def test_a_sphere_is_a_sphere(centre: float) -> None:
    surface = sphere(6.0, centre)
    u = hemisphere_directions(2000)
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


def test_a_conic_goes_on_below_its_equator_where_the_sag_ends() -> None:
    surface = Asphere(8.0, -5.0, -0.2)  # an ellipsoid, its equator 1.75 mm above z = 0
    u = hemisphere_directions(2000)
    x, y, z = (u * surface.radius(u)[:, None]).T
    along = -5.0 / 0.8
    inside = ((z - 8.0 - along) / along) ** 2 + (x**2 + y**2) / (25.0 / 0.8)
    assert np.allclose(inside, 1.0, atol=1e-13)
    assert z[np.argmax(np.hypot(x, y))] == pytest.approx(1.75, abs=0.02)


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
    x, y, z = (u * dented.radius(u)[:, None]).T
    squared = x**2 + y**2
    assert np.allclose(z, 5.0 + squared / (1.0 + np.sqrt(1.0 + 2.0 * squared)) - 0.05 * squared**2, atol=1e-11)
