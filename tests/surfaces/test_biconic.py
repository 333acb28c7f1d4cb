"""Biconic surfaces against their formula."""

import numpy as np
import pytest
from scenes import hemisphere_directions

from lensforge.errors import InputError
from lensforge.surfaces.asphere import Asphere, Biconic, SurfaceShape

U = hemisphere_directions(2000)


def points(surface) -> np.ndarray:
    return (U * surface.radius(U)[:, None]).T


def test_a_biconic_has_the_sag_of_the_standard() -> None:
    surface = Biconic(8.0, -9.0, -11.0, -0.5, 0.3)
    x, y, z = points(surface)
    b = x**2 / -9.0 + y**2 / -11.0
    a = 0.5 * x**2 / 81.0 + 1.3 * y**2 / 121.0
    above = z > 3.0  # where the sag's own sheet is
    assert np.allclose(z[above], (8.0 + b / (1.0 + np.sqrt(1.0 - a)))[above], atol=1e-12)
    assert np.allclose(Biconic(8.0, -9.0, -9.0, -0.5, -0.5).radius(U), Asphere(8.0, -9.0, -0.5).radius(U), rtol=1e-13)


def test_a_meridian_bends_alike_on_all_sides_of_a_biconic_that_is_round() -> None:
    """As that of the asphere, which is looked at on one side alone."""
    round_one, same = (SurfaceShape(face) for face in (Asphere(8.0, -9.0, -0.5), Biconic(8.0, -9.0, -9.0, -0.5, -0.5)))
    assert same.meridian_curvatures_per_mm == pytest.approx(round_one.meridian_curvatures_per_mm, rel=1e-6)


def test_a_biconic_is_symmetric_to_both_planes() -> None:
    assert Biconic(8.0, -9.0, -8.0).symmetry == "rectangle"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Biconic(8.0, -9.0, 9.0), "must have one sign"),
        (lambda: Biconic(0.0, -9.0, -9.0), "vertex at 0 mm"),
        (lambda: Biconic(8.0, -8.0, -0.5), r"not star-shaped: .* at azimuth \d+ degrees"),
    ],
)
def test_what_cannot_be_is_one_line(make, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
