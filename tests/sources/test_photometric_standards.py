"""Photometric files against their standards: the editions of LM-63, EULUMDAT's lines, TM-33's elements."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from far_fields import far_field, flux
from other_readers import by_element, by_photompy

import lensforge as lf
from lensforge.sources.build_source import build_source
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import read_photometric, write_photometric
from lensforge.sources.photometric.opening import LuminousOpening
from lensforge.sources.photometric.photometric_file import SIMULATED, UNDEFINED, generation_code, generation_title
from lensforge.sources.photometric.photometric_io import convert_photometric

VERSIONS = (2002, 2019)
FIRST = {2002: "IESNA:LM-63-2002", 2019: "IES:LM-63-2019"}
REQUIRED = {"TEST", "TESTLAB", "ISSUEDATE", "MANUFAC"}
LONG = "standard error of the candela above a tenth of the peak " * 9


def written(tmp_path, version, **fields):
    path = tmp_path / f"{version}.ies"
    write_photometric(path, replace(far_field("none", 417.25), **fields), ies_version=version)
    return path, path.read_bytes().decode("ascii").split("\r\n")


@pytest.mark.parametrize("version", VERSIONS)
def test_an_edition_has_its_first_line_its_keywords_and_its_lengths(version, tmp_path):
    _, lines = written(tmp_path, version, remarks=(LONG, "two"), opening=LuminousOpening.disc(20.0))
    tilt = lines.index("TILT=NONE")
    labels, numbers = lines[:tilt], lines[tilt + 1 : -1]
    assert max(map(len, labels)) + 2 <= 256
    assert max(map(len, numbers)) + 2 <= 132
    assert lines[-1] == "" and all(numbers)
    assert labels[0] == FIRST[version]
    keywords = [line[1 : line.index("]")] for line in labels[1:]]
    assert set(keywords) >= REQUIRED and ("FILEGENINFO" in keywords) == (version == 2019)
    assert all(line[line.index("]") + 1 :].strip() for line in labels[1:])
    assert numbers[0].split()[7:] == ["-0.02", "-0.02", "0"]  # a round opening
    assert numbers[1].split() == ["1", "1.00010" if version == 2019 else "1", "2.5"]


@pytest.mark.parametrize("version", VERSIONS)
def test_an_edition_is_read_for_what_it_says(version, tmp_path):
    fields = {
        "title": "Leuchte " * 30,
        "issued": "2026-03-01",
        "remarks": (LONG,),
        "opening": LuminousOpening.disc(20.0),
    }
    path, _ = written(tmp_path, version, **fields)
    photometric, file = read_photometric(path), far_field("none", 417.25)
    np.testing.assert_allclose(photometric.intensity.values, file.intensity.values, rtol=5e-7)
    assert photometric.edition == f"LM-63-{version}" and photometric.warnings == ()
    assert photometric.opening.diameter_mm == pytest.approx(20.0)
    assert photometric.generated == (SIMULATED if version == 2019 else UNDEFINED)
    assert (photometric.title, photometric.catalogue, photometric.maker) == (
        ("Leuchte " * 30).strip(),
        "L 1",
        "lensforge",
    )
    assert (photometric.issued, photometric.laboratory[:4]) == ("2026-03-01", "none")


OLD = "A luminaire of 1987\nLamp: FL 36 W\nTILT=NONE\n1 1000 1 3 1 1 1 0 0 0\n1.0 {} 40\n0 45 90\n0\n300 200 0\n"


def test_a_file_of_1986_has_no_first_line_and_a_factor(tmp_path):
    """The ballast-lamp photometric factor multiplies the candela until 1991; later its place has no meaning."""
    for head, number, first in (("", "1", 300.0), ("", "0.9", 270.0), ("", "0", 300.0), (FIRST[2002], "0.9", 300.0)):
        (tmp_path / "x.ies").write_text(f"{head}\n{OLD.format(number)}", encoding="ascii")
        photometric = read_photometric(tmp_path / "x.ies")
        assert photometric.intensity.values[0, 0] == pytest.approx(first)
        assert len(photometric.warnings) == (1 if number == "0.9" else 0)  # used or not, that is said
        assert photometric.title == ("" if head else "A luminaire of 1987")
    (tmp_path / "x.ies").write_text(OLD.format("1").replace("1 1 1 0 0 0", "1 1 1 -0.1 0 0"), encoding="ascii")
    assert read_photometric(tmp_path / "x.ies").opening.diameter_mm == pytest.approx(30.48)  # a tenth of a foot


def test_the_table_of_file_generation_types():
    """Digits: accredited, interpolated, scaled, simulated, undefined."""
    for word, title in (
        ("1.00010", "Computer Simulation"),
        ("1.0001", "Computer Simulation"),
        ("1.00001", "Undefined"),
        ("1", "Undefined"),
        ("1.0", "Undefined"),
        ("0", "Undefined"),
        ("1.00011", "Undefined"),
        ("1.00000", "Test at an unaccredited lab"),
        ("1.11100", "Test at an accredited lab with interpolated angle set that has been lumen scaled"),
        ("1.1", "Test at an accredited lab"),
    ):
        assert generation_title(word) == title
    assert generation_code(SIMULATED) == "1.00010" and generation_code("") == "1.00001"


def test_a_measured_file_is_not_made_a_simulated_one(tmp_path):
    path, _ = written(tmp_path, 2019, generated="Test at an accredited lab", laboratory="PTB", catalogue="")
    convert_photometric(path, tmp_path / "b.ies")
    assert lf.rays(tmp_path / "b.ies").generated == "Test at an accredited lab"
    (tmp_path / "old.ies").write_text(OLD.format("1"), encoding="ascii")
    convert_photometric(tmp_path / "old.ies", tmp_path / "new.ies")
    assert "1 1.00001 40" in (tmp_path / "new.ies").read_text(encoding="ascii").split("\n")
    lost = convert_photometric(path, tmp_path / "c.ies", ies_version=2002).lost
    assert lost == ("generation of the data (Test at an accredited lab)", f"method ({far_field('none', 1.0).method})")
    assert "true" not in [element.text for element in _tm33(path, tmp_path).iter("Simulation")]


def _tm33(path, tmp_path):
    convert_photometric(path, tmp_path / "x.iesxml")
    return ET.parse(tmp_path / "x.iesxml").getroot()


def test_the_lines_of_eulumdat(tmp_path):
    file = replace(far_field("none", 417.25), maker="m" * 100, title="t\n" * 60, issued="2026-03-01", remarks=(LONG,))
    write_photometric(tmp_path / "x.ldt", file)
    lines = (tmp_path / "x.ldt").read_text(encoding="ascii").split("\n")
    assert [len(lines[k]) <= 78 for k in (0, 7, 8, 9, 11)] == [True] * 5
    assert lines[1:7] == ["3", "0", "24", "15", "37", "2.5"]
    assert lines[9] == "L 1" and lines[11].startswith("2026-03-01; standard error")
    write_photometric(tmp_path / "y.ldt", replace(file, issued=""))
    undated = (tmp_path / "y.ldt").read_text(encoding="ascii").split("\n")[11]
    assert undated.startswith("no date; standard error") and read_photometric(tmp_path / "y.ldt").issued == ""
    planes, gammas = 24, 37  # each line holds one value: C without 360, gamma, and an intensity for each pair
    assert len([line for line in lines[42:] if line]) == planes + gammas + planes * gammas
    back = read_photometric(tmp_path / "x.ldt")
    assert (back.catalogue, back.generated, back.lamp_lumens) == ("L 1", UNDEFINED, 417.25)


def test_the_conversion_factor_of_eulumdat_multiplies_the_intensities(tmp_path):
    write_photometric(tmp_path / "x.ldt", far_field("none", 417.25))
    lines = (tmp_path / "x.ldt").read_text(encoding="ascii").split("\n")
    assert float(lines[23]) == 1.0  # line 24 of the format
    intensities = {}
    for factor in ("1", "2.5", "0"):  # 0: not stated
        (tmp_path / "y.ldt").write_text("\n".join([*lines[:23], factor, *lines[24:]]), encoding="ascii")
        intensities[factor] = read_photometric(tmp_path / "y.ldt").intensity.values
    np.testing.assert_allclose(intensities["2.5"], 2.5 * intensities["1"], rtol=1e-12)
    np.testing.assert_array_equal(intensities["0"], intensities["1"])


# Children of each element in the order of the schema of TM-33-23; 1: required.
SCHEMA = {
    "IESTM33-22": {"Version": 1, "Header": 1, "Luminaire": 0, "Equipment": 0, "Emitter": 1, "CustomData": 0},
    "Header": {
        "Manufacturer": 0, "CatalogNumber": 0, "GTIN": 0, "Description": 1, "Laboratory": 1, "ReportNumber": 1,
        "ReportDate": 1, "DocumentCreator": 0, "DocumentCreationDate": 0, "UniqueIdentifier": 0, "Comment": 0,
    },
    "Equipment": {"Gonioradiometer": 0},
    "Gonioradiometer": {"Type": 1},
    "Emitter": {
        "Quantity": 1, "Description": 1, "CatalogNumber": 0, "RatedLumens": 0, "InputWattage": 1, "DataGeneration": 0,
        "LuminousData": 0, "EmissionAreas": 0,
    },
    "DataGeneration": {"Simulation": 0, "Laboratory": 0, "IntensityScaling": 0, "AngleInterpolation": 0},
    "LuminousData": {"LuminousIntensity": 1, "LuminousFlux": 0},
    "LuminousIntensity": {
        "AbsolutePhotometry": 0, "Symm": 0, "Multiplier": 0, "NumberMeasured": 1, "NumberHorz": 1, "NumberVert": 1,
        "IntData": 1,
    },
    "EmissionAreas": {"TopFace": 0, "BottomFace": 0},
    "BottomFace": {"NumberBottom": 1, "BottomArea": 1},
    "BottomArea": {"Length": 1, "Width": 1, "LengthOffset": 1, "WidthOffset": 1, "Circular": 0},
}  # fmt: skip
DECIMALS = ("RatedLumens", "InputWattage", "LuminousFlux", "Length", "Width", "IntData")


@pytest.mark.parametrize("lumens", [None, 417.25])
def test_the_elements_of_tm_33_are_those_of_its_schema_in_their_order(lumens, tmp_path):
    file = replace(
        far_field("none", lumens), opening=LuminousOpening.disc(20.0), remarks=("a < b & c", "two"), maker=""
    )
    write_photometric(tmp_path / "x.iesxml", file)
    root = ET.parse(tmp_path / "x.iesxml").getroot()
    assert (root.tag, root.findtext("Version")) == ("IESTM33-22", "1.1")
    for element in root.iter():
        names = [child.tag for child in element]
        order = SCHEMA.get(element.tag, {})
        assert [list(order).index(name) for name in names] == sorted(list(order).index(name) for name in names)
        assert {name for name, must in order.items() if must} <= set(names)
        if element.tag in DECIMALS:
            assert element.text.replace(".", "", 1).isdigit(), element.text  # xs:decimal has no exponent
    assert root.findtext("Emitter/DataGeneration/Simulation") == "true"
    assert "a < b & c" in [comment.text for comment in root.iter("Comment")]
    back = read_photometric(tmp_path / "x.iesxml")
    assert (back.generated, back.lamp_lumens, back.watts, back.edition) == (SIMULATED, lumens, 2.5, "TM-33-23")
    assert (back.opening.diameter_mm, back.catalogue, back.title) == (pytest.approx(20.0), "L 1", "a lens")
    assert back.stated_lumens == pytest.approx(file.intensity.flux(), rel=1e-6)
    np.testing.assert_allclose(back.intensity.values, file.intensity.values, rtol=5e-7)


@pytest.mark.parametrize(("word", "is_true"), [("true", True), ("1", True), ("false", False), ("0", False)])
def test_both_spellings_of_an_xml_boolean_are_read(word, is_true, tmp_path):
    """xs:boolean: absolute photometry has no lamp lumens, a simulation says so."""
    write_photometric(tmp_path / "x.iesxml", far_field("none", 417.25))
    text = (tmp_path / "x.iesxml").read_text(encoding="utf-8")
    for before in ("<AbsolutePhotometry>false<", "<Simulation>true<"):
        assert before in text
        text = text.replace(before, f"{before[: before.index('>') + 1]}{word}<")
    (tmp_path / "x.iesxml").write_text(text, encoding="utf-8")
    photometric = read_photometric(tmp_path / "x.iesxml")
    assert (photometric.lamp_lumens is None, photometric.generated == SIMULATED) == (is_true, is_true)


def test_tm_33_of_other_programs(tmp_path):
    """Another root, a namespace, any order of the intensities, a multiplier, a quarter of the turn."""
    data = [(h, v, 10.0 * h + 90.0 - v) for v in (90, 0, 45) for h in (45, 0, 90)]
    rows = "".join(f'<IntData v="{v}" h="{h}">{value}</IntData>' for h, v, value in data)
    text = (
        '<?xml version="1.0" encoding="utf-16"?><!-- a comment --><t:IESTM33 xmlns:t="http://www.ies.org/tm-33">'
        "<t:Version>1.1</t:Version><t:Emitter><t:Quantity>2</t:Quantity><t:RatedLumens>100</t:RatedLumens>"
        "<t:LuminousData><t:LuminousIntensity><t:Multiplier>2</t:Multiplier>"
        + rows.replace("IntData", "t:IntData")
        + "</t:LuminousIntensity></t:LuminousData></t:Emitter></t:IESTM33>"
    )
    (tmp_path / "x.dat").write_text(text, encoding="utf-16")
    photometric = read_photometric(tmp_path / "x.dat")
    assert (photometric.format, photometric.edition, photometric.lamp_lumens) == ("tm33", "TM-33-18", 200.0)
    assert (
        TabulatedIntensity.of(photometric.intensity).symmetry == "rectangle" and len(photometric.intensity.c_deg) == 9
    )
    np.testing.assert_allclose(
        photometric.intensity.values[:3], [[180.0, 90.0, 0.0], [1080.0, 990.0, 900.0], [1980.0, 1890.0, 1800.0]]
    )
    assert photometric.warnings[0] == "2 emitters in one: the intensities are taken as those of all"
    summary = lf.rays(tmp_path / "x.dat")
    assert (summary.format, summary.title) == ("tm33", "ANSI/IES TM-33")
    source = lf.DiscSource(diameter_mm=1.0, intensity={"kind": "photometric", "file": tmp_path / "x.dat"})
    ways = build_source(source).sample(1024, 0).directions
    assert np.linalg.norm(ways, axis=1) == pytest.approx(1.0) and ways[:, 2].min() > 0.0
    assert np.abs(ways[:, 1]).mean() > 1.2 * np.abs(ways[:, 0]).mean()  # C 90 has the most light


@pytest.mark.parametrize("target", [".ies", ".ldt", ".iesxml", ".xml"])
@pytest.mark.parametrize("origin", [".ies", ".ldt", ".iesxml"])
@pytest.mark.parametrize("lumens", [None, 417.25])
def test_every_format_becomes_every_other(origin, target, lumens, tmp_path):
    file = far_field("none", lumens)
    write_photometric(tmp_path / f"a{origin}", file)
    convert_photometric(tmp_path / f"a{origin}", tmp_path / f"b{target}")
    back = read_photometric(tmp_path / f"b{target}")
    np.testing.assert_allclose(back.intensity.values, file.intensity.values, rtol=2e-6)
    assert (back.lamp_lumens, back.title, back.catalogue) == (lumens, "a lens", "L 1")


DIGITS = 5e-7  # relative: seven digits are written


@pytest.mark.parametrize("kind", ["revolution", "rectangle", "none"])
@pytest.mark.parametrize("lumens", [None, 417.25], ids=["absolute", "relative"])
@pytest.mark.parametrize("form", [*VERSIONS, "ldt", "iesxml"])
def test_another_reader_finds_the_nodes_the_candela_and_the_lumens(form, lumens, kind, tmp_path):
    file, version = far_field(kind, lumens), form if form in VERSIONS else None
    path, intensity = tmp_path / ("lens.ies" if version else f"lens.{form}"), file.intensity
    write_photometric(path, file, **({"ies_version": version} if version else {}))
    if form == "iesxml":
        c, gamma, candela, stated, luminaire = by_element(path)
        assert luminaire == pytest.approx(intensity.flux(), rel=DIGITS)
    else:
        c, gamma, candela, stated, read = by_photompy(path)
        (require_header_of_eulumdat if form == "ldt" else require_header_of_lm_63)(read, file, version)
    np.testing.assert_allclose(c, intensity.c_deg, rtol=DIGITS, atol=1e-9)
    np.testing.assert_allclose(gamma, intensity.gamma_deg, rtol=DIGITS, atol=1e-9)
    np.testing.assert_allclose(candela, intensity.values, rtol=DIGITS)
    assert flux(c, gamma, candela) == pytest.approx(intensity.flux(), rel=1e-6)
    absolute = (
        intensity.flux() if form == "ldt" else -1.0
    )  # EULUMDAT states the lumens of the luminaire in place of a lamp's
    assert stated == pytest.approx(lumens or absolute, rel=DIGITS)


def require_header_of_lm_63(read, file, version):
    assert read.header.version == f"LM-63-{version}"
    assert read.header.future_use == (1.0001 if version == 2019 else 1.0)
    assert (read.header.keywords["MANUFAC"], read.header.keywords["LUMCAT"]) == ("lensforge", "L 1")
    assert read.photometry.total_optical_power() == pytest.approx(file.intensity.flux(), rel=3e-3)  # by its own rule


def require_header_of_eulumdat(read, file, _):
    assert read.header.lamps[0].num_lamps == (-1 if file.lamp_lumens is None else 1)
    assert read.header.luminaire_type == (1 if len(file.intensity.c_deg) == 1 else 3)
    stated = read.header.lamps[0].total_flux
    assert stated * read.header.lorl / 100.0 == pytest.approx(file.intensity.flux(), rel=1e-5)
