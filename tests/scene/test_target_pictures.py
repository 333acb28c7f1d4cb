"""Irradiance of targets from pictures, text, arrays and tables, against the numbers that were put into them."""

import unicodedata
from pathlib import Path

import numpy as np
import pytest
from picture_files import png, tiff

from lensforge.errors import InputError
from lensforge.optics.pose import Pose
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver_shapes import FarField, Plane
from lensforge.scene.target_light import drawn_text, read_table
from lensforge.scene.target_pattern import target_light
from lensforge.spec import ImageTarget, TextTarget
from lensforge.spec.target_sections import TargetSection

PLANE = Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), PixelGrid.square(300.0, 32))
PLACE = {"distance_mm": 100.0, "receiver_mm": 300.0}
RNG = np.random.default_rng(2)
GREY16 = RNG.integers(0, 2**16, (32, 32), dtype=np.uint16)  # a pixel of the picture for each of the receiver's


def test_letters_are_read_from_behind_the_screen_towards_the_lens():
    """Of an L the right half is dark above, where right and up are +x and +y, which an observer at +z sees so."""
    light = target_light((TextTarget(text="L", width_mm=100.0, **PLACE),), PLANE)
    rows, columns = np.nonzero(light)
    right = rows[columns > np.median(np.unique(columns))]
    assert len(right) and right.max() < np.median(np.unique(rows)), "row 0 is at the least y"
    x, y, z = PLANE.pose.axes
    seen_from = np.array([0.0, 0.0, 1.0])
    assert np.cross(x, y) @ z == pytest.approx(1.0) and z @ seen_from == pytest.approx(1.0)


def irradiance(folder, content, **options):
    (folder / "picture").write_bytes(content)
    return target_light((ImageTarget(file=folder / "picture", width_mm=300.0, **PLACE, **options),), PLANE)


def expected(light):
    return light[::-1] / light.sum()


@pytest.mark.parametrize(
    ("content", "light"),
    [
        (png(GREY16, "grey", 16), GREY16 / 65535),  # was clipped to white above 255
        (tiff((GREY16 / 65535).astype(np.float32)), (GREY16 / 65535).astype(np.float32).astype(float)),  # was black
        (png(np.dstack([np.full_like(GREY16, 65535), GREY16]), "grey_alpha", 16), GREY16 / 65535),  # was a full square
    ],
    ids=["png16", "float", "white on transparent"],
)
def test_every_bit_of_a_picture_is_irradiance(tmp_path, content, light):
    np.testing.assert_allclose(irradiance(tmp_path, content), expected(light), rtol=1e-12)


def test_a_mirrored_picture_is_that_of_its_other_side(tmp_path):
    """Value by value: row 0 at the top, the last column on the left; turned about its centre after that."""
    upright, other = (irradiance(tmp_path, png(GREY16, "grey", 16), mirrored=mirrored) for mirrored in (False, True))
    np.testing.assert_allclose(other, upright[:, ::-1], rtol=1e-12)
    assert np.abs(other - upright).max() > 0.1 * upright.max()


def test_another_picture_of_the_same_name_is_another_target(tmp_path):
    picture, flipped = (irradiance(tmp_path, png(grey, "grey", 16)) for grey in (GREY16, GREY16[::-1]))
    np.testing.assert_array_equal(picture, flipped[::-1])


def test_a_pattern_that_is_kept_cannot_be_changed(tmp_path):
    first = irradiance(tmp_path, png(GREY16, "grey", 16))
    first[:] = 0.0
    assert irradiance(tmp_path, png(GREY16, "grey", 16)).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("text", ["a\nb", "a\rb", "a\tb", "\0", "a\u2028b", "a\u202eb", "a\u200bb"])
def test_text_of_one_line_of_visible_characters(text):
    with pytest.raises(InputError, match="must be one line of visible characters") as caught:
        TextTarget(text=text, width_mm=80.0, **PLACE)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("text", ["漢", "A🙂", "가"])
def test_characters_that_the_font_lacks_are_refused(text):
    with pytest.raises(InputError, match=r"DejaVu Sans, has no .* \(U\+"):
        target_light((TextTarget(text=text, width_mm=80.0, **PLACE),), PLANE)


def test_letters_with_marks_and_from_right_to_left(monkeypatch):
    from PIL import features

    if features.check("raqm"):
        # e and an accent are the letter é, one mark at the same place, and Hebrew's first letter is its rightmost
        assert unicodedata.normalize("NFC", "e\u0301") == "é"
        np.testing.assert_allclose(drawn_text("e\u0301").mean(), drawn_text("é").mean(), rtol=0.01)
        first = drawn_text("ש")
        both = drawn_text("שו")
        np.testing.assert_array_equal(both[-first.shape[0] :, -first.shape[1] :], first)
    plain = drawn_text("LF")
    monkeypatch.setattr(features, "check", lambda name: False)
    np.testing.assert_array_equal(drawn_text("LF"), plain)
    for text in ("e\u0301", "שלום", "سلام"):
        with pytest.raises(InputError, match="needs the FriBiDi library"):
            drawn_text(text)


def test_text_stands_upright_and_has_its_width() -> None:
    image = target_light((TextTarget(text="L", width_mm=100.0, **PLACE),), PLANE)
    _, columns = np.nonzero(image > 0.5 * image.max())
    axis = PLANE.grid.x()
    assert np.ptp(axis[columns]) == pytest.approx(100.0, abs=2 * PLANE.grid.pixel[0])
    bar = image[: len(image) // 2].sum() > image[len(image) // 2 :].sum()
    assert bar, "the foot of an L is at small y, which is row 0"


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (TextTarget(text=" ", width_mm=10.0, **PLACE), "nothing to draw"),
        (TextTarget(text="W", width_mm=400.0, **PLACE), "must fit into receiver_mm"),
        (ImageTarget(file="nowhere.png", width_mm=10.0, **PLACE), "no such file"),
    ],
)
def test_impossible_targets_are_named(target, message: str) -> None:
    with pytest.raises(InputError, match=message):
        target_light((target,), PLANE)


ROWS = np.array([[1.0, 0.5, 0.0], [2.5e1, 3.0, 4.0]])


@pytest.mark.parametrize(
    "text",
    [
        "1,0.5,0\n2.5e1,3,4\n",
        "1;0.5;0\n2.5e1;3;4",
        "1\t.5\t0\n25\t3\t4",
        "1 0.5 0 # a\n25 3 4",
        "1;0,5;0\n25,0;3;4",
        "1\t0,5\t0\r25\t3\t4\r",
        "1 0,5 0\n2,5e1 3 4",
        '"1","0,5","0"\n"25","3","4"',
    ],
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


def test_what_is_no_table_is_refused_with_its_place_and_few_of_its_words(tmp_path) -> None:
    (tmp_path / "light.csv").write_text("1," + 1000 * "x")
    with pytest.raises(InputError, match=r"light\.csv, line 1, column 2: 'x{24}' is no number; commas") as refusal:
        read_table(tmp_path / "light.csv")
    assert 25 * "x" not in str(refusal.value)
    (tmp_path / "light.csv").write_text("left,right\n1,2\n")
    with pytest.raises(InputError, match=r"light\.csv, line 1: 'left,right': must be rows of numbers alone"):
        read_table(tmp_path / "light.csv")
    (tmp_path / "light.csv").write_text("0,1;0,5\n1,0;0.5\n")
    with pytest.raises(InputError, match=r"light\.csv, line 1, column 1: '0,1' beside numbers with decimal points"):
        read_table(tmp_path / "light.csv")


def far_field(half_deg: float) -> FarField:
    radius = 2.0 * np.sin(np.radians(0.5 * half_deg))
    grid = PixelGrid.square(2.0 * radius, 64)
    pose = Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    return FarField(pose, grid, Window(radius=radius))


# Targets whose region of uniform light just lies in their light, and one of these or more that does not.
UNIFORM = {
    "disc": ({"kind": "disc", "diameter_mm": 80.0}, (48.0, 64.0), [(52.0, 68.0)]),
    "turned": (
        {"kind": "rectangle", "width_mm": 60.0, "height_mm": 30.0, "rotation_deg": 30.0},
        (60.0, 30.0),
        [(64.0, 9.0)],
    ),
    "aside": (
        {"kind": "rectangle", "width_mm": 60.0, "height_mm": 30.0, "centre_mm": (90.0, 0.0)},
        (60.0, 30.0),
        [(64.0, 9.0)],
    ),
    "ring": (
        {"kind": "ring", "outer_diameter_mm": 100.0, "inner_diameter_mm": 60.0},
        None,
        [(20.0, 20.0), (90.0, 9.0)],
    ),
    "polygon": ({"kind": "polygon", "corners_mm": ((-50, -50), (50, -50), (0, 50))}, (25.0, 50.0), [(30.0, 50.0)]),
    "cross": ({"kind": "cross", "length_mm": 90.0, "stroke_mm": 20.0}, (90.0, 20.0), [(40.0, 24.0)]),
    "spots": ({"kind": "spots", "columns": 3, "diameter_mm": 30.0, "pitch_mm": 40.0}, (20.0, 20.0), [(90.0, 9.0)]),
    "text": ({"kind": "text", "text": "I", "width_mm": 9.0}, (9.0, 60.0), [(11.0, 60.0)]),
}


@pytest.mark.parametrize("name", UNIFORM)
def test_a_region_of_uniform_light_lies_in_the_light(name: str) -> None:
    """Corners of the rectangle in the disc lie on its circle, of that in the triangle on its sides; no ring has one."""
    fields, fits, others = UNIFORM[name]
    kind = TargetSection.kinds[fields["kind"]]
    if fits is not None:
        assert target_light((kind(**fields, uniform_mm=fits),), PLANE).sum() == pytest.approx(1.0)
    for sides in others:
        with pytest.raises(InputError, match=r"^target: uniform_mm = .* of it is dark; .* leave it out$"):
            target_light((kind(**fields, uniform_mm=sides),), PLANE)


def test_light_of_several_targets_may_hold_one_region() -> None:
    kind = TargetSection.kinds["rectangle"]
    left, right = (kind(width_mm=40.0, height_mm=40.0, centre_mm=(x, 0.0)) for x in (-20.0, 20.0))
    wide = left.changed(uniform_mm=(80.0, 30.0), centre_mm=(0.0, 0.0), width_mm=8.0)
    assert target_light((left, right, wide), PLANE).sum() == pytest.approx(1.0)
    with pytest.raises(InputError, match="of it is dark"):
        target_light((left, wide), PLANE)


def test_a_photometric_target_does_not_go_on_beyond_its_receiver(tmp_path: Path) -> None:
    """Of half of its peak and more up to 60 degrees: on a receiver that reaches to 40 degrees it is cut off."""
    gamma = np.arange(0.0, 91.0, 10.0)
    candela = np.where(gamma <= 60.0, 100.0, 49.0)
    lines = ["IESNA:LM-63-2002", "TILT=NONE", f"1 1000 1 {len(gamma)} 1 1 2 0.1 0.1 0", "1 1 10"]
    rows = [" ".join(f"{value:g}" for value in values) for values in (gamma, (0.0,), candela)]
    (tmp_path / "wide.ies").write_text("\n".join([*lines, *rows]) + "\n", encoding="ascii")
    wide = TargetSection.kinds["photometric"](file=tmp_path / "wide.ies")
    with pytest.raises(InputError, match=r"wide\.ies goes on beyond its receiver of half_angle_deg = 40, up to 6\d"):
        target_light((wide,), far_field(40.0))
    assert target_light((wide,), far_field(71.0)).sum() == pytest.approx(1.0)
