"""Flux code and direct ratios of luminaires whose light has a closed form, and where EULUMDAT files have them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from far_fields import far_field

from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.photometric_io import encoded, photometric_of
from lensforge.sources.photometric.room_ratios import ROOM_INDICES, direct_ratios, flux_code

ROUND = np.zeros(1)
SIDES = 2.0 * np.array(ROOM_INDICES)


def lambertian(last_deg: float = 90.0) -> CandelaTable:
    gamma = np.linspace(0.0, last_deg, 4 * round(last_deg) + 1)
    return CandelaTable(ROUND, gamma, np.maximum(np.cos(np.radians(gamma)), 0.0)[None])


def narrow(gamma_deg: float, c_deg: np.ndarray = ROUND, values: np.ndarray | None = None) -> CandelaTable:
    """Light within 0.01 degrees of a cone."""
    ring = np.tile([0.0, 1.0, 0.0], (len(c_deg), 1)) if values is None else np.outer(values, [0.0, 1.0, 0.0])
    return CandelaTable(c_deg, np.array([gamma_deg - 0.01, gamma_deg, gamma_deg + 0.01]), ring)


def test_cones_of_lambertian_light() -> None:
    """The flux up to gamma is the square of its sine."""
    assert flux_code(lambertian()) == pytest.approx((1.0 - 0.75**2, 0.75, 1.0 - 0.25**2, 1.0), rel=1e-5)


def test_light_that_goes_up_is_in_the_fourth_number_alone() -> None:
    gamma = np.linspace(0.0, 180.0, 721)
    falling = np.abs(np.cos(np.radians(gamma))) * np.where(gamma > 90.0, 0.5, 1.0)
    code = flux_code(CandelaTable(ROUND, gamma, falling[None]))
    assert code == pytest.approx((*flux_code(lambertian())[:3], 2.0 / 3.0), rel=1e-4)
    upwards = CandelaTable(ROUND, np.array([100.0, 180.0]), np.ones((1, 2)))
    assert flux_code(upwards) == (0.0,) * 4 and direct_ratios(upwards) == (0.0,) * 10


def test_direct_ratio_of_a_lambertian_ceiling_is_its_form_factor() -> None:
    """That of two equal parallel squares (Howell, Catalog of Radiation Heat Transfer, C-11)."""
    x = SIDES
    root = np.sqrt(1.0 + x**2)
    logarithm = 0.5 * np.log((1.0 + x**2) ** 2 / (1.0 + 2.0 * x**2))
    factor = 2.0 / (np.pi * x**2) * (logarithm + 2.0 * x * root * np.arctan(x / root) - 2.0 * x * np.arctan(x))
    assert direct_ratios(lambertian()) == pytest.approx(factor, rel=1e-4)


def test_direct_ratio_of_a_cone() -> None:
    """The means over a turn of |cos| and of |cos sin| are 2/pi and 1/pi."""
    gone = np.tan(np.radians(40.0)) / SIDES
    assert direct_ratios(narrow(40.0)) == pytest.approx(1.0 - 4.0 / np.pi * gone + gone**2 / np.pi, rel=2e-4)


@pytest.mark.parametrize("c_deg", [0.0, 45.0, 270.0])
def test_direct_ratio_of_a_pencil(c_deg: float) -> None:
    """Along a wall one of the two factors is 1, along the diagonal both are alike."""
    planes = np.array([0.0, 0.01, 44.99, 45.0, 45.01, 269.99, 270.0, 270.01, 359.99, 360.0])
    on = np.isclose(planes % 360.0, c_deg).astype(float)
    gone = np.tan(np.radians(30.0)) / SIDES
    straight, diagonal = 1.0 - gone, (1.0 - gone / np.sqrt(2.0)) ** 2
    expected = diagonal if c_deg == 45.0 else straight
    assert direct_ratios(narrow(30.0, planes, on)) == pytest.approx(expected, rel=3e-4)


def test_light_beyond_the_room_falls_on_no_plane() -> None:
    ratios = direct_ratios(narrow(60.0, np.array([0.0, 0.01, 359.99, 360.0]), np.array([1.0, 0.0, 0.0, 1.0])))
    assert ratios[0] == 0.0 and ratios[1] == 0.0 and ratios[2] == pytest.approx(1.0 - np.sqrt(3.0) / 2.0, rel=1e-3)


@pytest.mark.parametrize("kind", ["revolution", "rectangle", "none"])
def test_eulumdat_has_them_and_keeps_those_that_are_given(kind: str) -> None:
    lamp = far_field(kind, 1000.0)
    read = photometric_of(encoded(Path("lamp.ldt"), lamp), "lamp.ldt")
    assert read.direct_ratios == pytest.approx(direct_ratios(lamp.intensity), rel=1e-6)
    given = tuple(0.3 + 0.05 * k for k in range(10))
    read = photometric_of(encoded(Path("lamp.ldt"), replace(lamp, direct_ratios=given)), "lamp.ldt")
    assert read.direct_ratios == pytest.approx(given)
