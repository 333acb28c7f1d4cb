"""The cavity around a source against points of a paraboloid, whose radius is known."""

from dataclasses import dataclass

import numpy as np
import pytest

from lensforge.sources.build_source import cavity_around, cavity_radius
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.source_sections import DiscSource

ROOM, SHARE, PROPORTION = 1.05, 0.99, 0.6  # room around the light, share of the flux inside, height over radius


@dataclass
class Points:
    """Rays that start at the given points, and how many were asked for."""

    origins: np.ndarray
    flux: np.ndarray
    ray_count: int | None = None
    asked: int = 0
    flux_w: float = 1.0
    symmetry: str = "none"

    def sample(self, count: int, seed: int) -> RayBundle:
        self.asked = count
        return RayBundle(self.origins, np.tile([0.0, 0.0, 1.0], (len(self.flux), 1)), self.flux)

    def outline(self) -> np.ndarray:
        return self.origins


def on_paraboloid(radius_mm: float) -> np.ndarray:
    r, azimuth = radius_mm * np.array([0.0, 0.3, 0.9]), np.array([0.0, 2.0, 4.0])
    z = PROPORTION * radius_mm * (1.0 - (r / radius_mm) ** 2)
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1)


def test_points_of_a_paraboloid_have_its_radius_and_points_below_the_base_their_own() -> None:
    points, ones = on_paraboloid(2.0), np.ones(3)
    assert cavity_radius(Points(points, ones)) == pytest.approx(ROOM * 2.0)
    below = points * [1.0, 1.0, -1.0]
    assert cavity_radius(Points(below, ones)) == pytest.approx(ROOM * 0.9 * 2.0)


def test_stray_light_of_one_per_cent_stays_outside() -> None:
    points = np.array([[1.0, 0.0, 0.0], [0.0, 5.0, 0.0]])
    assert cavity_radius(Points(points, np.array([0.992, 0.008]))) == pytest.approx(ROOM * 1.0)
    assert cavity_radius(Points(points[::-1].copy(), np.array([0.02, 0.98]))) == pytest.approx(ROOM * 5.0)


def test_no_more_rays_are_asked_for_than_there_are() -> None:
    few, many, endless = (Points(on_paraboloid(1.0), np.ones(3), count) for count in (300, 10**6, None))
    assert [cavity_radius(source) for source in (few, many, endless)] == pytest.approx([ROOM] * 3)
    assert (few.asked, many.asked) == (300, endless.asked)


def test_the_cavity_of_an_even_disc() -> None:
    cavity = cavity_around(DiscSource(kind="disc", diameter_mm=4.0))
    radius = ROOM * np.sqrt(SHARE) * 2.0
    assert cavity["cavity_radius_mm"] == pytest.approx(radius, rel=0.02)
    assert cavity["cavity_height_mm"] == pytest.approx(PROPORTION * radius, rel=0.02)
