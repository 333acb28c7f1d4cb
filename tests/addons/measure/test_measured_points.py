"""Files of measured points: rows of several faces, measured beside nominal, PLY, and points that are not of it."""

import struct
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_lenses import dent, directions, lens, probed

import lensforge as lf
from lensforge.addons.measure.measured_points import measured_points
from lensforge.addons.measure.registration import distances, off_surface, over_surface, register, registered
from lensforge.cad.patch import fit_patch
from lensforge.errors import FileWarning, InputError
from lensforge.surfaces.point_files import FaceOfPart, read_cloud

LENS = lens()
PATCH = fit_patch(LENS.outer)
POINTS = np.random.default_rng(0).normal(size=(150, 3)).round(6)
OF = FaceOfPart("outer", ["inner", "outer"])


def rows(points: np.ndarray, line: Callable[[int, np.ndarray], str], head: str = "") -> str:
    return head + "".join(f"{line(number, point)}\n" for number, point in enumerate(points, start=1))


def comma(*values: object) -> str:
    return ",".join(f"{value:.6f}" if isinstance(value, float) else str(value) for value in values)


@pytest.mark.parametrize(("content", "wanted"), [
    (rows(POINTS, lambda n, p: comma("inner" if n % 3 else "Outer", *p), "surface,x_mm,y_mm,z_mm\n"), POINTS[2::3]),
    (rows(POINTS, lambda n, p: comma(n, *p, "outer" if n > 30 else "inner"), "no,x,y,z,feature\n"), POINTS[30:]),
    (rows(POINTS, lambda n, p: comma(f"P{n}", *p), "feature,x,y,z\n"), POINTS),
    (rows(POINTS, lambda n, p: comma(n, *p), "number,x,y,z\n"), POINTS),
    (rows(POINTS, lambda n, p: comma(*(p + 1.0), *p), "x,y,z,x_act,y_act,z_act\n"), POINTS),
    (rows(POINTS, lambda n, p: comma(*p, *(p + 1.0)), "Actual x,actual y,actual z,x nom,y nom,z nom\n"), POINTS),
    (rows(POINTS, lambda n, p: comma(*p[::-1], *(p + 1.0)), "z_meas [in],y_meas [in],x_meas [in],x,y,z\n"),
     25.4 * POINTS),
    (rows(POINTS, lambda n, p: comma(*p), "x,y,z\nin,in,in\n"), 25.4 * POINTS),
])  # fmt: skip
def test_columns_are_taken_by_what_they_say(content: str, wanted: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "cloud.csv"
    repeated = content.splitlines()
    begin = next(k for k, line in enumerate(repeated) if any(mark.isdigit() for mark in line) and "." in line)
    path.write_text("\n".join([*repeated, *(repeated[begin:] if len(wanted) < 100 else [])]), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileWarning)
        cloud = read_cloud(path, of=OF)
    np.testing.assert_allclose(cloud[: len(wanted)], wanted, atol=1e-12)
    assert len(cloud) in (len(wanted), 2 * len(wanted))


@pytest.mark.parametrize(("head", "told"), [
    ("surface,x,y,z,probe", ["'probe'"]),
    ("surface,x,y,z,feature", ["'feature'"]),
    ("name,x,y,z,probe", ["'name', 'probe'"]),
])  # fmt: skip
def test_a_column_by_which_rows_are_chosen_is_used(head: str, told: list[str], tmp_path: Path) -> None:
    content = rows(POINTS, lambda n, p: comma("outer", *p, 1), f"{head}\n")
    (tmp_path / "cloud.csv").write_text(content, encoding="utf-8")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_cloud(tmp_path / "cloud.csv", of=OF)
    assert [str(warning.message).partition("not used: ")[2] for warning in caught] == told


@pytest.mark.parametrize(("content", "message"), [
    (rows(POINTS, lambda n, p: comma(n, *p)), "line 1, column 1: this column counts the rows"),
    (rows(POINTS, lambda n, p: comma(n - 1, *p, 0.5)), "line 1, column 1: this column counts the rows"),
    (rows(POINTS, lambda n, p: comma("inner", *p), "surface,x,y,z\n"), "no row of surface 'outer'; found 'inner'"),
])  # fmt: skip
def test_what_is_not_of_the_face_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "cloud.csv").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_cloud(tmp_path / "cloud.csv", of=OF)


def header(layout: str, *lines: str) -> bytes:
    return "\n".join(["ply", f"format {layout} 1.0", "comment of a probe", *lines, "end_header", ""]).encode()


ORDER = ("property double y", "property float quality", "property double x", "property double z")


@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_is_read_by_its_header(layout: str, tmp_path: Path) -> None:
    mark = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[layout]
    head = header(layout, f"element vertex {len(POINTS)}", *ORDER, "element face 1", "property list uchar int vertices")
    values = [(y, 0.5, x, z) for x, y, z in POINTS.tolist()]
    body = b"".join(struct.pack(f"{mark}dfdd", *row) for row in values) if mark else (
        "".join(" ".join(map(str, row)) + "\n" for row in values) + "3 0 1 2\n").encode()  # fmt: skip
    (tmp_path / "cloud.ply").write_bytes(head + body + b"\x03\x00\x00")
    np.testing.assert_array_equal(read_cloud(tmp_path / "cloud.ply"), POINTS)


@pytest.mark.parametrize(("content", "message"), [
    (b"ply\nformat ascii 1.0\n", "its PLY header must state"),
    (header("ascii", "element vertex 150", "property float x", "property float y"), "its PLY header must state"),
    (header("ascii", "element face 1", "property list uchar int v", "element vertex 9", *ORDER), "header must state"),
    (header("ascii_2", "element vertex 150", *ORDER), "its PLY header must state"),
    (header("ascii", "element vertex 150", *ORDER, "property float x"), "its PLY header must state"),
    (header("ascii", "element vertex 150", *ORDER) + b"1 2 3 4\n" * 149, "149 lines of vertices, its header states"),
    (header("ascii", "element vertex 150", *ORDER) + b"1 2 x 4\n" * 150, "its vertices are no rows of numbers"),
    (header("ascii", "element vertex 150", *ORDER) + b"1 2 nan 4\n" * 150, "point 1 lies at"),
    (header("binary_little_endian", "element vertex 150", *ORDER) + b"\0" * 100, "ends before the last of its 150"),
    (header("binary_little_endian", "element vertex 150", *ORDER) + b"\xff" * 28 * 150, "point 1 lies at"),
    (header("binary_little_endian", "element vertex 999999999", *ORDER), "ends before the last of its 999999999"),
    (header("ascii", "element vertex 0", *ORDER), "0 lines of vertices"),
])  # fmt: skip
def test_a_damaged_ply_is_refused_in_one_line(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "cloud.ply").write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(tmp_path / "cloud.ply")
    assert str(caught.value).isprintable()


def told(cloud: np.ndarray, registration: str = "rigid") -> tuple[np.ndarray, float, list[str]]:
    """Gaps (mm) of the points that count, their share, and what was said."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        placement = registered(PATCH, cloud, registration)
    return distances(PATCH, placement.points)[0], placement.share, [str(warning.message) for warning in caught]


@pytest.mark.parametrize("registration", ["rigid", "shift", "none"])
def test_points_off_the_face_are_left_out_and_told(registration: str) -> None:
    """One that the probe did not reach, three on a clamp, and one that dust has lifted by a tenth of a millimetre."""
    cloud = probed(LENS.outer, 600, noise_mm=1e-3)
    good = np.abs(told(cloud, registration)[0]).max()
    cloud[7], cloud[20:23] = 0.0, 1.1 * cloud[20:23]
    cloud[200] *= 1.0 + 0.1 / np.linalg.norm(cloud[200])
    gaps, share, messages = told(cloud, registration)
    assert share == 595 / 600 and np.abs(gaps).max() < 1.2 * good < 6e-3
    assert messages[0] == "points: 1 at 0, 0, 0, as a machine writes what it did not reach, are left out"
    assert messages[1].startswith("points: 4 of 599 lie up to 1.") and len(messages) == 2


def test_form_error_stays_whatever_its_height() -> None:
    """A dent is alike at its neighbours: without any noise, too, where every rule by noise would cut it off."""
    u = directions(900, 3)
    for height_mm, noise_mm in ((0.05, 0.0), (0.2, 0.0), (0.05, 5e-4), (-0.1, 1e-3)):
        radius = LENS.outer.radius(u) + dent(u, height_mm) + noise_mm * np.random.default_rng(1).normal(size=len(u))
        gaps, share, messages = told(u * radius[:, None], "none")
        assert share == 1.0 and messages == [] and np.abs(gaps).max() > 0.8 * abs(height_mm)


def test_only_few_points_of_noise_count_as_off() -> None:
    for seed in range(5):
        u = directions(400, seed)
        noise = 0.01 * np.random.default_rng(seed).standard_normal(400)
        assert not off_surface(13.0 * u, noise).any()


def test_the_designs_own_points_are_asked_for() -> None:
    _, share, messages = told(np.round(probed(LENS.outer, 500), 5), "none")
    assert share == 1.0
    (message,) = messages
    assert message.endswith(
        "nm (rms) of the design, as no part does: are these the design's points, not measured ones?"
    )
    assert told(probed(LENS.outer, 500, noise_mm=1e-4), "none")[2] == []


def test_a_start_without_points_is_a_failed_start_and_the_other_one_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = probed(LENS.outer, 300)
    away = np.concatenate([np.zeros(3), [0.0, 0.0, -500.0]])
    monkeypatch.setattr("lensforge.addons.measure.registration._starts", lambda *_: [away, np.zeros(6)])
    assert np.abs(register(PATCH, cloud).translation_mm).max() < 1e-6
    monkeypatch.setattr("lensforge.addons.measure.registration._starts", lambda *_: [away, away])
    with pytest.raises(InputError, match=r"points: .* of them lie over the surface once registered, must be at least"):
        register(PATCH, cloud)


def test_points_of_both_faces_without_a_word_are_told_as_left_out() -> None:
    """A third of them lies at half of the face's distance, where a start could lose all points of the face."""
    cloud = np.concatenate([probed(LENS.outer, 400), probed(LENS.inner, 200)])
    _, share, messages = told(cloud, "none")
    assert share == pytest.approx(400 / 600, abs=0.01) and "points: 200 of 600 lie up to" in messages[0]


def test_the_table_for_the_shop_reads_back_to_nothing_by_its_surface(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    both = [("inner", LENS.inner), ("outer", LENS.outer)]
    lines = [comma(name, *point) for name, face in both for point in probed(face, 450)]
    path.write_text("\n".join(["surface,x_mm,y_mm,z_mm", *lines]), encoding="utf-8")
    for name, face in both:
        cloud = measured_points(path, LENS, name)
        assert len(cloud) == 450 and np.abs(distances(fit_patch(face), cloud[over_surface(cloud)])[0]).max() < 2e-6
    only = tmp_path / "only.csv"
    only.write_text("\n".join(comma(*point) for point in probed(LENS.outer, 450)), encoding="utf-8")
    with pytest.raises(InputError, match=r"were they measured on the other surface\? Give --surface outer"):
        measured_points(only, LENS, "inner")
    with pytest.raises(InputError, match=r"were they measured on the other surface\? Give --surface outer"):
        lf.correct(LENS, points=only, surface="inner")
    assert len(measured_points(only, LENS, "outer")) == 450
