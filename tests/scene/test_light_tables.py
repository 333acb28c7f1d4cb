"""Tables of light as a spec names them, and how finely a pattern is drawn."""

import numpy as np
import pytest

from lensforge.errors import InputError
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


def test_what_is_no_table_is_refused_with_its_place_and_not_its_words(tmp_path) -> None:
    (tmp_path / "light.csv").write_text("1," + 1000 * "x")
    with pytest.raises(InputError, match=r"no table of numbers \(no number at row 0, column 2\.\);") as refusal:
        read_table(tmp_path / "light.csv")
    assert "xx" not in str(refusal.value)
