"""Emitting areas by hand: where numbers of the unit square start, the density there, and corners around all of it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lensforge.errors import InputError
from lensforge.sources.emitting_area import Disc, LuminanceImage, Rectangles
from lensforge.sources.planar_emitter import planar_emitter
from lensforge.spec.source_sections import LuminanceSource


def test_a_disc_is_filled_by_the_root_of_the_first_number_and_the_turn_of_the_second() -> None:
    disc = Disc(2.0)
    placed = disc.place(np.array([[0.25, 0.0], [0.49, 0.25], [0.81, 0.625]]))
    half = 1.8 * np.sqrt(0.5)
    np.testing.assert_allclose(placed, [[1.0, 0.0], [0.0, 1.4], [-half, -half]], atol=1e-12)
    np.testing.assert_allclose(disc.density(placed), 1.0 / (4.0 * np.pi))
    assert disc.symmetry == "square"


CHIPS = Rectangles(np.array([[1.0, 0.0], [-2.0, 0.5]]), np.array([[0.5, 1.0], [2.0, 3.0]]), np.array([0.25, 0.75]))


def test_rectangles_are_filled_one_after_the_other_by_their_shares() -> None:
    placed = CHIPS.place(np.array([[0.0, 0.0], [0.125, 0.75], [0.25, 0.5], [0.625, 1.0]]))
    by_hand = [[0.75, -0.5], [1.0, 0.25], [-3.0, 0.5], [-2.0, 2.0]]
    np.testing.assert_allclose(placed, by_hand, atol=1e-12)


def test_the_density_is_the_share_over_the_area_of_each_rectangle_at_a_point() -> None:
    """On the edge, by the rounding of a start point beyond it, and just outside."""
    inside, outside = 0.25 / 0.5, 0.75 / 6.0
    points = [[1.0, 0.0], [1.25, 0.5], [1.25 + 5e-10, 0.0], [1.25 + 1e-8, 0.0], [1.0, -0.5 - 1e-8], [-3.0, -1.0]]
    densities = CHIPS.density(np.array([*points, [-1.0, 2.0], [-1.0 + 1e-6, 2.0]]))
    np.testing.assert_allclose(densities, [inside, inside, inside, 0.0, 0.0, outside, outside, 0.0], atol=1e-15)
    twice = Rectangles(np.zeros((2, 2)), np.array([[2.0, 2.0], [1.0, 1.0]]), np.array([0.4, 0.6]))
    np.testing.assert_allclose(twice.density(np.array([[0.9, 0.0], [0.1, 0.2]])), [0.1, 0.7])


PIXELS = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 3.0, 1.0, 0.0], [0.0, 0.0, 4.0, 0.0]]) / 8.0
PICTURE = LuminanceImage(PIXELS, 0.5)  # 2 mm wide, 1.5 mm high


def test_a_picture_is_filled_by_rows_from_the_top_and_by_columns_from_the_left() -> None:
    """Rows have half of the light each; of the first, three quarters are in the second column."""
    placed = PICTURE.place(np.array([[0.0, 0.0], [0.25, 0.375], [0.25, 0.875], [0.75, 0.5], [0.875, 0.25]]))
    by_hand = [[-0.5, 0.25], [-0.25, 0.0], [0.25, 0.0], [0.25, -0.5], [0.125, -0.625]]
    np.testing.assert_allclose(placed, by_hand, atol=1e-12)
    top = LuminanceImage(np.array([[1.0, 3.0], [2.0, 2.0]]) / 8.0, 1.0)
    placed = top.place(np.array([[0.25, 0.125], [0.25, 0.625], [0.75, 0.25]]))
    np.testing.assert_allclose(placed, [[-0.5, 0.5], [0.5, 0.5], [-0.5, -0.5]], atol=1e-12)


def test_the_density_of_a_picture_is_that_of_the_pixel_at_a_point() -> None:
    """Each pixel a little inside its corners, the corners of the picture themselves, and points beyond by rounding."""
    for row, column in np.ndindex(PIXELS.shape):
        left, top = 0.5 * column - 1.0, 0.75 - 0.5 * row
        points = np.array([[left + x, top - y] for x in (1e-6, 0.499999) for y in (1e-6, 0.499999)])
        np.testing.assert_allclose(PICTURE.density(points), PIXELS[row, column] / 0.25)
    full = LuminanceImage(np.array([[1.0, 2.0], [3.0, 4.0]]) / 10.0, 1.0)
    edge = 1.0 + 1e-9
    corners = np.array([[-edge, edge], [edge, edge], [-edge, -edge], [edge, -edge]])
    np.testing.assert_allclose(full.density(corners), [0.1, 0.2, 0.3, 0.4])


def test_the_outline_of_a_picture_is_that_of_its_light() -> None:
    np.testing.assert_allclose(PICTURE.corners(), [[-0.5, -0.75], [0.5, -0.75], [0.5, 0.25], [-0.5, 0.25]])


MIRRORED = {
    "none": [[1, 2, 3], [4, 5, 6]], "mirror_x": [[1, 2, 1], [4, 5, 4]], "mirror_y": [[1, 2, 3], [1, 2, 3]],
    "diagonal": [[3, 2, 1], [5, 6, 2], [4, 5, 3]], "rectangle": [[1, 2, 1]] * 2,
    "square": [[1, 2, 1], [2, 3, 2], [1, 2, 1]],
}  # fmt: skip


def test_a_picture_has_the_mirrors_of_its_pixels() -> None:
    """The first row is the upper one: x and y are exchanged about the diagonal that rises to the right."""
    for name, rows in MIRRORED.items():
        assert LuminanceImage(np.array(rows) / 10.0, 1.0).symmetry == name


def test_a_picture_is_as_wide_as_stated_and_all_of_it_has_the_flux(tmp_path: Path) -> None:
    Image.fromarray(np.array([[50, 0, 0, 100], [0, 0, 0, 50]], dtype=np.uint8)).save(tmp_path / "led.png")
    area = planar_emitter(LuminanceSource(file=tmp_path / "led.png", width_mm=6.0)).area
    assert area.pitch_mm == 1.5 and area.values.tolist() == [[0.25, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 0.25]]
    Image.new("L", (4, 4)).save(tmp_path / "dark.png")
    with pytest.raises(InputError, match="must not be all dark"):
        planar_emitter(LuminanceSource(file=tmp_path / "dark.png", width_mm=6.0))
