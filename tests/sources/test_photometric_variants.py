"""Photometric files as programs write them: encodings, end marks, commas, types A and B, noise below 0."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lensforge.errors import InputError
from lensforge.sources.photometric import read_photometric

BEAM = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
WIDTH = np.deg2rad(25.0)


def _intensity(ways):
    """A beam off both planes: exp(-(angle / 25 deg)^2) kcd about BEAM, none behind; z is gamma 0, x C 0, y C 90."""
    return 1000.0 * np.exp(-((np.arccos(np.clip(ways @ BEAM, -1.0, 1.0)) / WIDTH) ** 2)) * np.maximum(ways[..., 2], 0.0)


def _ways(kind, rows_deg, columns_deg):
    """Directions of the rows (C or H) and columns (gamma or V) of a file, by the figures of LM-63: rotations, no sum.

    Type B: up by V about the horizontal axis C 90, after a turn by H away from C 90. Type A: to the side by H about
    the vertical axis C 0, after a turn up by V towards C 0.
    """
    row, column = (coordinates.ravel() for coordinates in np.meshgrid(rows_deg, columns_deg, indexing="ij"))
    axes, angles = {"C": ("ZY", (row, column)), "B": ("YX", (column, row)), "A": ("XY", (row, column))}[kind]
    turns = Rotation.from_euler(axes, np.stack(angles, axis=1), degrees=True)
    return turns.apply([0.0, 0.0, 1.0]).reshape(len(rows_deg), len(columns_deg), 3)


def _ies(rows, columns, candela, kind=1, separator=" ", end="\n"):
    lines = ["IESNA:LM-63-2002", "[TEST] none", "TILT=NONE", f"1 -1 1 {len(columns)} {len(rows)} {kind} 2 0 0 0"]
    lines += ["1 1 10"] + [separator.join(f"{n:.10g}" for n in line) for line in (columns, rows, *candela)]
    return end.join(lines) + end


def _read(tmp_path, content):
    path = tmp_path / "file"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return read_photometric(path)


SQUARE = np.arange(-90.0, 90.1, 2.0)


@pytest.mark.parametrize("kind", ["A", "B"])
def test_types_a_and_b_are_the_far_field_of_type_c(kind, tmp_path):
    """The same closed form in three files: the same flux, the same intensities, and the beam where it points."""
    whole = np.arange(0.0, 360.1, 2.0), np.arange(0.0, 90.1, 1.0)
    straight = _read(tmp_path, _ies(*whole, _intensity(_ways("C", *whole))))
    cd = _intensity(_ways(kind, SQUARE, SQUARE))
    other = _read(tmp_path, _ies(SQUARE, SQUARE, cd, kind={"A": 3, "B": 2}[kind]))
    assert (straight.photometric_type, straight.warnings) == ("C", ())
    assert other.photometric_type == kind
    assert len(other.warnings) == 1 and f"type {kind} converted" in other.warnings[0]
    assert other.intensity.flux() == pytest.approx(straight.intensity.flux(), rel=1e-3)
    table = other.intensity
    truth = _intensity(_ways("C", table.c_deg[::16], table.gamma_deg))
    np.testing.assert_allclose(table.values[::16], truth, atol=5.0)  # 0.5 % of the peak: steps of 2 degrees in a beam
    plane, node = np.unravel_index(table.values.argmax(), table.values.shape)  # of a width of 25
    assert table.c_deg[plane] == pytest.approx(np.rad2deg(np.arctan2(0.2, 0.3)), abs=3.0)
    assert table.gamma_deg[node] == pytest.approx(np.rad2deg(np.arccos(BEAM[2])), abs=2.5)


def test_angles_that_a_type_b_file_cannot_have(tmp_path):
    with pytest.raises(InputError, match="type B: its V angles must rise within -90 to 90"):
        _read(tmp_path, _ies([-10.0, 10.0], [0.0, 120.0], np.ones((2, 2)), kind=2))
    with pytest.raises(InputError, match="photometric type 4: 1 "):
        _read(tmp_path, _ies([-10.0, 10.0], [0.0, 12.0], np.ones((2, 2)), kind=4))


def test_tilt_factors_are_passed_over_a_multiplier_counts_and_damaged_numbers_are_refused(tmp_path):
    plain = _ies([0.0, 90.0], [0.0, 45.0, 90.0], [[20.0, 2.0, 0.0], [40.0, 4.0, 0.0]])
    values = _read(tmp_path, plain).intensity.values
    tilted = _read(tmp_path, plain.replace("TILT=NONE", "TILT=INCLUDE\n1 2 0 90 1 0.5"))
    np.testing.assert_array_equal(tilted.intensity.values, values)
    made = _read(tmp_path, plain.replace("1 -1 1 3 2", "1 -1 3 3 2").replace("\n1 1 10\n", "\n0.8 1 10\n"))
    np.testing.assert_allclose(made.intensity.values, 3.0 * 0.8 * values, rtol=1e-12, err_msg="and the ballast")
    for before, after, message in (
        ("40 4 0\n", "40 4", "truncated"),
        (" 3 2 1 2", " 1e9 2 1 2", "count"),
        ("0 45 90", "0 90 45", "angles must rise"),
        ("20 2 0", "20 x 0", "numbers"),
        ("20 2 0", "20 nan 0", "finite"),
    ):
        assert before in plain
        with pytest.raises(InputError, match=message):
            _read(tmp_path, plain.replace(before, after))


C, GAMMA = np.arange(0.0, 181.0, 30.0), np.arange(0.0, 91.0, 10.0)
PLAIN = _ies(C, GAMMA, 100.0 + np.arange(70.0).reshape(7, 10))


def _ldt(numbers="{}", lamp="2000", extra="", dc="45"):
    """Eight half-planes of three angles, 10.5 cd/klm and more; ``numbers`` writes one of them."""
    head = ["maker", "2", "0", "8", dc, "3", "45", "", "a name", "", "", ""] + ["0"] * 9
    head += ["100", "99.5" if "," not in dc else "99,5", "1", "0", "1", "1", "LED", lamp, "", "", "10"] + ["0"] * 10
    body = [f"{45 * i}" for i in range(8)] + ["0", "45", "90"]
    return "\r\n".join([*head, *body, *(numbers.format(10.5 + i) for i in range(24))]) + extra


@pytest.mark.parametrize("text", [PLAIN, _ldt()], ids=["ies", "ldt"])
@pytest.mark.parametrize(
    "tail", ["END\r\n", "\r\nend", "\x1a", "\r\n\x1a\x1a\x1a", "\0" * 500, "\r\n\x1a" + "\0" * 127, "\r\n \r\n\r\n"]
)
def test_end_marks_and_padding_after_the_last_number(text, tail, tmp_path):
    plain, marked = _read(tmp_path, text), _read(tmp_path, text + ("\r\n" if tail.startswith("END") else "") + tail)
    np.testing.assert_array_equal(marked.intensity.values, plain.intensity.values)
    assert marked.warnings == plain.warnings  # at gamma 0 its planes differ


@pytest.mark.parametrize("text", [PLAIN, _ldt()], ids=["ies", "ldt"])
@pytest.mark.parametrize("end", ["\n", "\r", "\r\n", "\r\r\n"])
@pytest.mark.parametrize(
    ("mark", "encoding"),
    [(b"", "utf-8"), (b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"),
     (b"", "utf-16-le"), (b"", "utf-16-be"), (b"", "cp1252")],
)  # fmt: skip
def test_encodings_and_line_ends(text, end, mark, encoding, tmp_path):
    plain = _read(tmp_path, text)
    named = text.replace("a name", "Leuchte für außen").replace("[TEST] none", "[LUMINAIRE] Leuchte für außen")
    photometric = _read(tmp_path, mark + end.join(named.splitlines()).encode(encoding))
    np.testing.assert_array_equal(photometric.intensity.values, plain.intensity.values)
    assert photometric.title == "Leuchte für außen"


def test_intensities_slightly_below_0_are_0(tmp_path):
    cd = 100.0 + np.zeros((7, 10))
    cd[2:4, 9] = -0.02
    photometric = _read(tmp_path, _ies(C, GAMMA, cd))
    assert photometric.warnings == (
        "2 of 70 intensities are below 0, the least -0.02 cd (0.0002 of the largest): taken as 0",
    )
    assert photometric.intensity.values.min() == 0.0
    cd[2, 9] = -1.5
    with pytest.raises(InputError, match=r"intensities from -1\.5 to 100 cd must lie within 0"):
        _read(tmp_path, _ies(C, GAMMA, cd))
    kind_b = _read(tmp_path, _ies([-10.0, 0.0, 10.0], [-5.0, 5.0], [[9.0, 9.0], [9.0, -0.01], [9.0, 9.0]], kind=2))
    assert len(kind_b.warnings) == 2


def test_decimal_commas_in_lm_63_are_refused_with_their_remedy(tmp_path):
    """A comma separates there: 521,7 is two numbers, and what follows moves by one place."""
    good = _ies(C, GAMMA, 100.5 + np.arange(70.0).reshape(7, 10))
    for text in (
        good.replace(".5", ",5"),
        good.replace("1 1 10\n", "1 1 10,0\n"),
        good.replace("1 -1 1 ", "1 -1 1,0 "),
    ):
        with pytest.raises(InputError, match="where they are decimal commas, write points"):
            _read(tmp_path, text)
    separated = _read(tmp_path, _ies(C, GAMMA, 100.5 + np.arange(70.0).reshape(7, 10), separator=","))
    np.testing.assert_array_equal(separated.intensity.values, _read(tmp_path, good).intensity.values)


def test_decimal_commas_in_eulumdat_are_read_unless_they_may_be_thousands(tmp_path):
    expected = _read(tmp_path, _ldt()).intensity
    commas = _read(tmp_path, _ldt(dc="45,0").replace(".", ","))
    np.testing.assert_array_equal(commas.intensity.values, expected.values)
    mixed = _read(tmp_path, _ldt(dc="45,0"))  # 45,0 is no number of thousands
    np.testing.assert_array_equal(mixed.intensity.values, expected.values)
    for text in (
        _ldt(numbers="1,{:03.0f}"),  # 1,010 beside 99.5
        _ldt(numbers="1.{:03.0f}", dc="45,0").replace("10.5", "10"),
    ):
        with pytest.raises(InputError, match="in thousands, or with decimals"):
            _read(tmp_path, text)
    with pytest.raises(InputError, match=r"'1\.234,5' where EULUMDAT has a number"):
        _read(tmp_path, _ldt(lamp="1.234,5"))
    with pytest.raises(InputError, match="too many"):
        _read(tmp_path, _ldt(numbers="1 {:.1f}"))


def test_a_turn_without_planes_at_0_and_180(tmp_path):
    """C 90 to 270 by 20 degrees: its turn has no plane at C 0, which its two neighbours give."""
    c = np.arange(90.0, 271.0, 20.0)
    wave = 100.0 + 40.0 * np.cos(np.deg2rad(c)) ** 2 + 30.0 * np.sin(np.deg2rad(c))
    table = _read(tmp_path, _ies(c, GAMMA, np.outer(wave, np.cos(np.deg2rad(GAMMA))))).intensity
    assert (table.c_deg[0], table.c_deg[-1], len(table.c_deg)) == (0.0, 360.0, 20)
    lambertian = np.pi  # the flux of cos(gamma) over the hemisphere
    assert table.flux() == pytest.approx(120.0 * lambertian, rel=0.01)
    for angle in (10.0, 30.0, 150.0, 200.0, 350.0):
        mirrored = 180.0 - angle
        assert table.at(angle)[0] == pytest.approx(table.at(mirrored)[0])
    assert table.at(0.0)[0] == pytest.approx(0.5 * (table.at(10.0)[0] + table.at(-10.0)[0]))


@pytest.mark.parametrize("step", [5.0, 10.0, 15.0, 30.0])
@pytest.mark.parametrize(
    ("ends", "wave"),
    [
        ((0.0, 90.0), lambda c: 3.0 + np.cos(2.0 * c)),
        ((0.0, 180.0), lambda c: 3.0 + np.cos(c) + np.cos(2.0 * c)),
        ((90.0, 270.0), lambda c: 3.0 + np.sin(c) + np.cos(2.0 * c)),
        ((0.0, 360.0), lambda c: 3.0 + np.sin(c) + np.cos(c) + np.sin(2.0 * c)),
        ((0.0, 330.0), lambda c: 3.0 + np.sin(c) + np.cos(c) + np.sin(2.0 * c)),
    ],
)
def test_every_part_of_a_turn_is_the_whole_turn(ends, wave, step, tmp_path):
    """Symmetric functions of C, in closed form: the part that a file holds gives all of it."""
    c = np.arange(ends[0], ends[1] + 0.1, step)
    cd = np.outer(wave(np.deg2rad(c)), np.ones(10))
    table = _read(tmp_path, _ies(c, GAMMA, cd)).intensity
    held = np.arange(0.0, 361.0, step)
    intensities = np.array([table.at(angle)[3] for angle in held])
    inside = slice(None) if ends[1] != 330.0 or step == 30.0 else held <= 330.0
    np.testing.assert_allclose(intensities[inside], wave(np.deg2rad(held))[inside], rtol=1e-9)


def test_a_turn_with_a_part_left_out_is_refused(tmp_path):
    for c in (np.arange(0.0, 81.0, 20.0), np.arange(80.0, 261.0, 20.0), np.arange(20.0, 331.0, 10.0)):
        with pytest.raises(InputError, match="C angles from"):
            _read(tmp_path, _ies(c, GAMMA, np.ones((len(c), 10))))
