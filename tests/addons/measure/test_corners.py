"""Corners found in rendered photographs whose corners are known."""

import numpy as np
import pytest
from nightly import first_by_day
from photo_scenes import CORNERS, PATTERNS, SIZE, TARGET_MM, Scene
from PIL import Image

from lensforge.addons.measure.photo_comparison import _ORIENTATIONS, Shot, _turned, compare_photo, rectify
from lensforge.addons.measure.target_corners import clockwise, enclosing, locate
from lensforge.errors import InputError
from lensforge.scene.pixel_grid import PixelGrid

TARGET = TARGET_MM, TARGET_MM
GRID = PixelGrid.square(TARGET_MM, 100)


def error_px(location, corners=CORNERS):
    return np.linalg.norm(location.corners - corners, axis=1).max()


# Two patterns by day, one with a photograph without light; all pairs nightly.
PAIRS = [(pattern, index % 2 == 0) for index, pattern in enumerate(PATTERNS)]
PAIRS += [(pattern, not dark) for pattern, dark in PAIRS]


@pytest.mark.parametrize(("pattern", "dark"), first_by_day(2, PAIRS))
def test_corners_are_found_to_a_fifth_of_a_pixel_whatever_the_pattern(pattern, dark):
    on, off = Scene(pattern).pictures()
    location = locate(on, off if dark else None, border_share=0.0)
    assert error_px(location) < 0.2
    assert not location.located.lit


@pytest.mark.parametrize(
    ("scene", "limit"),
    first_by_day(
        1,
        [
            (Scene("pi", noise=0.02), 1.0),  # half of the step at the border
            (Scene(room=0.0, spill=0.02), 0.5),  # a dark room: the LED's own stray light shows the border
            (Scene(vignetting=1.5), 0.2),
            (Scene(corners=np.array([[125.0, 30.0], [350.0, 90.0], [345.0, 280.0], [60.0, 350.0]])), 0.2),
        ],
    ),
)
def test_noise_darkness_vignetting_and_perspective_cost_little(scene, limit):
    corners = CORNERS if scene.corners is None else scene.corners
    assert error_px(locate(*scene.pictures(), border_share=0.0), corners) < limit


@pytest.mark.parametrize(
    ("scene", "message"),
    first_by_day(
        2,
        [
            (Scene(room=0.0, spill=0.0), "no square .* give corners"),
            (Scene("flat top", room=0.0, spill=0.0), "edge of the light itself.* give target_mm"),
            (Scene(bow=0.05), "bent by .* pixels"),
            (Scene(corners=np.array([[235.0, 40.0], [400.0, 190.0], [235.0, 350.0], [75.0, 195.0]])), "rolled by"),
        ],
        "a second each",
    ),
)
def test_what_is_not_certain_is_one_line_with_what_to_do(scene, message):
    with pytest.raises(InputError, match=message) as caught:
        locate(*scene.pictures(), border_share=0.0)
    assert "corners" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_squares_one_within_the_other_are_both_named():
    with pytest.raises(InputError, match=r"2 squares .* or "):
        locate(*Scene(board=0.55).pictures(), border_share=0.0)


def test_the_edges_of_a_square_of_light_are_taken_when_its_side_is_given():
    on, off = Scene("flat top", room=0.0, spill=0.0).pictures()
    location = locate(on, off, border_share=0.0, lit_square=True)
    assert location.located.lit
    # Half of the edges' level lies at +-70 mm: seen through the panel's homography.
    plane = PixelGrid.square(TARGET_MM, 300)
    light = rectify(on - off, location.corners, (140.0, 140.0), PixelGrid.square(140.0, 140))
    assert light.min() > 0.15 * light.max()
    panel = rectify(on - off, CORNERS, TARGET, plane)
    wide = np.abs(plane.x()) < 70.0
    assert light.mean() == pytest.approx(panel[np.ix_(wide, wide)].mean(), rel=0.02)


def test_a_quadrilateral_around_its_own_pixels_is_itself():
    rows, columns = np.indices((300, 400))
    inside = np.ones(rows.shape, dtype=bool)
    corners = np.array([[50.0, 40.0], [350.0, 70.0], [320.0, 260.0], [80.0, 240.0]])
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (end[0] - start[0]) * (rows - start[1]) - (end[1] - start[1]) * (columns - start[0]) >= 0
    assert np.abs(enclosing(inside) - corners).max() < 2.0
    np.testing.assert_array_equal(clockwise(np.roll(corners, 2, axis=0)), corners)
    assert enclosing(np.eye(300, 400, dtype=bool)[:1]) is None


@pytest.mark.parametrize("way", _ORIENTATIONS)
def test_turning_a_picture_is_turning_its_corners(way):
    light = Scene("pi").light(lit=True)
    grid, order = PixelGrid.square(TARGET_MM, 40), list(_ORIENTATIONS[way])
    given, upright = (rectify(light, corners, TARGET, grid) for corners in (CORNERS[order], CORNERS))
    np.testing.assert_allclose(given, _turned(upright, _ORIENTATIONS[way]), atol=0.02)


@pytest.fixture
def shot(tmp_path):
    def take(mirrored=False):
        pictures = Scene("letter").pictures()
        for name, picture in zip(("on", "off"), pictures, strict=True):
            seen = picture[:, ::-1] if mirrored else picture
            Image.fromarray(np.round(65535 * seen).astype(np.uint16)).save(tmp_path / f"{name}.png")
        return Shot(tmp_path / "on.png", tmp_path / "off.png", None)

    return take


def simulated():
    return rectify(Scene("letter", room=0.0, noise=0.0, vignetting=0.0).light(lit=True), CORNERS, TARGET, GRID)


def test_a_photograph_is_compared_by_the_corners_that_were_found(shot):
    given = {"simulated": simulated(), "grid": GRID, "uniform": None}
    comparison = compare_photo(shot(), **given)
    assert comparison.ssim > 0.9
    assert comparison.nmse < 0.03
    place = comparison.alignment
    assert max(abs(place.displacement_x_mm.value), abs(place.displacement_y_mm.value)) < 0.2
    assert place.scale.value == pytest.approx(1.0, abs=3e-3)
    assert comparison.corners_located.seen_in in ("on", "off")
    assert np.linalg.norm(np.array(comparison.corners) - CORNERS, axis=1).max() < 0.2


def test_a_mirrored_picture_is_said_to_be_one(shot, tmp_path):
    given = {"simulated": simulated(), "grid": GRID, "uniform": None}
    with pytest.raises(InputError, match="mirrored, left for right") as caught:
        compare_photo(shot(mirrored=True), **given)
    order = str(caught.value).split("give corners ")[1].split(";")[0]
    corners = np.array([[float(part) for part in pair.split(",")] for pair in order.split()])
    right = CORNERS * [-1.0, 1.0] + [SIZE[0] - 1.0, 0.0]
    assert np.linalg.norm(corners - right, axis=1).max() < 0.5
    again = Shot(tmp_path / "on.png", tmp_path / "off.png", corners)
    assert compare_photo(again, **given).ssim > 0.9


@pytest.mark.parametrize(
    ("way", "quarters"),
    [("rotated by 90 deg anticlockwise", 1), ("rotated by 180 deg", 2), ("rotated by 90 deg clockwise", 3)],
)
def test_a_turn_is_called_what_a_reader_of_the_picture_calls_it(way, quarters):
    """numpy turns anticlockwise a picture whose first row is its top; here the first row is its bottom."""
    picture = np.random.default_rng(2).random((3, 5))
    np.testing.assert_array_equal(_turned(picture[::-1], _ORIENTATIONS[way])[::-1], np.rot90(picture, quarters))
