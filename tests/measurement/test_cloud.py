import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.measurement.cloud import read_cloud

POINTS = np.random.default_rng(0).normal(size=(150, 3))


@pytest.mark.parametrize("mark", [",", ";", "\t", "  ", ", "])
@pytest.mark.parametrize("head", ["", "x,y,z\n", "# probe 7\n\nX [mm];Y [mm];Z [mm]\n"])
def test_common_layouts_hold_the_same_points(tmp_path, mark, head):
    lines = [mark.join(f"{value:.12e}" for value in (*point, 1.0)) for point in POINTS]
    (tmp_path / "cloud.csv").write_text(head + "\r\n".join(lines), encoding="utf-8")
    np.testing.assert_allclose(read_cloud(tmp_path / "cloud.csv"), POINTS, rtol=1e-11)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"\xff\xfe\x00", "not readable as text"),
        (b"1 2 3\n", "1 points, must be at least 100"),
        (b"1 2 3\n" * 120 + b"1 2\n", "line 121: 2 numbers"),
        (b"1 2 3\n" * 120 + b"1 2 x\n", "line 121: '1 2 x'"),
        (b"1 2 3\n" * 120 + b"1 2 nan\n", "not finite"),
    ],
)
def test_what_is_no_cloud_is_input_error(tmp_path, content, message):
    if content is not None:
        (tmp_path / "cloud.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_cloud(tmp_path / "cloud.csv")
