"""Photometric files that can be read in two ways: what is taken is said, or they are refused."""

from contextlib import nullcontext
from pathlib import Path

import pytest

import lensforge as lf
from lensforge.errors import InputError
from lensforge.light.by_intensities import of_file
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric.photometric_file import far_field_warnings
from lensforge.sources.photometric.photometric_io import convert_photometric

PLANES = {90: (300, 200, 100, 280), 120: (300, 150, 240)}  # cd at gamma 45 by the step of C; 300 at 0, 0 at 90


def _ldt(changes=(), symmetry=1, planes=(0,), sets=(("1", "LED", "1000", "", "", "10"),), cd=((300, 200, 0),)):
    head = ["maker", "3", str(symmetry), str(len(planes)), "0", "3", "45", "r", "lamp", "c", "f", "d"] + ["0"] * 9
    head += ["100", "0", "1", "0", str(len(sets)), *(line for lamp_set in sets for line in lamp_set)]
    for line, text in dict(changes).items():
        head[line - 1] = text
    return "\n".join([*head, *["0"] * 10, *map(str, planes), "0", "45", "90", *(str(n) for row in cd for n in row)])


def _ies(first="IESNA:LM-63-2002", number="1", h=(0,), cd=((300, 200, 0),), kind=1, v=(0, 45, 90), tilt="NONE"):
    rows = "\n".join(" ".join(map(str, row)) for row in (v, h, *cd))
    return f"{first}\nTILT={tilt}\n1 1000 1 {len(v)} {len(h)} {kind} 2 0 0 0\n1 {number} 10\n{rows}\n"


def _tm33(h, cd, symmetry=""):
    data = "".join(
        f'<IntData h="{c}" v="{v}">{x}</IntData>'
        for c, row in zip(h, cd, strict=True)
        for v, x in zip((0, 45, 90), row, strict=True)
    )
    return (
        "<IESTM33-22><Emitter><LuminousData><LuminousIntensity><AbsolutePhotometry>true</AbsolutePhotometry>"
        f"{symmetry and f'<Symm>{symmetry}</Symm>'}"
        f"{data}</LuminousIntensity></LuminousData></Emitter></IESTM33-22>"
    )


def _read(tmp_path: Path, text: str):
    (tmp_path / "x").write_text(text, encoding="utf-8")
    return read_photometric(tmp_path / "x")


@pytest.mark.parametrize("step", PLANES)
def test_a_turn_of_few_planes_without_the_last_is_whole_in_every_format(step, tmp_path):
    """Bilinear between the planes: the flux is that of their mean, light of revolution."""
    cd = [(300, x, 0) for x in PLANES[step]]
    h = range(0, 360, step)
    mean = sum(PLANES[step]) / len(PLANES[step])
    truth = _read(tmp_path, _ldt(cd=[(300, mean, 0)])).intensity.flux()
    for text, count in ((_ldt(symmetry=0, planes=h, cd=cd), 0), (_ies(h=h, cd=cd), 1), (_tm33(h, cd), 0)):
        file = _read(tmp_path, text)
        assert file.intensity.flux() == pytest.approx(truth) and len(file.warnings) == count
        assert file.intensity.c_deg.tolist() == [*h, 360.0]
    with pytest.raises(InputError, match="C angles from"):
        _read(tmp_path, _ies(h=(0, 30, 60), cd=cd[:3]))


@pytest.mark.parametrize(
    ("first", "year"),
    [
        ("IES:LM-63-19", 2019), ("IES: LM-63-2019", 2019), ("ANSI/IES LM-63-19", 2019), ("ies_lm-63_2019", 2019),
        ("IESNA:LM-63-02", 2002), ("IESNA LM 63 1995", 1995), ("iesna:lm-63-95", 1995), ("IESNA91", 1991),
        ("IESNA:LM-63-1991", 1991), ("IESNA:LM-63-86", 1986), ("a lamp of LM-62-2019", 1986),
    ],
)  # fmt: skip
def test_the_factor_is_that_of_the_edition_however_it_is_spelt(first, year, tmp_path):
    file = _read(tmp_path, _ies(first, "0.8"))
    assert file.edition == f"LM-63-{year}"
    assert file.intensity.values[0, 0] == pytest.approx(240.0 if year <= 1991 else 300.0)
    assert len(file.warnings) == (year != 2019)
    unnamed = _read(tmp_path, _ies("[TEST] x", "1.10000"))
    assert unnamed.intensity.values[0, 0] == 300.0 and "names no edition" in unnamed.warnings[0]


SETS = tuple(("1", "LED", lumens, "4000", "80", "10") for lumens in ("500", "1200", "700"))


@pytest.mark.parametrize(
    ("text", "phrases"),
    [
        (_ldt(sets=SETS), ("3 sets of lamps, of 500, 1200, 700 lm",)),
        (_ldt({25: "-15"}), ("tilted by -15 degrees",)),
        (_ldt({29: "0"}), ("no lumens",)),
        (_ldt({29: ""}), ("no lumens",)),
        (_ldt({29: "1,200"}), ("'1,200' is read as 1.2",)),
        (_ldt({29: "1.200"}), ("'1.200' is read as 1.2",)),
        (_ldt({29: "120.000"}), ()),  # 12 lm/W: a lamp
        (_ldt({32: ""}), ()),
        (_ldt({32: "2x18"}), ("line 32: '2x18'",)),
        (_ldt({13: "round"}), ("line 13: 'round'",)),
        (_ldt(cd=[("1.234", 187, 0)]), ("'1.234' is read as 1.234",)),
        (_ldt(cd=[("123.456", "99.125", 0)]), ()),
        (_ldt(symmetry=0, planes=(0, 45, 90), cd=[(300, 200, 0)] * 3), ("end at C 90: taken as mirrored",)),
        (_ldt(symmetry=4, planes=(0, 90, 180, 270), cd=[(300, 200, 0)] * 2), ()),
        (_ies(h=(0, 90, 180, 270, 360), cd=[(c, 200, 0) for c in (300, 30, 300, 30, 300)]), ("mean is 165 cd",)),
        (_ies(h=(0, 90, 180, 270, 360), cd=[(c, 200, 0) for c in (300, 298, 300, 298, 300)]), ()),  # within 1 %
        (_ies(h=(0, 180), v=(90, 180), cd=[(9, 3), (9, 8)]), ("at gamma 180", "first gamma is 90")),
        (_ies(tilt="lamp.tlt"), ("TILT=lamp.tlt",)),
    ],
)  # fmt: skip
def test_what_is_taken_is_said_and_nothing_else(text, phrases, tmp_path):
    (tmp_path / "x").write_text(text)
    messages = lf.rays(tmp_path / "x").warnings
    assert len(messages) == len(phrases) and all(word in line for word, line in zip(phrases, messages, strict=True)), (
        messages
    )


@pytest.mark.parametrize("line", [*range(13, 22), 25, 27, 32, 33, 38, 39, 44])
def test_a_word_for_a_number_is_told_by_its_line_in_each_set_of_lamps(line, tmp_path):
    """Sizes, tilt, and of three sets the number of lamps and the watts; the light is that of the file without it."""
    text = _ldt({line: "2x18"}, sets=SETS)
    (told,) = [warning for warning in _read(tmp_path, text).warnings if "where EULUMDAT has a number" in warning]
    assert told == f"line {line}: '2x18' where EULUMDAT has a number: left out"
    assert _read(tmp_path, text).intensity.flux() == _read(tmp_path, _ldt(sets=SETS)).intensity.flux()


@pytest.mark.parametrize("line", [27, 29, 32, 59])
def test_thousands_beside_decimals_are_refused_wherever_they_stand(line, tmp_path):
    changes = {line: "1,200", 24: "1.5"} if line < 33 else {24: "1.5"}
    cd = [(300, 200, 0)] if line < 33 else [("1,200", 250, 0)]
    with pytest.raises(InputError, match="'1,200' beside numbers with a point"):
        _read(tmp_path, _ldt(changes, cd=cd))


def test_a_type_b_file_needs_two_angles_of_each_kind(tmp_path):
    with pytest.raises(InputError, match="one H angle; a type B file needs two"):
        _read(tmp_path, _ies(h=(0,), v=(-30, 0, 30), kind=2))
    with pytest.raises(InputError, match="one V angle; a type A file needs two"):
        _read(tmp_path, _ies(h=(-30, 0, 30), v=(0,), cd=[(1,)] * 3, kind=3))


def test_a_type_b_file_whose_flux_its_conversion_would_change_is_refused(tmp_path):
    """Light within 0.01 degrees of the poles, of which the table has none; as much of 30 degrees it has."""
    for near, refused in ((60, False), (89.99, True)):
        content = _ies(v=(-90, -near, near, 90), h=(-90, 0, 90), cd=[(9, 0, 0, 9)] * 3, kind=2)
        line = r"type B: its flux as type C differs by .*%; export it as type C$"
        with pytest.raises(InputError, match=line) if refused else nullcontext():
            _read(tmp_path, content)


def test_lumens_that_are_not_stated_stay_unknown(tmp_path):
    """Candela per 1000 lm: stated lumens scale them; a format that needs lumens has 1000, and that is said."""
    (tmp_path / "a.ldt").write_text(_ldt({29: "0"}))
    file = read_photometric(tmp_path / "a.ldt")
    assert (file.lamp_lumens, file.stated_lumens, file.rated_lumens) == (None, None, 1000.0)
    assert of_file(file, 90.0, 500.0) is not None
    for suffix in (".ldt", ".ies", ".iesxml"):
        account = convert_photometric(tmp_path / "a.ldt", tmp_path / f"b{suffix}")
        back = read_photometric(tmp_path / f"b{suffix}")
        assert back.lamp_lumens == (None if suffix == ".ldt" else 1000.0)
        assert any("1000 lm are written" in warning for warning in account.warnings) == (suffix != ".ldt")


def test_the_sizes_of_an_opening_stand_where_eulumdat_has_them(tmp_path):
    (tmp_path / "a.ies").write_text(
        "IESNA:LM-63-2002\n[TEST] r\n[ISSUEDATE] 2026-01-01\n[LAMP] board\nTILT=NONE\n4 250 1 3 1 1 2 0.6 1.2 0\n"
        "1 1 40\n0 45 90\n0\n300 200 0\n"
    )
    convert_photometric(tmp_path / "a.ies", tmp_path / "a.ldt")
    lines = (tmp_path / "a.ldt").read_text().split("\n")
    assert lines[11:17] == ["2026-01-01", "0", "0", "0", "1200", "600"]
    assert lines[26:29] == ["4", "board", "1000"]


def _said(tmp_path, text):
    return " ".join(far_field_warnings(_read(tmp_path, text)))


@pytest.mark.parametrize(
    ("changes", "planes", "phrase"),
    [
        ({7: "45"}, (0,), ""), ({7: "0"}, (0,), ""), ({7: "45.4"}, (0,), ""), ({7: ""}, (0,), ""),
        ({7: "46"}, (0,), "line 7 states steps of gamma of 46 degrees, its angles have 45: these are taken"),
        ({5: "90"}, (0, 90, 180, 270), ""), ({5: "0"}, (0, 90, 180, 270), ""),
        ({5: "15"}, (0, 90, 180, 270), "line 5 states steps of C of 15 degrees, its angles have 90"),
        ({5: "90"}, (0, 90, 200, 270), "line 5 states steps of C of 90 degrees, its angles have 70 to 110"),
        ({5: "15"}, (0,), ""), ({22: "98"}, (0,), ""), ({22: "96"}, (0,), "line 22: 96 % of its light go down, by"),
        ({22: "0"}, (0,), "line 22: 0 % of its light go down, by its intensities it is 100 %"), ({22: ""}, (0,), ""),
    ],
)  # fmt: skip
def test_what_eulumdat_says_of_its_angles_is_compared_with_them(changes, planes, phrase, tmp_path):
    text = _ldt(changes, symmetry=1 if len(planes) == 1 else 0, planes=planes, cd=[(300, 200, 0)] * len(planes))
    message = _said(tmp_path, text)
    assert (phrase in message) if phrase else ("states steps" not in message and "go down" not in message)


def test_blank_lines_of_eulumdat_are_left_out_or_named(tmp_path):
    text = _ldt({3: "1"})
    doubled = _read(tmp_path, "\n\n".join(text.split("\n")))
    assert doubled.intensity.flux() == _read(tmp_path, text).intensity.flux()
    assert "a blank line follows each of its lines: these are left out" in doubled.warnings
    lines = text.split("\n")
    with pytest.raises(InputError, match="line 4: blank where EULUMDAT has a count"):
        _read(tmp_path, "\n".join([*lines[:3], "", *lines[3:]]))


@pytest.mark.parametrize("first", ["IESNA:LM-63-2002", "IES:LM-63-2019", "IESNA91", "iesna: LM-63-1995"])
def test_an_ies_file_without_tilt_is_named(first, tmp_path):
    with pytest.raises(InputError, match="LM-63 file without its line TILT=: write TILT=NONE"):
        _read(tmp_path, _ies(first).replace("TILT=NONE\n", ""))


@pytest.mark.parametrize(
    ("symmetry", "h", "phrase"),
    [
        ("Symm_None", (0, 45, 90), "Symm = 'Symm_None', but its angles h are 0 to 90: taken as mirrored at h 90"),
        ("Symm_Bi0", (0, 45, 90), "taken as mirrored at h 90"), ("Symm_Bi90", (0, 90, 180), "mirrored at h 180"),
        ("Symm_Quad", (0,), "but its angles h are 0 to 0: taken as light of revolution"),
        ("Symm_Quad", (0, 45, 90), ""), ("Symm_Bi0", (0, 90, 180), ""), ("Symm_Bi90", (90, 180, 270), ""),
        ("Symm_Full", (0,), ""), ("Symm_None", (0, 90, 180, 270, 360), ""), ("", (0, 45, 90), ""),
        ("Symm_Odd", (0, 45, 90), "'Symm_Odd' is not known"),
    ],
)  # fmt: skip
def test_the_symmetry_that_tm33_states_is_that_of_its_angles(symmetry, h, phrase, tmp_path):
    cd = [(300, 200 + 20 * abs(90 - angle % 180) / 90, 0) for angle in h]
    message = _said(tmp_path, _tm33(h, cd, symmetry))
    assert (phrase in message) if phrase else "Symm" not in message


@pytest.mark.parametrize(
    ("symmetry", "of_c", "kept"),
    [("Symm_Bi0", (200, 250, 200, 150), False), ("Symm_Bi0", (150, 200, 250, 200), True),
     ("Symm_Bi90", (150, 200, 250, 200), False), ("Symm_Bi90", (200, 250, 200, 150), True),
     ("Symm_Quad", (150, 250, 150, 250), True), ("Symm_Quad", (150, 250, 150, 240), False),
     ("Symm_Full", (150, 250, 150, 250), False), ("Symm_Full", (200, 200, 200, 200), True)],
)  # fmt: skip
def test_a_symmetry_of_tm33_holds_for_a_whole_turn_of_intensities(symmetry, of_c, kept, tmp_path):
    message = _said(tmp_path, _tm33((0, 90, 180, 270), [(300, value, 0) for value in of_c], symmetry))
    assert ("its intensities have not that symmetry" not in message) == kept


@pytest.mark.parametrize(
    ("sizes", "told"),
    [("600 1200 0", True), ("0.6 1.2 0", False), ("0.0006 0.0012 0", True), ("0.0011 0.0011 0", False),
     ("10 1 0", False), ("10.1 1 0", True), ("-0.0005 -0.0005 0", True), ("0 0 0", False), ("0.1 0.1 11", True)],
)  # fmt: skip
def test_openings_that_no_luminaire_has_are_told(sizes, told, tmp_path):
    message = _said(tmp_path, _ies().replace(" 2 0 0 0\n", f" 2 {sizes}\n"))
    assert ("its luminous opening is" in message and "in another unit?" in message) == told


def test_a_housing_in_metres_is_told(tmp_path):
    """EULUMDAT has mm."""
    assert "its luminaire is 0.6 x 1.2" in _said(tmp_path, _ldt({13: "1.2", 14: "0.6", 15: "0.1"})).replace(
        "1.2 x 0.6", "0.6 x 1.2"
    )
    assert "in another unit" not in _said(tmp_path, _ldt({13: "1200", 14: "600", 15: "100"}))


def test_exponents_of_fortran_are_read_in_photometric_files(tmp_path):
    assert (
        _read(tmp_path, _ies(cd=(("3.0D+02", "2D2", 0),))).intensity.flux() == _read(tmp_path, _ies()).intensity.flux()
    )
