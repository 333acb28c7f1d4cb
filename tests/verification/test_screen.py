import numpy as np
import pytest
from lensforge.verification.image_plane import ImagePlane, nmse, squared_norm

from lensforge.errors import InputError


def test_rows_are_y_and_flux_is_kept():
    landings = np.array([[30.0, -10.0], [30.0, -10.0], [np.nan, np.nan], [51.0, 0.0], [-50.0, 50.0]])
    image = ImagePlane(100.0, 10, filter_variance=0.0).irradiance(landings, np.array([1.0, 2.0, 4.0, 8.0, 16.0]))
    assert image[4, 8] == pytest.approx(3.0 / 1e-4)  # W/m^2 on pixels of 10 x 10 mm
    assert image[9, 0] == pytest.approx(16.0 / 1e-4)  # the edge belongs to the receiver
    assert image.sum() * 1e-4 == pytest.approx(19.0)


def test_filter_is_the_normalised_gaussian_of_variance_one():
    image = ImagePlane(50.0, 5, filter_variance=1.0).irradiance(np.zeros((1, 2)), np.ones(1)) * 1e-4
    dy, dx = np.mgrid[-1:2, -1:2]
    kernel = np.exp(-(dx**2 + dy**2) / 2.0)
    expected = np.zeros((5, 5))
    expected[1:4, 1:4] = kernel / kernel.sum()
    np.testing.assert_allclose(image, expected, atol=1e-15)


@pytest.mark.parametrize("variance", [0.0, 1.0])
def test_noise_floor_is_the_error_that_independent_rays_make(variance):
    receiver = ImagePlane(100.0, 24, variance)
    cells = np.random.default_rng(0).random((24, 24)) + 0.2
    cells[:5] = 0.0  # a dark part
    chance = np.append((cells / cells.sum()).ravel() * 0.7, 0.3)  # the rest lands nowhere

    def draw(seed, count):
        rng = np.random.default_rng(seed)
        pixel = rng.choice(24 * 24 + 1, count, p=chance)
        place = (np.stack([pixel % 24, pixel // 24], axis=1) + 0.5) * (100.0 / 24) - 50.0
        return place, rng.uniform(0.5, 1.5, count) / count

    rows, columns = np.mgrid[:24, :24]
    centres = (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) * (100.0 / 24) - 50.0
    reference = receiver.irradiance(centres, chance[:-1])
    errors, floors = [], []
    for seed in range(40):
        place, flux = draw(seed, 3000)
        errors.append(nmse(receiver.irradiance(place, flux), reference))
        floors.append(receiver.noise(place, flux).sum() / squared_norm(reference))
    assert np.mean(floors) == pytest.approx(np.mean(errors), rel=0.05)


def test_dark_reference_is_refused():
    with pytest.raises(InputError, match="must be above 0"):
        nmse(np.ones((3, 3)), np.zeros((3, 3)))
