"""Synthetic photographs: a known pattern seen by a known camera, with background, gamma and noise."""

import numpy as np
import pytest
from photo_scenes import homography
from picture_files import exif, png, tiff, with_tag
from PIL import Image
from scenes import small_spec
from scipy.ndimage import gaussian_filter

from lensforge.addons.measure.image_similarity import fit_similarity, normalised
from lensforge.addons.measure.inference import Shots, _rectified
from lensforge.addons.measure.measurement_result import central_line
from lensforge.addons.measure.photo_comparison import (
    Shot,
    _corner_error,
    _picture,
    _samples,
    compare_photo,
    lit_only,
    read_photograph,
    rectify,
)
from lensforge.errors import InputError
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver_shapes import receivers_of

SIDE, PIXELS = 200.0, 64
SQUARE = SIDE, SIDE
GRID = PixelGrid.square(SIDE, PIXELS)
WIDE = PixelGrid(SIDE, 170.0, 80, 50)  # pixels of 2.5 x 3.4 mm
# Top left, top right, bottom right, bottom left in the photograph of a tilted camera.
CORNERS = np.array([[150.0, 90.0], [820.0, 140.0], [770.0, 700.0], [110.0, 610.0]])


def pattern(x, y):
    """Two soft bars and a spot: no symmetry, so that every exchange of axes shows."""
    bar = np.exp(-(((x + 30.0) / 18.0) ** 4)) * np.exp(-((y / 70.0) ** 4))
    return 0.2 + bar + 0.7 * np.exp(-((x - 20.0) ** 2 + (y - 35.0) ** 2) / 900.0)


def simulated(shift=(0.0, 0.0), grid=GRID):
    x, y = np.meshgrid(grid.x(), grid.y())
    return pattern(x - shift[0], y - shift[1])


def photographed(corners, shift=(0.0, 0.0), size=(950, 760), target=SQUARE, light=pattern):
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    homogeneous = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
    x, y, w = np.linalg.inv(homography(corners, target)) @ homogeneous
    seen = light(x / w - shift[0], y / w - shift[1])
    return seen.reshape(size[1], size[0])


def background(shape):
    rows, columns = np.indices(shape)
    return 0.08 + 0.1 * columns / shape[1] + 0.05 * rows / shape[0]


def write(path, light, gamma=1.0, noise=0.0, seed=0):
    noisy = light + noise * np.random.default_rng(seed).normal(size=light.shape)
    values = np.round(65535 * np.clip(noisy, 0.0, 1.0) ** (1 / gamma)).astype(np.uint16)
    Image.fromarray(values).save(path, compress_level=1)  # the rest of the levels takes longer than the comparison
    return path


def shot(folder, gamma=1.0, noise=0.0, dark=True, scale=0.4):
    light = scale * photographed(CORNERS)
    behind = background(light.shape)
    on = write(folder / "on.png", light + behind, gamma, noise, 1)
    off = write(folder / "off.png", behind, gamma, noise, 2) if dark else None
    return Shot(on, off, CORNERS, SIDE, gamma)


def assert_aligned(comparison, expected, tolerances):
    """Displacements (mm), scale and rotation (deg), each to a tolerance of its own."""
    place = comparison.alignment
    values = [
        metric.value for metric in (place.displacement_x_mm, place.displacement_y_mm, place.scale, place.rotation_deg)
    ]
    assert (np.abs(np.subtract(values, expected)) < tolerances).all(), values


def transformed(of, scale=1.0, turn_deg=0.0, shift=(0.0, 0.0)):
    """The light ``of`` (x, y) enlarged, turned counter-clockwise, then shifted."""

    def light(x, y):
        cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        x, y = x - shift[0], y - shift[1]
        return of((cosine * x + sine * y) / scale, (cosine * y - sine * x) / scale)

    return light


def compare(taken):
    return compare_photo(taken, simulated=simulated(), grid=GRID, uniform=Window(50.0, 50.0).pixels(GRID))


def test_a_homography_is_undone():
    fine = GRID.finer(8)
    exact = pattern(*np.meshgrid(fine.x(), fine.y())).reshape(PIXELS, 8, PIXELS, 8).mean(axis=(1, 3))
    np.testing.assert_allclose(rectify(photographed(CORNERS), CORNERS, SQUARE, GRID), exact, atol=1e-3)


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_a_photograph_of_the_design_is_found_alike(tmp_path, gamma):
    comparison = compare(shot(tmp_path, gamma=gamma, noise=0.01))
    assert comparison.ssim > 0.99
    assert comparison.nmse < 1e-4
    assert_aligned(comparison, [0.0, 0.0, 1.0, 0.0], [0.1, 0.1, 2e-3, 0.1])
    assert comparison.likely_cause == ""
    assert comparison.measured_evenness.uniformity == pytest.approx(comparison.simulated_evenness.uniformity, rel=0.03)
    assert comparison.criteria[0].holds
    assert comparison.corners_located is None
    np.testing.assert_allclose(comparison.measured, comparison.simulated, atol=0.06)
    assert comparison.measured.mean() == pytest.approx(1.0)


def test_a_photograph_of_a_rectangle_is_found_alike(tmp_path):
    """By the corners of the receiver itself, whose pixels are no squares; uniform light is a rectangle, too."""
    light = 0.4 * photographed(CORNERS, (6.0, -4.0), target=WIDE.size)
    taken = Shot(write(tmp_path / "on.png", light), None, CORNERS)
    mask = Window(60.0, 30.0).pixels(WIDE)
    comparison = compare_photo(taken, simulated=simulated(grid=WIDE), grid=WIDE, uniform=mask)
    assert_aligned(comparison, [6.0, -4.0, 1.0, 0.0], [0.25, 0.25, 5e-3, 0.3])
    assert comparison.aligned.ssim > 0.97 and comparison.aligned.ssim > comparison.ssim
    assert comparison.measured.shape == (50, 80) and comparison.pixels == 80
    assert comparison.target_mm == (comparison.width_mm, comparison.height_mm) == WIDE.size
    inside = comparison.simulated[mask]
    assert comparison.simulated_evenness.rsd == pytest.approx(inside.std() / inside.mean())
    assert comparison.plot(axis="y").lines[0].get_xdata() == pytest.approx(WIDE.y())


def test_a_square_target_on_a_rectangle_is_its_middle(tmp_path):
    light = 0.4 * photographed(CORNERS, target=(120.0, 120.0))
    narrow = PixelGrid(100.0, 120.0, 40, 48)
    taken = Shot(write(tmp_path / "on.png", light), None, CORNERS, 120.0)
    comparison = compare_photo(taken, simulated=simulated(grid=narrow), grid=narrow, uniform=None)
    assert comparison.target_mm == (120.0, 120.0) and comparison.ssim > 0.99
    assert comparison.measured_evenness.uniformity is None


def test_the_wrong_gamma_or_no_dark_frame_shows(tmp_path):
    right = shot(tmp_path, gamma=2.2)
    wrong = Shot(right.on, right.off, right.corners, SIDE, gamma=1.0)
    assert compare(wrong).nmse > 100.0 * compare(right).nmse
    assert compare(shot(tmp_path, dark=False)).nmse > 0.01


@pytest.mark.parametrize(
    ("scale", "turn_deg", "shift"),
    [
        (1.0, 0.0, (4.5, -2.0)),
        (1.02, 0.0, (0.0, 0.0)),
        (0.98, 0.0, (0.0, 0.0)),
        (1.0, 1.5, (0.0, 0.0)),
        (1.1, -6.0, (5.0, -3.0)),
    ],
)
def test_size_and_rotation_are_found_with_the_displacement(tmp_path, scale, turn_deg, shift):
    light = 0.4 * photographed(CORNERS, light=transformed(pattern, scale, turn_deg, shift))
    comparison = compare(Shot(write(tmp_path / "on.png", light, noise=0.005), None, CORNERS, SIDE))
    assert_aligned(comparison, [*shift, scale, turn_deg], [0.15, 0.15, 2e-3, 0.1])
    assert comparison.aligned.nmse < min(comparison.nmse, 2e-3)
    cause = comparison.likely_cause
    assert ("farther away" in cause, "closer" in cause) == (scale > 1.0, scale < 1.0)
    assert ("turned against each other" in cause, "off the axis" in cause) == (turn_deg != 0.0, shift != (0.0, 0.0))


def test_errors_are_the_scatter_over_photographs():
    """By noise of both pictures, and by a smooth difference between them that is alike in neighbouring pixels."""
    grid, true = PixelGrid.square(SIDE, 40), np.array([np.log(1.02), np.radians(1.5), 3.0, -2.0])
    x, y = np.meshgrid(grid.x(), grid.y())
    seen, reference = transformed(pattern, 1.02, 1.5, (3.0, -2.0))(x, y), pattern(x, y)
    ratios = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        smooth = gaussian_filter(rng.normal(size=grid.shape), 2.0)
        noise, other = 0.01 * rng.normal(size=(2, *grid.shape))
        unlike = seen * (1.0 + 0.03 * smooth / smooth.std() + noise)
        fit = fit_similarity(normalised(unlike), normalised(reference * (1.0 + other)), grid)
        assert fit.fitted.all()
        ratios.append((fit.parameters - true) / fit.errors)
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.6


def test_the_corners_error_is_in_mm_of_the_target_that_they_bound():
    """A target of 120 x 60 mm, 240 x 120 pixels large: its centre is the mean of four corners that scatter by 0.2."""
    corners = np.array([[10.0, 20.0], [250.0, 20.0], [250.0, 140.0], [10.0, 140.0]])
    scattered = corners + 0.2 * np.random.default_rng(4).normal(size=(4000, 4, 2))
    expected = 0.5 * scattered.mean(axis=1).std(axis=0)
    np.testing.assert_allclose(_corner_error(corners, (120.0, 60.0))[2:], expected, rtol=0.05)


@pytest.mark.parametrize(
    ("light", "known"),
    [
        (lambda x, y: 1.0 / (1.0 + np.exp((np.hypot(x, y) - 60.0) / 5.0)), [True, False, True, True]),
        (lambda x, y: np.ones_like(x), [False, False, False, False]),
    ],
    ids=["round", "even"],
)
def test_what_the_light_cannot_tell_is_not_stated(light, known):
    """A round pattern has no rotation, and even light nothing: noise would tell both, with a small error."""
    grid = PixelGrid.square(SIDE, 40)
    x, y = np.meshgrid(grid.x(), grid.y())
    noise = 1.0 + 0.02 * np.random.default_rng(4).normal(size=(2, *grid.shape))
    fit = fit_similarity(normalised(light(x - 4.0, y) * noise[0]), normalised(light(x, y) * noise[1]), grid)
    assert fit.fitted.tolist() == known
    assert (fit.parameters[~fit.fitted] == 0.0).all()


def test_a_photograph_may_have_any_gain_and_dark_level():
    """A round pattern beside the middle: size and place are told, the rotation never, with the same errors."""
    grid = PixelGrid.square(SIDE, 40)
    x, y = np.meshgrid(grid.x(), grid.y())
    noise = 1.0 + 0.02 * np.random.default_rng(4).normal(size=(2, *grid.shape))
    seen, light = noise / (1.0 + np.exp((np.hypot(x - np.array([4.0, 0.0])[:, None, None], y) - 60.0) / 5.0))
    plain, changed = (fit_similarity(picture, light, grid) for picture in (seen, 50.0 * seen + 7.0))
    assert plain.fitted.tolist() == changed.fitted.tolist() == [True, False, True, True]
    assert changed.parameters == pytest.approx(plain.parameters, abs=1e-4)
    assert changed.errors == pytest.approx(plain.errors, rel=0.01)


def test_clipped_light_fails(tmp_path):
    comparison = compare(shot(tmp_path, scale=1.5))
    assert comparison.clipped > 0.05
    assert not comparison.criteria[0].holds


def test_sections_run_through_the_centre():
    wide = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(central_line(wide, "x"), [4.0, 5.0, 6.0, 7.0])
    np.testing.assert_array_equal(central_line(wide, "y"), [1.5, 5.5, 9.5])
    image = np.arange(16.0).reshape(4, 4)
    np.testing.assert_array_equal(central_line(image, "x"), [6.0, 7.0, 8.0, 9.0])
    np.testing.assert_array_equal(central_line(image, "y"), [1.5, 5.5, 9.5, 13.5])
    np.testing.assert_array_equal(central_line(np.arange(9.0).reshape(3, 3), "y"), [1.0, 4.0, 7.0])


@pytest.mark.parametrize("name", ["target_mm", "gamma"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_side_or_a_gamma_that_is_none_is_input_error(tmp_path, name, value):
    with pytest.raises(InputError, match=f"{name} = .*: must be above 0"):
        Shot(tmp_path / "on.png", None, CORNERS, **{name: value})


def test_what_cannot_be_used_is_input_error(tmp_path):
    right = shot(tmp_path)
    small = write(tmp_path / "small.png", np.ones((10, 10)))
    (tmp_path / "bad.png").write_text("no picture", encoding="utf-8")
    cases = [
        (Shot(tmp_path / "none.png", None, CORNERS, SIDE), "no such file"),
        (Shot(tmp_path / "bad.png", None, CORNERS, SIDE), "not a readable image"),
        (Shot(right.on, small, CORNERS, SIDE), "same camera settings"),
        (Shot(right.off, right.on, CORNERS, SIDE), "interchanged"),
        (Shot(right.on, right.off, CORNERS[[0, 2, 1, 3]], SIDE), "convex"),
        (Shot(right.on, right.off, CORNERS, SIDE / 3), "lies outside"),
    ]
    for given, message in cases:
        with pytest.raises(InputError, match=message):
            compare(given)


def test_all_16_bits_of_a_colour_photograph_count(tmp_path):
    values = np.random.default_rng(5).integers(0, 2**16, (20, 30, 3), dtype=np.uint16)
    values[3, 4, 1], values[values == 65535] = 65535, 65534
    values[3, 4, 1] = 65535
    for name, content in (("on.png", png(values, "rgb", 16)), ("on.tif", tiff(values, compression="zlib"))):
        (tmp_path / name).write_bytes(content)
        seen = read_photograph(tmp_path / name, gamma=2.2)
        np.testing.assert_allclose(seen.light, (values / 65535) ** 2.2 @ [0.2126, 0.7152, 0.0722], rtol=1e-12)
        assert np.argwhere(seen.clipped).tolist() == [[3, 4]]


def test_a_camera_of_12_bits_clips_at_its_own_full_scale(tmp_path):
    values = np.minimum(np.random.default_rng(5).integers(0, 5000, (20, 30)), 4095)
    packed = np.zeros((20, 45), dtype=np.uint8)  # two values in three bytes
    first, second = values[:, ::2], values[:, 1::2]
    packed[:, 0::3], packed[:, 1::3], packed[:, 2::3] = first >> 4, (first & 15) << 4 | second >> 8, second & 255
    (tmp_path / "on.tif").write_bytes(with_tag(with_tag(tiff(packed), 256, 30), 258, 12))
    seen = read_photograph(tmp_path / "on.tif")
    np.testing.assert_array_equal(seen.light, values / 4095)
    np.testing.assert_array_equal(seen.clipped, values == 4095)


def test_the_dark_photograph_is_turned_as_the_lit_one(tmp_path):
    grey = np.random.default_rng(6).integers(1, 255, (20, 30, 1))
    (tmp_path / "on.png").write_bytes(png(grey, extra=[(b"eXIf", exif(6))]))
    (tmp_path / "off.png").write_bytes(png(grey))  # the camera's sensor of place thought otherwise
    on = read_photograph(tmp_path / "on.png")
    off = read_photograph(tmp_path / "off.png", orientation=on.orientation)
    assert on.light.shape == (30, 20)
    np.testing.assert_array_equal(lit_only(on, off).light, 0.0)


def test_the_dark_photograph_is_turned_where_both_are_compared_with_the_light(tmp_path):
    """The LED adds as much to every pixel of a cluttered room: its light is even."""
    room = np.random.default_rng(6).integers(1, 120, (40, 60, 1))
    (tmp_path / "on.png").write_bytes(png(room + 100, extra=[(b"eXIf", exif(6))]))
    (tmp_path / "off.png").write_bytes(png(room))
    corners = np.array([[2.0, 3.0], [36.0, 3.0], [36.0, 55.0], [2.0, 55.0]])
    shot = Shot(tmp_path / "on.png", tmp_path / "off.png", corners)
    seen, located = _picture(shot, PixelGrid.square(SIDE, 16), np.ones((16, 16)))
    assert located is None
    np.testing.assert_allclose(seen.light, 1.0, atol=1e-12)
    (tmp_path / "next.png").write_bytes(png(room + 120))
    shots = Shots((tmp_path / "on.png", tmp_path / "next.png"), np.zeros((2, 3)), tmp_path / "off.png", corners, 1.0)
    (receiver,) = receivers_of(small_spec(target__width_mm=SIDE, target__receiver_mm=SIDE, target__uniform_mm=None), 16)
    rectified = _rectified(shots, receiver, np.random.default_rng(3).uniform(0.9, 1.1, (2, 16, 16)))
    np.testing.assert_allclose(rectified.light, 1.0, atol=1e-12)
    assert rectified.clipped == 0.0 and rectified.located is None


@pytest.mark.parametrize("behind", [False, True])
def test_a_camera_behind_the_panel_has_the_light_by_its_corners_in_their_order(behind: bool) -> None:
    """The picture mirrored left to right, with the corners where they are then: the same light on the target."""
    picture = photographed(CORNERS)
    wide = picture.shape[1] - 1
    corners = CORNERS * (-1.0, 1.0) + (wide, 0.0) if behind else CORNERS
    seen = rectify(picture[:, ::-1] if behind else picture, corners, SQUARE, GRID)
    np.testing.assert_allclose(seen / seen.mean(), simulated() / simulated().mean(), atol=0.03)
    crossed = corners[[0, 1, 3, 2]]
    with pytest.raises(InputError, match="they bound no convex quadrilateral; the order is top left, top right"):
        rectify(picture, crossed, SQUARE, GRID)


def test_photographs_of_other_kinds_are_refused(tmp_path):
    (tmp_path / "on.tif").write_bytes(tiff(np.zeros((8, 8, 1), dtype=np.float32)))
    with pytest.raises(InputError, match="float32, must be of 8 or 16 bits"):
        read_photograph(tmp_path / "on.tif")


@pytest.mark.parametrize("sides", [(40.0, 120.0), (120.0, 40.0)])
def test_a_pixel_is_sampled_as_finely_as_the_longer_side_of_the_picture_is(sides: tuple[float, float]) -> None:
    """10 pixels of 1 mm along 120 of the photograph: 12 samples each way."""
    wide, high = sides
    corners = np.array([[0.0, 0.0], [wide, 0.0], [wide, high], [0.0, high]])
    assert _samples(corners, (10.0, 10.0), PixelGrid.square(10.0, 10)) == 12
