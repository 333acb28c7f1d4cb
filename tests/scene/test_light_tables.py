"""Tables of light as a spec names them, and how finely a pattern is drawn."""

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.results.files import MIB
from lensforge.scene import target_pattern
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import ReceiverPose
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.target_pattern import read_table

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


@pytest.mark.parametrize(("text", "shape"), [("0.25", (1, 1)), ("0,0.5,0.25", (1, 3)), ("0\n0.5", (2, 1))])
def test_a_table_may_be_a_row_a_column_or_one_number(tmp_path, text, shape) -> None:
    (tmp_path / "light.csv").write_text(text)
    found = read_table(tmp_path / "light.csv")
    assert found.shape == shape and 0.2 < found.max() < 0.6


@pytest.mark.parametrize("values", [np.ones(3), np.ones((1, 2, 3)), np.zeros((0, 3))])
def test_arrays_of_other_dimensions_and_none_are_refused(tmp_path, values) -> None:
    np.savez(tmp_path / "light.npz", values)
    with pytest.raises(InputError, match="must be a table of rows and columns"):
        read_table(tmp_path / "light.npz")


def test_what_is_no_table_is_refused_with_its_place_and_not_its_words(tmp_path) -> None:
    (tmp_path / "light.csv").write_text("1," + 1000 * "x")
    with pytest.raises(InputError, match=r"no table of numbers \(no number at row 0, column 2\.\);") as refusal:
        read_table(tmp_path / "light.csv")
    assert "xx" not in str(refusal.value)


def test_tables_of_64_mib_are_read_and_archives_of_four_times_that(monkeypatch, tmp_path) -> None:
    asked = []
    monkeypatch.setattr(
        target_pattern, "read_file", lambda path, missing, most_bytes: asked.append(most_bytes) or b"PK\x03\x04"
    )
    monkeypatch.setattr(
        target_pattern, "arrays_in", lambda content, names, most: asked.append(most) or {"a": np.ones((2, 2))}
    )
    assert (read_table(tmp_path / "light.npz") == 1.0).all()
    assert asked == [64 * MIB, 256 * MIB]
