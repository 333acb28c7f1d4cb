"""Tables of light as a spec names them, and how finely a pattern is drawn."""

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.scene import target_pattern
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import ReceiverPose
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.target_pattern import read_table
from lensforge.scene.target_shapes import photometric
from lensforge.sources.intensity import TabulatedIntensity

ROWS = np.array([[1.0, 0.5, 0.0], [2.5e1, 3.0, 4.0]])


@pytest.mark.parametrize(
    "text", ["1,0.5,0\n2.5e1,3,4\n", "1;0.5;0\n2.5e1;3;4", "1\t.5\t0\n25\t3\t4", "1 0.5 0 # a\n25 3 4"]
)
def test_numbers_are_read_whatever_stands_between_them(tmp_path, text):
    path = tmp_path / "light.csv"
    path.write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(read_table(path), ROWS)


def test_one_array_of_an_archive_is_a_table(tmp_path):
    np.savez(tmp_path / "light.npz", ROWS)
    np.testing.assert_array_equal(read_table(tmp_path / "light.npz"), ROWS)
    np.savez(tmp_path / "two.npz", ROWS, ROWS)
    with pytest.raises(InputError, match="holds 2 arrays"):
        read_table(tmp_path / "two.npz")


@pytest.mark.parametrize("text", ["0,0\n0,0", "1,-0.001", "1,nan", "1,inf"])
def test_dark_negative_and_endless_light_is_refused(tmp_path, text):
    path = tmp_path / "light.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"must be 0 or above, and its largest from 1e-30 to 1e\+30"):
        read_table(path)


@pytest.mark.parametrize(("pixels", "times"), [(16, 32), (64, 8), (128, 8), (512, 8), (1024, 4), (4096, 1), (5000, 1)])
def test_a_pattern_is_drawn_with_eight_sub_pixels_or_512_in_all_and_no_more_than_4096(pixels, times):
    grid = PixelGrid(300.0, 200.0, pixels, pixels // 2)
    receiver = Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), grid)
    assert target_pattern._subpixels(receiver) == times


def test_a_table_of_intensities_is_bilinear_in_every_sector_and_dark_beyond_its_angles():
    c_deg, gamma_deg = np.array([0.0, 90.0, 200.0, 360.0]), np.array([10.0, 30.0, 70.0])
    values = np.array([[5.0, 4.0, 3.0], [1.0, 7.0, 2.0], [6.0, 0.0, 9.0], [5.0, 4.0, 3.0]])
    azimuth, gamma = np.radians([45.0, 145.0, 280.0, 320.0, 0.0]), np.array([20.0, 50.0, 30.0, 60.0, 10.0])
    by_hand = [
        0.5 * (4.5 + 4.0),  # half-way between C 0 and C 90, each half-way to its second angle
        0.5 * (4.5 + 4.5),
        0.5 * (0.0 + 4.0),  # half-way between C 200 and C 360
        0.25 * (0.25 * 0.0 + 0.75 * 9.0) + 0.75 * (0.25 * 4.0 + 0.75 * 3.0),
        5.0,
    ]
    table = TabulatedIntensity(c_deg, gamma_deg, values)
    np.testing.assert_allclose(photometric(table, gamma * np.cos(azimuth), gamma * np.sin(azimuth)), by_hand)
    outside = np.array([9.9, 70.1])
    np.testing.assert_array_equal(photometric(table, outside, np.zeros(2)), 0.0)
    round_table = TabulatedIntensity(np.zeros(1), gamma_deg, values[:1])
    np.testing.assert_allclose(photometric(round_table, np.zeros(2), np.array([-20.0, 50.0])), [4.5, 3.5])
