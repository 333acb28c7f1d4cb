import numpy as np
import pytest
import torch
from PIL import Image

from lensforge.errors import InputError
from lensforge.optimisation.merit import nmse_loss, uniformity_loss
from lensforge.optimisation.symmetry import mirror_mean
from lensforge.receivers.pixels import PixelGrid, bin_flux, flux_in_square, gaussian3, splat_flux
from lensforge.receivers.targets import target_irradiance
from lensforge.spec import CrossTarget, FlatTopTarget, ImageTarget, TextTarget

GRID = PixelGrid(300.0, 32)
PLACE = {"distance_mm": 100.0, "receiver_mm": 300.0}


def _hits(count: int, reach: float = 140.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.uniform(-reach, reach, (count, 2)), rng.random(count)


def test_splat_keeps_flux_and_its_centroid() -> None:
    hits, flux = _hits(500)
    image = splat_flux(hits, flux, GRID)
    assert image.sum() == pytest.approx(flux.sum(), rel=1e-13)
    axis = GRID.axis_mm()
    assert image.sum(0) @ axis == pytest.approx((flux * hits[:, 0]).sum(), rel=1e-10)
    assert image.sum(1) @ axis == pytest.approx((flux * hits[:, 1]).sum(), rel=1e-10)


def test_splat_on_a_pixel_centre_lights_that_pixel_alone() -> None:
    axis = GRID.axis_mm()
    image = splat_flux(np.array([[axis[5], axis[9]]]), np.ones(1), GRID)
    assert image[9, 5] == pytest.approx(1.0, abs=1e-12)


def test_bins_agree_with_numpy() -> None:
    hits, flux = _hits(5000, reach=200.0)
    edges = np.linspace(-150, 150, 33)
    expected, _, _ = np.histogram2d(hits[:, 1], hits[:, 0], bins=(edges, edges), weights=flux)
    assert np.allclose(bin_flux(hits, flux, GRID), expected, atol=1e-12)
    assert flux_in_square(hits, flux, 300.0) == pytest.approx(expected.sum(), rel=1e-12)


def test_filter_is_the_paper_s_three_by_three_gaussian() -> None:
    point = np.zeros((9, 9))
    point[4, 4] = 1.0
    kernel = np.exp(-0.5 * np.add.outer(np.arange(-1, 2) ** 2, np.arange(-1, 2) ** 2))
    assert np.allclose(gaussian3(point, 1.0)[3:6, 3:6], kernel / kernel.sum(), atol=1e-15)
    assert np.allclose(gaussian3(np.ones((5, 5)), 1.0), 1.0)
    assert gaussian3(point, 0.0) is point


def test_losses_at_known_images() -> None:
    wanted = torch.ones(4, 4, dtype=torch.float64)
    assert nmse_loss(wanted * 1.5, wanted).item() == pytest.approx(0.25)
    half = torch.ones(4, 4, dtype=torch.float64)
    half[:, 2:] = 3.0
    assert uniformity_loss(half, torch.ones(4, 4, dtype=torch.bool)).item() == pytest.approx(0.25)


@pytest.mark.parametrize("name", ["none", "mirror_x", "mirror_y", "rectangle", "square"])
def test_mirror_mean_is_a_projection_that_keeps_flux(name: str) -> None:
    image = torch.from_numpy(np.random.default_rng(0).random((8, 8)))
    once = mirror_mean(image, name)
    assert torch.allclose(mirror_mean(once, name), once, atol=1e-15)
    assert once.sum().item() == pytest.approx(image.sum().item())


def test_flat_top_is_the_mean_of_the_super_gaussian_over_each_pixel() -> None:
    target = FlatTopTarget(kind="flat_top", half_width_mm=100.0, exponent=18.0, **PLACE)
    image = target_irradiance(target, GRID)
    fine = np.linspace(-150, 150, 32 * 400 + 1)
    fine = 0.5 * (fine[1:] + fine[:-1])
    profile = np.exp(-(np.abs(fine / 100.0) ** 18)).reshape(32, 400).mean(axis=1)
    expected = np.outer(profile, profile)
    assert np.allclose(image, expected / expected.sum(), rtol=0, atol=2e-3 * image.max())


def test_cross_has_the_area_of_a_cross_and_eight_mirror_images() -> None:
    target = CrossTarget(kind="cross", length_mm=150.0, stroke_mm=37.5, edge_mm=4.0, **PLACE)
    image = target_irradiance(target, GRID)
    assert 1.0 / image.max() * GRID.pitch_mm**2 == pytest.approx(2 * 150 * 37.5 - 37.5**2, rel=1e-3)
    assert np.allclose(mirror_mean(torch.from_numpy(image), "square").numpy(), image, atol=1e-15)


def test_text_stands_upright_and_has_its_width() -> None:
    image = target_irradiance(TextTarget(kind="text", text="L", width_mm=100.0, **PLACE), GRID)
    _, columns = np.nonzero(image > 0.5 * image.max())
    axis = GRID.axis_mm()
    assert np.ptp(axis[columns]) == pytest.approx(100.0, abs=2 * GRID.pitch_mm)
    bar = image[: len(image) // 2].sum() > image[len(image) // 2 :].sum()
    assert bar, "the foot of an L is at small y, which is row 0"


def test_image_keeps_its_aspect_and_its_top(tmp_path) -> None:
    picture = np.zeros((40, 80), dtype=np.uint8)
    picture[:10] = 255  # a bright stripe on top
    Image.fromarray(picture).save(tmp_path / "stripe.png")
    target = ImageTarget(kind="image", file=tmp_path / "stripe.png", width_mm=200.0, **PLACE)
    image = target_irradiance(target, GRID)
    y = (image.sum(axis=1) @ GRID.axis_mm()) / image.sum()
    assert y == pytest.approx(50.0 - 12.5, abs=0.5)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (TextTarget(kind="text", text=" ", width_mm=10.0, **PLACE), "nothing to draw"),
        (TextTarget(kind="text", text="W", width_mm=400.0, **PLACE), "must fit into receiver_mm"),
        (ImageTarget(kind="image", file="nowhere.png", width_mm=10.0, **PLACE), "no such file"),
    ],
)
def test_impossible_targets_are_named(target, message: str) -> None:
    with pytest.raises(InputError, match=message):
        target_irradiance(target, GRID)


def test_a_black_image_is_refused(tmp_path) -> None:
    Image.new("L", (8, 8)).save(tmp_path / "black.png")
    target = ImageTarget(kind="image", file=tmp_path / "black.png", width_mm=100.0, **PLACE)
    with pytest.raises(InputError, match="dark everywhere on the receiver"):
        target_irradiance(target, GRID)
