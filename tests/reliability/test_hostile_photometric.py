"""IES and EULUMDAT files that lie: refused in one line, or read with a warning that says what contradicts what."""

import pytest
from refusals import one_line

import lensforge as lf
from lensforge.errors import InputError
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric.photometric_summary import rays

LDT = (
    """maker
1
1
{planes}
0
{gammas}
45
test
name
number
file
today
100
0
0
100
0
0
0
0
0
100
100
1
0
1
1
LED
{lumens}
white
80
10
"""
    + "0\n" * 10
)


def _ldt(planes=1, gammas=3, lumens="1000", numbers="0 0 45 90 300 200 0", symmetry=1) -> str:
    text = LDT.format(planes=planes, gammas=gammas, lumens=lumens)
    lines = text.split("\n")
    lines[2] = str(symmetry)
    return "\n".join(lines) + "\n".join(numbers.split())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_ldt(planes=0, numbers="0 45 90"), "0 half-planes"),
        (_ldt(gammas=0, numbers="0"), "0 angles gamma"),
        (_ldt(planes=10**9), "count of 1e"),
        (_ldt(planes=900_000), "truncated"),
        (_ldt(lumens="1e-320"), "intensities from"),
        (_ldt(numbers="0 0 45 90 3_00 200 0"), "where EULUMDAT has a number"),
        (_ldt(numbers="0 0 45 90 ３00 200 0"), "where EULUMDAT has a number"),
        (_ldt(numbers="0 0 1e-300 90 300 200 0"), "must rise"),
        (_ldt(symmetry=4, planes=3, numbers="0 90 180 0 45 90 300 200 0"), "which leaves one"),
    ],
)
def test_eulumdat_that_lies_is_refused(text, words, tmp_path):
    (tmp_path / "x.ldt").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words) as refusal:
        read_photometric(tmp_path / "x.ldt")
    one_line(refusal)


def _ies(head="1 1000 1 3 1 1 2 0 0 0 1 1 10", angles="0 45 90 0", candela="300 200 0", tilt="NONE") -> str:
    return f"IESNA:LM-63-2002\nTILT={tilt}\n{head}\n{angles}\n{candela}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_ies(head="1 1000 1 1000000 1 1 2 0 0 0 1 1 10"), "truncated"),
        (_ies(head="1 1000 1 2 5000 1 2 0 0 0 1 1 10", angles="0 90 " + " ".join(map(str, range(5000))),
              candela="1 " * 10_000), "5000 angles of one kind, at most 3601"),
        (_ies(candela="3_00 200 0"), "not all that follows TILT= are numbers"),
        (_ies(candela="1e-320 1e-320 0"), "intensities from"),
        (_ies(angles="0 0.00001 90 0"), "must rise, by 0.0001"),
        (_ies(angles="179.9998 179.9999 180 0", candela="0 0 1e-25"), "hold no flux"),
    ],
)  # fmt: skip
def test_lm_63_that_lies_is_refused(text, words, tmp_path):
    (tmp_path / "x.ies").write_text(text)
    with pytest.raises(InputError, match=words) as refusal:
        read_photometric(tmp_path / "x.ies")
    one_line(refusal)


def _tm33(data="", head="", numbers="", emitters=1) -> str:
    rows = data or '<IntData h="0" v="0">300</IntData><IntData h="0" v="90">0</IntData>'
    light = f"<LuminousData><LuminousIntensity>{numbers}{rows}</LuminousIntensity></LuminousData>"
    return f"<IESTM33-22><Version>1.1</Version>{head}{f'<Emitter>{light}</Emitter>' * emitters}</IESTM33-22>"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<!DOCTYPE x [<!ENTITY a "300">]>' + _tm33('<IntData h="0" v="0">&a;</IntData>'), "with a DOCTYPE"),
        ('<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + _tm33(head="<a>&a;</a>"), "with a DOCTYPE"),
        (_tm33()[:-5], "its XML is damaged"),
        (_tm33('<IntData h="0">300</IntData>'), "angle v of IntData is a number"),
        (_tm33('<IntData h="0" v="0">3_00</IntData>'), "where IntData is a number"),
        (_tm33('<IntData h="0" v="0">nan</IntData>'), "IntData is not finite"),
        (_tm33('<IntData h="0" v="0">1</IntData>' * 2), "2 intensities for 1 angles h and 1 angles v"),
        (_tm33('<IntData h="0" v="0">1</IntData><IntData h="9" v="9">1</IntData>'), "one is needed for each pair"),
        (_tm33(numbers="<NumberHorz>7</NumberHorz>"), "1 angles of one kind, its header promises 7"),
        (_tm33(numbers="<Multiplier>-1</Multiplier>"), "intensities from"),
        (_tm33(head="<Equipment><Gonioradiometer><Type>IES_B</Type></Gonioradiometer></Equipment>"), "'IES_B'"),
        (_tm33(emitters=2), "2 of its 2 emitters"),
        (_tm33(emitters=0), "0 of its 0 emitters"),
        ("<IESTM33-22></IESTM33-22>", "0 of its 0 emitters"),
        ("<IESTM33-22>" + "<a/>" * 1_000_001, "more than 1000000 tags"),
        ("<!-- TILT= --><IESTM33-22 />", "0 of its 0 emitters"),
    ],
)
def test_tm_33_that_lies_is_refused(text, words, tmp_path):
    (tmp_path / "x.xml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words) as refusal:
        read_photometric(tmp_path / "x.xml")
    one_line(refusal)


@pytest.mark.parametrize("tilt", ["x.ies", "/dev/zero", "../../secret", "~/.ssh/id_rsa"])
def test_the_file_that_tilt_names_is_never_opened(tilt, tmp_path):
    (tmp_path / "x.ies").write_text(_ies(tilt=tilt))
    assert read_photometric(tmp_path / "x.ies").intensity.values.tolist() == [[300.0, 200.0, 0.0]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_ies(head="0 1000 1 3 1 1 2 0 0 0 1 1 10"), "0 lamps of 1000 lm: taken as absolute"),
        (_ies(head="1 10 1 3 1 1 2 0 0 0 1 1 10"), "its lamps only 10 lm"),
        (_ies(head="1 1000 1 3 1 1 2 0 0 0 1 1 0.01"), "no light has more than 683"),
        (_ies(angles="0 45 90 30"), "only half-plane is C 30"),
        (_ies(head="1 1000 1 3 3 1 2 0 0 0 1 1 10", angles="0 45 90 0 180 360", candela="3 2 0 3 2 0 3 1 0"),
         "C 0 and C 360, which are one, differ by 0.33"),
        (_ies(candela="300 200 -1"), "below 0"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_told_in_a_summary_and_in_a_design(text, words, tmp_path):
    (tmp_path / "x.ies").write_text(text)
    section = lf.DiscSource(diameter_mm=1.0, intensity={"kind": "photometric", "file": tmp_path / "x.ies"})
    placed = section.model_copy(update={"position_mm": (0.0, 0.0, -1.0)})
    for warnings in (
        rays(tmp_path / "x.ies").warnings,
        summarise(build_source(section), section).warnings,
        summarise(build_source(placed), placed).warnings,
    ):
        assert any(words in warning for warning in warnings), warnings
