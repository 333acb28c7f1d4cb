"""The compiled sums of basis functions against closed forms and against plain sums, whatever the block they are in."""

import numpy as np
import pytest
import torch
from exact_surface import ExactSurface
from scenes import hemisphere_directions, random_surface

from lensforge.kernels.basis_sum import BLOCK
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

# Widths (rad) of one function: by the series of the angle itself, by that of its half, and wider than the sphere.
SIGMAS = [0.02, 0.1, 0.24, 0.25, 1.0, 10.0]


def _single(sigma: float) -> SrbfSurface:
    basis = SrbfBasis((1,), sigma / np.arccos(0.0))
    return SrbfSurface(basis, np.ones(1), 0.0)


def _at(surface: SrbfSurface, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions at ``angles`` from the centre of its only function, and the unit tangents back to it."""
    centre = surface.basis.centres[0]
    across = np.cross(centre, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    cosine = np.cos(angles)[:, None]
    sine = np.sin(angles)[:, None]
    return cosine * centre + sine * across, sine * centre - cosine * across


@pytest.mark.parametrize("sigma", SIGMAS)
def test_one_function_is_its_closed_form(sigma: float) -> None:
    # opposite the centre a direction's rounding grows
    surface = _single(sigma)
    angles = np.linspace(0.0, 3.0, 4001)
    directions, towards = _at(surface, angles)
    exact = np.exp(-((angles / sigma) ** 2))
    rounding = 1e-15 * (2.0 + 1.0 / sigma)  # of the directions
    assert np.abs(surface.radius(directions) - exact).max() < rounding
    beyond = 4.0 * np.sin(0.5 * angles) ** 2 > (1.0 + 1e-9) * surface.basis.reaches[0]
    assert not surface.radius(directions)[beyond].any() and not surface.gradient(directions)[beyond].any()
    slope = (2.0 * angles / sigma**2 * exact)[:, None] * towards
    assert np.abs(surface.gradient(directions) - slope).max() < 2.0 * rounding * (1.0 + 1.0 / sigma)


def test_opposite_the_centre_a_function_is_finite_and_flat() -> None:
    basis = SrbfBasis((289,), 20.0)
    for weights, centre in zip(np.eye(289)[::17], basis.centres[::17], strict=True):
        surface = SrbfSurface(basis, weights, 0.0)
        opposite = -centre[None]
        assert surface.radius(opposite) == pytest.approx(np.exp(-((np.pi / basis.sigmas[0]) ** 2)), rel=1e-5)
        assert np.abs(surface.gradient(opposite)).max() < 1e-6


def test_the_sums_are_those_of_plain_arithmetic() -> None:
    surface = random_surface(6, 6.0, levels=(9, 81, 289, 1089), symmetry="square")
    plain = ExactSurface.of(surface)
    u = hemisphere_directions(500)
    assert np.abs(surface.radius(u) - plain.radius(torch.from_numpy(u)).numpy()).max() < 1e-13
    assert np.abs(surface.gradient(u) - plain.gradient(torch.from_numpy(u)).numpy()).max() < 1e-12


def test_a_direction_has_the_same_bits_in_any_company() -> None:
    surface = random_surface(7, 6.0, levels=(9, 81, 289))
    u = hemisphere_directions(20 * BLOCK + 5)
    radius = surface.radius(u)
    gradient = surface.gradient(u)
    some = np.random.default_rng(3).permutation(len(u))[:41]
    assert np.array_equal(surface.radius(u[some]), radius[some])
    assert np.array_equal(surface.gradient(u[some]), gradient[some])


def test_what_is_no_direction_leaves_its_neighbours_alone() -> None:
    surface = random_surface(8, 6.0, levels=(9, 81, 289))
    u = hemisphere_directions(200)
    spoilt = u.copy()
    spoilt[17] = np.nan
    others = np.arange(len(u)) != 17
    assert np.array_equal(surface.radius(spoilt)[others], surface.radius(u)[others])
    assert np.array_equal(surface.gradient(spoilt)[others], surface.gradient(u)[others])


def test_a_sum_alone_has_the_bits_of_the_sum_with_its_slope() -> None:
    """Broad functions, too, whose angle is taken at its half, and mirror images."""
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = SrbfBasis((3, 40), 1.7, "mirror_x")
    surface = SrbfSurface(basis, rng.normal(size=basis.size), 9.0)
    assert np.array_equal(surface.radius(directions), surface.radius_and_gradient(directions)[0])
