"""SRBF surfaces where their formula is delicate: centres, axis, rim, very narrow and very wide functions."""

import numpy as np
import pytest
from extremes import fuzzed, unit
from hypothesis import given
from hypothesis import strategies as st
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.search.parameters import SphereParameters
from lensforge.surfaces.bicubic_table import grid_for
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, level_sigma

SIGMA = st.floats(-3.0, 1.0).map(lambda exponent: 10.0**exponent)  # 1e-3 to 10 rad
LEVELS = st.sampled_from([(1,), (2,), (9, 25), (289,)])


def _surface(levels: tuple[int, ...], sigma: float, weight: float, symmetry: str = "none") -> SrbfSurface:
    """The narrowest function ``sigma`` wide."""
    basis = SrbfBasis(levels, sigma / level_sigma(levels[-1], 1.0), symmetry)
    weights = np.random.default_rng(0).uniform(-weight, weight, basis.size)
    return SrbfSurface(basis, weights, 1.0)


def _delicate(basis: SrbfBasis, offset: float) -> np.ndarray:
    """Every centre, a hair beside it, the axis, and up to the rim exactly."""
    tilt = np.array([1e-3, 1e-8, 1e-16])
    rim = np.stack([np.cos(tilt * 7.0), np.sin(tilt * 7.0), tilt * 0.0], axis=1)
    near_rim = np.stack([np.sqrt(1.0 - tilt**2), 0.0 * tilt, tilt], axis=1)
    beside = unit(basis.centres + offset * np.array([1.0, -2.0, 0.5]))
    return np.concatenate([basis.centres, beside, [[0.0, 0.0, 1.0]], rim, near_rim])


@fuzzed(25)
@given(LEVELS, SIGMA, st.floats(-16.0, -1.0), st.sampled_from(["none", "rectangle", "square"]))
def test_value_gradient_and_normal_are_finite_and_in_bounds(levels, sigma, exponent, symmetry) -> None:
    surface = _surface(levels, sigma, 0.1 / sum(levels), symmetry)
    u = _delicate(surface.basis, 10.0**exponent)
    values = surface.basis.evaluate(u)
    assert ((values >= 0.0) & (values <= 1.0)).all()
    gradient, normal = surface.gradient(u), surface.normal(u)
    assert np.isfinite(gradient).all() and np.isfinite(normal).all()
    noise = 2e-15 * (1.0 + 1.0 / sigma**2)  # of c - (u.c)u, where it vanishes
    assert np.abs(np.sum(gradient * u, axis=1)).max() <= noise
    assert np.abs(np.linalg.norm(normal, axis=1) - 1.0).max() < 1e-14
    # |d exp(-g^2/s^2)/dg| has its maximum sqrt(2/e)/s at g = s/sqrt(2)
    assert (
        np.linalg.norm(gradient, axis=1).max()
        <= np.abs(surface.weights_mm).sum() * np.sqrt(2.0 / np.e) / sigma * 1.001 + noise
    )


@pytest.mark.parametrize("sigma", [1e-3, 1e-2, 0.1, 1.0, 10.0])
def test_the_gradient_is_the_slope_on_the_way_through_a_centre(sigma: float) -> None:
    """exp(-g^2/s^2) along the great circle through the centre, from 1e-6 s to 2 s beside it: closed form."""
    basis = SrbfBasis((7,), sigma / level_sigma(7, 1.0))
    centre = basis.centres[3]
    across = unit(np.cross(centre, [0.3, 0.5, -0.2]))
    angle = np.minimum(sigma, 1.0) * np.geomspace(1e-6, 2.0, 9)
    u = np.cos(angle)[:, None] * centre + np.sin(angle)[:, None] * across
    along = -np.sin(angle)[:, None] * centre + np.cos(angle)[:, None] * across
    weights = (np.arange(7) == 3).astype(float)
    slope = np.sum(SrbfSurface(basis, weights, 1.0).gradient(u) * along, axis=1)
    assert np.allclose(
        slope, -2.0 * angle / sigma**2 * np.exp(-((angle / sigma) ** 2)), rtol=1e-9, atol=2e-15 / sigma**2
    )
    assert np.allclose(basis.evaluate(u)[:, 3], np.exp(-((angle / sigma) ** 2)), rtol=1e-11, atol=0)


@pytest.mark.parametrize("sigma", [0.0, 5e-324, 1e-9, 1e-3])
def test_functions_too_narrow_for_a_table_are_refused_in_one_line(sigma: float) -> None:
    with pytest.raises(InputError, match=r"sigma = .* resolves"):
        grid_for(sigma, 6.0)


def test_a_spec_of_such_functions_is_told_which_field_to_change() -> None:
    with pytest.raises(InputError, match=r"sigma = .* resolves .* raise lens\.sigma_c") as refused:
        SphereParameters.of(small_spec(lens__sigma_c=1e-5), 6.0)
    assert "\n" not in str(refused.value)
