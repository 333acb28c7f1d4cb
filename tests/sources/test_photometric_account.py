"""Conversions of files whose headers are crooked: each statement is in the new file, or under ``lost``; none in both.

Which format has a place for what is told here by hand, after LM-63-2019, EULUMDAT and the schema of TM-33-23.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from lensforge.sources.photometric import PhotometricFile, read_photometric
from lensforge.sources.photometric.opening import LuminousOpening
from lensforge.sources.photometric.photometric_file import LampSet
from lensforge.sources.photometric.photometric_io import convert_photometric

IES = """IES:LM-63-2019
[TEST] report 7
[TESTLAB] Light Lab 2
[ISSUEDATE] 3 May 2025
[MANUFAC] Müller & Söhne
[LUMCAT] P-1
[LUMINAIRE] panel <4>
[LAMP] LED board
[LAMPCAT] B-7
[BALLAST] driver D1
[MORE] with dimmer
[OTHER] first remark
[OTHER] second remark
[FILEGENINFO] scaled by hand
[_OWN] 5 / 7
[LAMP] an earlier board
TILT=INCLUDE
1 3 0 45 90 1 0.95 0.9
4 250 2 4 3 1 1 0.5 -1.5 -0.5
0.9 1.11100 41.5
0 30 60 90
0 70 180
300 250.5 100 0
300 240 90 0
300 230 80 7
"""
LDT = "\n".join([
    "Müller & Söhne", "2", "0", "3", "0", "4", "30", "report 7", "panel <4>", "P-1", "panel.ldt",
    "3 May 2025; a remark", "610", "0", "55", "580", "70", "11", "12", "13", "14", "96.5", "72.5", "2", "7.5", "2",
    "4", "LED board", "1200", "4000 K", "1A", "41.5", "2", "another", "900", "3000", "80", "33",
    *(f"0.{n}" for n in range(31, 41)), "0", "70", "180", "0", "30", "60", "90",
    "300", "250.5", "100", "0", "300", "240", "90", "0", "300", "230", "80", "7", ""
])  # fmt: skip
XML = (
    '<?xml version="1.0"?><IESTM33-22><Version>1.1</Version><Header><Manufacturer>Müller &amp; Söhne</Manufacturer>'
    "<CatalogNumber>P-1</CatalogNumber><GTIN>401</GTIN><Description>panel &lt;4&gt;</Description>"
    "<Laboratory>Light Lab 2</Laboratory><ReportNumber>report 7</ReportNumber><ReportDate>2025-05-03</ReportDate>"
    "<Comment>a remark</Comment><MoreInfoURI>x.example</MoreInfoURI></Header><Luminaire><Dimensions>"
    "<Length>0.61</Length><Width>0.6</Width><Height>0.055</Height></Dimensions><NumEmitter>1</NumEmitter></Luminaire>"
    "<Emitter><Quantity>1</Quantity><Description>LED board</Description><CatalogNumber>B-7</CatalogNumber>"
    "<RatedLumens>1200</RatedLumens><InputWattage>41.5</InputWattage><PowerFactor>0.93</PowerFactor><ColorTemperature>"
    "<FixedCCT>4000</FixedCCT><MinCCT>2700</MinCCT></ColorTemperature><ColorRendering><CIE_CRI><Ra>83</Ra><R9>15</R9>"
    "</CIE_CRI></ColorRendering><LuminousData><LuminousIntensity><AbsolutePhotometry>false</AbsolutePhotometry>"
    + "".join(f'<IntData h="{h}" v="{v}">{300 - v + h / 9}</IntData>' for h in (0, 90, 180) for v in (0, 60, 90))
    + "</LuminousIntensity><LuminousFlux>777</LuminousFlux></LuminousData><SpectralData><EmitterSpectral>"
    '<NumberWavelength>1</NumberWavelength><PwrData w="450">1</PwrData></EmitterSpectral></SpectralData><EmissionAreas>'
    "<TopFace><NumberTop>1</NumberTop></TopFace><BottomFace><NumberBottom>1</NumberBottom><BottomArea>"
    "<Length>0.58</Length><Width>0.07</Width><LengthOffset>0.01</LengthOffset><WidthOffset>0</WidthOffset></BottomArea>"
    "</BottomFace><C90Face><NumberC90>1</NumberC90><C90Area><Width>0.07</Width><Height>0.012</Height></C90Area>"
    "</C90Face></EmissionAreas></Emitter></IESTM33-22>"
)
FILES = {".ies": IES, ".ldt": LDT, ".iesxml": XML}
_NOT_TM33 = {"number of lamps", "TILT of the lamp", "ballast factor", "opening"}
# By the first words of each entry: what the file of one format states, and the other has no place for.
LOST = {
    (".ies", ".ies"): set(),
    (".ies", ".ldt"): {
        "laboratory", "method", "generation of the data", "catalogue number of the lamp", "remark", "BALLAST", "_OWN",
        "LAMP", "TILT of the lamp", "ballast factor", "opening",
    },
    (".ies", ".iesxml"): _NOT_TM33,
    (".ldt", ".ies"): {
        "length", "type of the luminaire", "tilt during", "direct ratios", "name of the file", "colour of the lamp",
        "colour rendering", "1 other sets", "opening", "stated lumens",
    },
    (".ldt", ".ldt"): {"stated lumens"},  # which contradict the intensities
    (".ldt", ".iesxml"): {
        "number of lamps", "type of the luminaire", "tilt during", "direct ratios", "name of the file",
        "colour rendering", "1 other sets", "stated lumens",
    },
    (".iesxml", ".ies"): {
        "length", "colour of the lamp", "colour rendering", "opening", "stated lumens", "Header/GTIN",
        "Header/MoreInfoURI", "Emitter/PowerFactor", "Emitter/ColorTemperature/MinCCT",
        "Emitter/ColorRendering/CIE_CRI/R9", "Emitter/SpectralData/EmitterSpectral",
        "Emitter/EmissionAreas/TopFace/NumberTop", "Emitter/EmissionAreas/BottomFace/BottomArea/LengthOffset",
    },
    (".iesxml", ".iesxml"): {"stated lumens", "Emitter/SpectralData/EmitterSpectral"},
}  # fmt: skip
LOST[".iesxml", ".ldt"] = LOST[".iesxml", ".ies"] - {"length", "colour of the lamp", "colour rendering", "opening"} | {
    "laboratory", "catalogue number of the lamp",
}  # fmt: skip


@pytest.mark.parametrize(("origin", "target"), LOST)
def test_a_statement_is_kept_or_lost(origin: str, target: str, tmp_path: Path) -> None:
    (tmp_path / f"a{origin}").write_text(FILES[origin], encoding="utf-8")
    account = convert_photometric(tmp_path / f"a{origin}", tmp_path / f"b{target}")
    expected, rest = LOST[origin, target], list(account.lost)
    for statement in expected:
        fitting = [
            line
            for line in rest
            if line.startswith(f"{statement} (") or line == statement or line.startswith(f"{statement},")
        ]
        fitting = fitting or [line for line in rest if line.startswith(statement)]
        assert fitting, (statement, rest)
        rest = [line for line in rest if line not in fitting]
    assert rest == []


FIELDS_OF_IES = {
    "title": "panel <4>", "maker": "Müller & Söhne", "catalogue": "P-1", "test": "report 7",
    "laboratory": "Light Lab 2", "issued": "3 May 2025", "method": "scaled by hand", "ballast_factor": 0.9,
    "generated": "Test at an accredited lab with interpolated angle set that has been lumen scaled",
    "lamps": (LampSet(1000.0, 41.5, 4, "LED board", "B-7"),), "lamp_tilt": "INCLUDE 1 3 0 45 90 1 0.95 0.9",
    "remarks": ("first remark", "second remark"),
    "others": (("BALLAST", "driver D1 with dimmer"), ("_OWN", "5 / 7"), ("LAMP", "an earlier board")),
}  # fmt: skip
FIELDS_OF_LDT = {
    "title": "panel <4>", "maker": "Müller & Söhne", "catalogue": "P-1", "test": "report 7", "issued": "3 May 2025",
    "remarks": ("a remark",), "linear": True, "housing_mm": (610.0, 0.0, 55.0), "tilt_deg": 7.5,
    "opening": LuminousOpening("box", 70.0, 580.0, (11.0, 12.0, 13.0, 14.0)), "file_name": "panel.ldt",
    "lamps": (
        LampSet(1200.0, 41.5, 4, "LED board", "", "4000 K", "1A"),
        LampSet(900.0, 33.0, 2, "another", "", "3000", "80"),
    ),
    "direct_ratios": (0.31, 0.32, 0.33, 0.34, 0.35, 0.36, 0.37, 0.38, 0.39, 0.4), "stated_lumens": 870.0,
}  # fmt: skip


@pytest.mark.parametrize(("suffix", "fields"), [(".ies", FIELDS_OF_IES), (".ldt", FIELDS_OF_LDT)])
def test_every_line_of_a_header_is_a_field(suffix: str, fields: dict[str, object], tmp_path: Path) -> None:
    (tmp_path / f"a{suffix}").write_text(FILES[suffix], encoding="utf-8")
    photometric = read_photometric(tmp_path / f"a{suffix}")
    assert {name: getattr(photometric, name) for name in fields} == fields
    factor = 2.0 * 0.9 if suffix == ".ies" else 2.0 * 1.2  # multiplier and ballast; conversion factor and lumens
    assert photometric.intensity.values[0, 1] == pytest.approx(factor * 250.5)


def test_the_account_knows_every_field_of_the_record() -> None:
    """A new field has words for the account, or is one of those that say how the record was made."""
    about = {"intensity", "lamps", "format", "photometric_type", "warnings", "edition", "per_1000_lm"}
    for record, silent in ((PhotometricFile, about), (LampSet, set())):
        assert {field.name for field in dataclasses.fields(record) if "label" not in field.metadata} == silent


SHAPES_2002 = {
    (0, 0, 0): ("point", (0, 0, 0)), (0.3, 0.6, 0): ("rectangle", (300, 600, 0)),
    (0.3, 0.6, 0.1): ("box", (300, 600, 100)), (-0.2, -0.2, 0): ("circle", (200, 200, 0)),
    (-0.2, -0.3, 0): ("ellipse", (200, 300, 0)), (-0.2, -0.2, 0.4): ("vertical cylinder", (200, 200, 400)),
    (-0.2, -0.3, 0.4): ("vertical elliptical cylinder", (200, 300, 400)), (-0.2, -0.2, -0.2): ("sphere", (200,) * 3),
    (-0.2, -0.3, -0.4): ("ellipsoid", (200, 300, 400)),
    (-0.1, 1.2, -0.1): ("horizontal cylinder along C 0", (100, 1200, 100)),
    (-0.1, 1.2, -0.2): ("horizontal elliptical cylinder along C 0", (100, 1200, 200)),
    (1.2, -0.1, -0.1): ("horizontal cylinder across C 0", (1200, 100, 100)),
    (-0.1, 0, -0.1): ("vertical circle", (100, 0, 100)), (-0.1, 0, -0.2): ("vertical ellipse", (100, 0, 200)),
    (-0.1, 0, 0): ("circle", (100, 100, 0)),  # of 1995, which the edition of 2002 does not have
    (0, -0.1, 0): ("unknown", (0, 100, 0)),
}  # fmt: skip
SHAPES_1995 = {
    (-0.2, 0, 0): ("circle", (200, 200, 0)), (-0.2, 0, 0.4): ("vertical cylinder", (200, 200, 400)),
    (-0.2, 0, -0.2): ("sphere", (200,) * 3), (0, 1.2, -0.1): ("horizontal cylinder along C 0", (100, 1200, 100)),
    (1.2, 0, -0.1): ("horizontal cylinder across C 0", (1200, 100, 100)),
    (-0.2, 0.3, 0): ("ellipse", (200, 300, 0)), (0.3, -0.2, 0): ("ellipse", (300, 200, 0)),
    (-0.2, 0.3, 0.4): ("vertical elliptical cylinder", (200, 300, 400)),
    (-0.2, 0.3, -0.4): ("ellipsoid", (200, 300, 400)), (0.3, -0.2, -0.4): ("ellipsoid", (300, 200, 400)),
    (-0.2, -0.2, 0): ("circle", (200, 200, 0)),  # of 2002
}  # fmt: skip


@pytest.mark.parametrize(
    ("year", "sizes"), [*((2002, shape) for shape in SHAPES_2002), *((1995, shape) for shape in SHAPES_1995)]
)
def test_an_opening_by_its_signs(year: int, sizes: tuple[float, float, float], tmp_path: Path) -> None:
    """Shape and sizes of each edition; written by the newest signs, they are the same."""
    shape, expected = {2002: SHAPES_2002, 1995: SHAPES_1995}[year][sizes]
    numbers = " ".join(map(str, sizes))
    text = f"IESNA:LM-63-{year}\n[TEST] x\nTILT=NONE\n1 1000 1 3 1 1 2 {numbers}\n1 1 10\n0 45 90\n0\n300 200 0\n"
    (tmp_path / "a.ies").write_text(text)
    photometric = read_photometric(tmp_path / "a.ies")
    assert photometric.opening.shape == shape
    np.testing.assert_allclose(
        [photometric.opening.width_mm, photometric.opening.length_mm, photometric.opening.height_mm], expected
    )
    assert (photometric.opening.diameter_mm > 0.0) == (shape in ("circle", "vertical cylinder", "sphere"))
    assert len(photometric.warnings) == (shape == "unknown")
    assert not any("opening" in loss for loss in convert_photometric(tmp_path / "a.ies", tmp_path / "b.ies").lost)
    for suffix in (".ldt", ".iesxml"):
        account = convert_photometric(tmp_path / "a.ies", tmp_path / f"b{suffix}")
        kept = read_photometric(tmp_path / f"b{suffix}").opening
        assert any("opening" in loss for loss in account.lost) == (kept.shape != shape)
        if shape in ("rectangle", "box", "circle", "vertical cylinder"):
            assert kept.shape == shape and kept.width_mm == pytest.approx(expected[0])
