"""Intensity of a table in any direction: bilinear between its nodes, and of unit flux over all directions."""

from itertools import pairwise

import numpy as np
import pytest

from lensforge.sources.intensity import TabulatedIntensity

C_DEG, GAMMA_DEG = np.array([0.0, 90.0, 200.0, 360.0]), np.array([0.0, 30.0, 50.0, 90.0])
VALUES = np.array([[5.0, 4.0, 3.0, 0.0], [5.0, 7.0, 1.0, 2.0], [5.0, 0.0, 6.0, 1.0], [5.0, 4.0, 3.0, 0.0]])


def directions(c_deg, gamma_deg):
    c, gamma = np.deg2rad(c_deg), np.deg2rad(gamma_deg)
    return np.stack([np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), np.cos(gamma)], axis=-1)


def test_it_is_bilinear_between_the_nodes():
    table = TabulatedIntensity(C_DEG, GAMMA_DEG, VALUES)
    ratio = table.intensity(directions([45.0, 145.0, 320.0], [15.0, 40.0, 80.0])) * table.flux()
    by_hand = [
        0.5 * (4.5 + 6.0),  # half-way between C 0 and C 90, each half-way to its second node
        0.5 * (4.0 + 3.0),  # half-way between C 90 and C 200
        0.25 * (0.25 * 6.0 + 0.75 * 1.0) + 0.75 * (0.25 * 3.0),
    ]
    np.testing.assert_allclose(ratio, by_hand, rtol=1e-12)


@pytest.mark.parametrize("planes", [1, 4])
def test_its_flux_over_all_directions_is_1(planes):
    values = VALUES if planes == 4 else VALUES[:1]
    table = TabulatedIntensity(C_DEG if planes == 4 else C_DEG[:1], GAMMA_DEG, values)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    total = 0.0
    for low, high in pairwise(GAMMA_DEG):
        for first, last in pairwise(C_DEG):
            gamma = 0.5 * (high + low) + 0.5 * (high - low) * nodes
            c = 0.5 * (first + last) + 0.5 * (last - first) * nodes
            ways = directions(*np.meshgrid(c, gamma, indexing="ij")).reshape(-1, 3)
            measure = np.outer(weights * (last - first) / 2.0, weights * (high - low) / 2.0 * np.sin(np.deg2rad(gamma)))
            total += np.sum(table.intensity(ways) * measure.ravel()) * np.deg2rad(1.0) ** 2
    assert total == pytest.approx(1.0, rel=1e-10)
