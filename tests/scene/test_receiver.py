import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.scene.pixel_grid import PixelGrid, Window, bin_flux, flux_in, splat_flux
from lensforge.scene.receiver import ReceiverPose
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.target_pattern import target_light
from lensforge.spec import ImageTarget, TextTarget

GRID = PixelGrid.square(300.0, 32)
WIDE = PixelGrid(400.0, 150.0, 48, 10)  # pixels of 8.33 x 15 mm
PLACE = {"distance_mm": 100.0, "receiver_mm": 300.0}


def _light(target) -> np.ndarray:
    return target_light((target,), Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), GRID))


def _hits(count: int, reach: float | tuple[float, float] = 140.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.uniform(-1.0, 1.0, (count, 2)) * reach, rng.random(count)


@pytest.mark.parametrize(("grid", "reach"), [(GRID, 140.0), (WIDE, (195.0, 67.0))])
def test_splat_keeps_flux_and_its_centroid(grid: PixelGrid, reach: float | tuple[float, float]) -> None:
    hits, flux = _hits(500, reach)
    image = splat_flux(hits, flux, grid)
    assert image.shape == grid.shape
    assert image.sum() == pytest.approx(flux.sum(), rel=1e-13)
    assert image.sum(0) @ grid.x() == pytest.approx((flux * hits[:, 0]).sum(), rel=1e-10)
    assert image.sum(1) @ grid.y() == pytest.approx((flux * hits[:, 1]).sum(), rel=1e-10)


@pytest.mark.parametrize("grid", [GRID, WIDE])
def test_bins_agree_with_numpy(grid: PixelGrid) -> None:
    hits, flux = _hits(5000, reach=210.0)
    columns, rows = (np.linspace(-0.5, 0.5, count + 1) for count in (grid.columns, grid.rows))
    edges = grid.height * rows, grid.width * columns
    expected, _, _ = np.histogram2d(hits[:, 1], hits[:, 0], bins=edges, weights=flux)
    assert np.allclose(bin_flux(hits, flux, grid), expected, atol=1e-12)
    assert flux_in(hits, flux, Window(*grid.size)) == pytest.approx(expected.sum(), rel=1e-12)
    assert 0.0 < expected.sum() < flux.sum()


def test_text_stands_upright_and_has_its_width() -> None:
    image = _light(TextTarget(kind="text", text="L", width_mm=100.0, **PLACE))
    _, columns = np.nonzero(image > 0.5 * image.max())
    axis = GRID.x()
    assert np.ptp(axis[columns]) == pytest.approx(100.0, abs=2 * GRID.pixel[0])
    bar = image[: len(image) // 2].sum() > image[len(image) // 2 :].sum()
    assert bar, "the foot of an L is at small y, which is row 0"


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
        _light(target)
