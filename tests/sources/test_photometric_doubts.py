"""Photometric files that can be read in two ways: what is taken is said, or they are refused."""

from pathlib import Path

import pytest

import lensforge as lf
from lensforge.errors import InputError
from lensforge.light.road_judgement import of_file
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric.photometric_io import convert_photometric

PLANES = {90: (300, 200, 100, 280), 120: (300, 150, 240)}  # cd at gamma 45 by the step of C; 300 at 0, 0 at 90


def _ldt(changes=(), symmetry=1, planes=(0,), sets=(("1", "LED", "1000", "", "", "10"),), cd=((300, 200, 0),)):
    head = ["maker", "3", str(symmetry), str(len(planes)), "0", "3", "45", "r", "lamp", "c", "f", "d"] + ["0"] * 9
    head += ["100", "0", "1", "0", str(len(sets)), *(line for each in sets for line in each)]
    for line, text in dict(changes).items():
        head[line - 1] = text
    return "\n".join([*head, *["0"] * 10, *map(str, planes), "0", "45", "90", *(str(n) for row in cd for n in row)])


def _ies(first="IESNA:LM-63-2002", number="1", h=(0,), cd=((300, 200, 0),), kind=1, v=(0, 45, 90), tilt="NONE"):
    rows = "\n".join(" ".join(map(str, row)) for row in (v, h, *cd))
    return f"{first}\nTILT={tilt}\n1 1000 1 {len(v)} {len(h)} {kind} 2 0 0 0\n1 {number} 10\n{rows}\n"


def _tm33(h, cd):
    data = "".join(
        f'<IntData h="{c}" v="{v}">{x}</IntData>'
        for c, row in zip(h, cd, strict=True)
        for v, x in zip((0, 45, 90), row, strict=True)
    )
    return (
        "<IESTM33-22><Emitter><LuminousData><LuminousIntensity><AbsolutePhotometry>true</AbsolutePhotometry>"
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
    for text, said in ((_ldt(symmetry=0, planes=h, cd=cd), 0), (_ies(h=h, cd=cd), 1), (_tm33(h, cd), 0)):
        file = _read(tmp_path, text)
        assert file.intensity.flux() == pytest.approx(truth) and len(file.warnings) == said
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
    ("text", "words"),
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
def test_what_is_taken_is_said_and_nothing_else(text, words, tmp_path):
    (tmp_path / "x").write_text(text)
    found = lf.rays(tmp_path / "x").warnings
    assert len(found) == len(words) and all(word in line for word, line in zip(words, found, strict=True)), found


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


def test_lumens_that_are_not_stated_stay_unknown(tmp_path):
    """Candela per 1000 lm: a road's own lumens scale them; a format that needs lumens has 1000, and that is said."""
    (tmp_path / "a.ldt").write_text(_ldt({29: "0"}))
    file = read_photometric(tmp_path / "a.ldt")
    assert (file.lamp_lumens, file.stated_lumens, file.rated_lumens) == (None, None, 1000.0)
    assert of_file(file, 90.0, 500.0) is not None
    for suffix in (".ldt", ".ies", ".iesxml"):
        account = convert_photometric(tmp_path / "a.ldt", tmp_path / f"b{suffix}")
        back = read_photometric(tmp_path / f"b{suffix}")
        assert back.lamp_lumens == (None if suffix == ".ldt" else 1000.0)
        assert any("1000 lm are written" in each for each in account.warnings) == (suffix != ".ldt")


def test_the_sizes_of_an_opening_stand_where_eulumdat_has_them(tmp_path):
    (tmp_path / "a.ies").write_text(
        "IESNA:LM-63-2002\n[TEST] r\n[ISSUEDATE] 2026-01-01\n[LAMP] board\nTILT=NONE\n4 250 1 3 1 1 2 0.6 1.2 0\n"
        "1 1 40\n0 45 90\n0\n300 200 0\n"
    )
    convert_photometric(tmp_path / "a.ies", tmp_path / "a.ldt")
    lines = (tmp_path / "a.ldt").read_text().split("\n")
    assert lines[11:17] == ["2026-01-01", "0", "0", "0", "1200", "600"]
    assert lines[26:29] == ["4", "board", "1000"]
