import numpy as np
import pytest
from scenes import hemisphere_directions, random_surface

from lensforge.errors import InputError
from lensforge.surfaces import surface as chart
from lensforge.surfaces.mirror_group import NAMES, contains, group
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere, level_sigma


def test_the_chart_and_its_inverse_cancel() -> None:
    u = hemisphere_directions(1000)
    assert np.allclose(chart.to_sphere(chart.to_chart(3.7 * u)), u, atol=1e-15)


def test_one_function_has_the_value_of_the_paper() -> None:
    basis = SrbfBasis((9,), 1.75)
    surface = SrbfSurface(basis, np.eye(9)[4] * 0.3, 2.0)
    u = hemisphere_directions(200)
    angle = np.arccos(np.clip(u @ basis.centres[4], -1, 1))
    sigma = 1.75 * np.arccos(1 - 1 / 9)
    assert np.allclose(surface.radius(u), 2.0 + 0.3 * np.exp(-((angle / sigma) ** 2)), atol=1e-14)


@pytest.mark.parametrize("symmetry", NAMES)
@pytest.mark.parametrize("sigma_c", [0.2, 1.75, 20.0])
def test_what_is_left_out_of_the_sum_is_below_its_rounding(symmetry: str, sigma_c: float) -> None:
    basis = SrbfBasis((9, 81, 289), sigma_c, symmetry)
    weights = np.random.default_rng(5).normal(size=basis.size)
    u = np.concatenate([hemisphere_directions(200), basis.centres[::40], -basis.centres[::60]])
    every = np.abs(weights) @ basis.evaluate(u).T
    error = SrbfSurface(basis, weights, 0.0).radius(u) - basis.evaluate(u) @ weights
    # far from a centre the dense basis takes the chord from a dot product: its exponent of 40 is off by 1e-12
    assert (np.abs(error) <= 1e-11 * every + 1e-18 * np.abs(weights).sum()).all()


@pytest.mark.parametrize("symmetry", NAMES)
def test_a_symmetric_surface_is_unchanged_by_every_mirror(symmetry: str) -> None:
    surface = random_surface(3, 6.0, symmetry=symmetry)
    u = hemisphere_directions(100)
    for image in group(symmetry):
        assert np.allclose(surface.radius(u @ image), surface.radius(u), atol=1e-13)


def test_groups_are_closed_and_ordered() -> None:
    for name in NAMES:
        products = [a @ b for a in group(name) for b in group(name)]
        assert all(any(np.array_equal(p, g) for g in group(name)) for p in products)
    assert contains("square", "rectangle") and contains("rectangle", "mirror_x")
    assert not contains("mirror_x", "mirror_y")


def test_centres_share_the_hemisphere_equally() -> None:
    centres = fibonacci_hemisphere(289)
    owner = np.argmax(hemisphere_directions(200_000) @ centres.T, axis=1)
    share = np.bincount(owner, minlength=289) * 289 / 200_000
    assert share.min() > 0.5 and share.max() < 1.5
    # Eq. (3): the cap of half-angle sigma/sigma_c holds exactly one share of the hemisphere
    assert 1 - np.cos(level_sigma(289, 1.0)) == pytest.approx(1 / 289, rel=1e-12)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="sigma_c = 0"):
        SrbfBasis((9,), 0.0)
    with pytest.raises(InputError, match="3 given, the basis has 9"):
        SrbfSurface(SrbfBasis((9,), 1.0), np.zeros(3), 1.0)
    with pytest.raises(InputError, match="not finite"):
        SrbfSurface(SrbfBasis((9,), 1.0), np.full(9, np.nan), 1.0)
