"""Biconic surfaces against their formula, and the curvature of meridians."""

from dataclasses import dataclass

import numpy as np
import pytest
from scenes import hemisphere_directions

from lensforge.errors import InputError
from lensforge.surfaces.asphere import Asphere, Biconic, SurfaceShape
from lensforge.surfaces.surface import Surface

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


@dataclass(frozen=True)
class Grooved(Surface):
    """A dome with grooves around its axis, rho = 4 + 0.25 cos(7 polar angle)."""

    detail_rad: float = 0.3

    def radius(self, directions: np.ndarray) -> np.ndarray:
        return 4.0 + 0.25 * np.cos(7.0 * np.arccos(np.clip(directions[:, 2], -1.0, 1.0)))

    def gradient(self, directions: np.ndarray) -> np.ndarray:
        x, y, z = directions.T
        across = np.maximum(np.hypot(x, y), 1e-300)
        down = np.column_stack([z * x / across, z * y / across, -across])
        return (-1.75 * np.sin(7.0 * np.arccos(np.clip(z, -1.0, 1.0))))[:, None] * down


def test_meridians_have_the_curvature_of_their_curve_in_the_plane() -> None:
    """The least and the largest, of which one lies between axis and horizon."""
    polar = np.linspace(0.0, 0.5 * np.pi, 20_001)
    rho = 4.0 + 0.25 * np.cos(7.0 * polar)
    first = -1.75 * np.sin(7.0 * polar)
    second = -12.25 * np.cos(7.0 * polar)
    bent = (rho**2 + 2.0 * first**2 - rho * second) / (rho**2 + first**2) ** 1.5
    assert 0 < bent.argmin() < 20_000
    assert SurfaceShape(Grooved()).meridian_curvatures_per_mm == pytest.approx((bent.min(), bent.max()), rel=1e-3)


@dataclass(frozen=True)
class AsideBall(Surface):
    """A ball about a place beside the axis."""

    detail_rad: float = 0.3
    at_mm: tuple[float, float, float] = (1.5, -2.0, 0.5)

    def radius(self, directions: np.ndarray) -> np.ndarray:
        along = directions @ self.at_mm
        return along + np.sqrt(along**2 + 25.0 - np.dot(self.at_mm, self.at_mm))

    def normal(self, directions: np.ndarray) -> np.ndarray:
        return (self.radius(directions)[:, None] * directions - self.at_mm) / 5.0


def test_a_ball_beside_the_axis_is_bent_alike_everywhere_and_all_around() -> None:
    """Its chart is skew nearly everywhere."""
    assert SurfaceShape(AsideBall()).curvatures_per_mm == pytest.approx((0.2, 0.2), rel=1e-4)


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
