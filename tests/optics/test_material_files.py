"""Files of materials: Zemax catalogues, refractiveindex.info, tables; read, kept in the spec, refused in one line."""

import json
import tracemalloc
import warnings
from math import exp, pi

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import FileWarning, InputError
from lensforge.optics.material import MATERIALS
from lensforge.optics.material_files import read_material
from lensforge.spec import load_spec

AGF = """CC a catalogue for tests
NM GLASS-A 2 517642.251 1.5168 64.17 0 1
GC a comment
ED 7.1 8.3 2.51 -0.0009 0
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653 0 0 0 0
TD 1.86E-6 1.31E-8 -1.37E-11 4.34E-7 6.27E-10 0.17 20
OD -1 -1 -1 -1 -1 -1
LD 0.3 2.5
IT 0.40 0.998 10
IT 0.55 0.9 5
IT 0.70 0 25
IT 0.80 0.99 0
NM GLASS-B 1 0 1.52308 58.57 0 3
CD 2.286575 -8.7334582e-3 1.1742884e-2 2.9041756e-4 -1.2506695e-5 9.2646253e-7
LD 0.33 2.1
NM BROKEN 14 0 1.5 60
CD 1 2
LD 0.3 2
NM EMPTY 2 0 1.5 60
"""
NK = """REFERENCES: |
    somebody
DATA:
  - type: formula 2
    wavelength_range: 0.4368 1.052
    coefficients: 0 1.2969 0.011721
  - type: tabulated k
    data: |
        0.400 2.0E-7
        0.600 1.0E-7
        0.500 3.0E-7
"""
TABLE = "wavelength,index,transmittance of 1 mm\n400, 1.52, 0.99\n500, 1.51, 0.995\n700, 1.50, 1.0\n"


def written(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_glass_of_a_catalogue_has_its_formula_range_and_absorption(tmp_path):
    material = read_material(written(tmp_path, "c.agf", AGF), "glass-a")
    waves = np.linspace(310.0, 2400.0, 50)
    np.testing.assert_allclose(material.dispersion.index(waves), MATERIALS["N-BK7"].index(waves), rtol=1e-14)
    assert material.name == "GLASS-A" and material.range_nm == (300.0, 2500.0) and material.source == "c.agf: GLASS-A"
    assert material.absorption.wavelengths_nm == (400.0, 550.0, 700.0)  # the line without a thickness says nothing
    for per_mm, (transmittance, thickness) in zip(material.absorption.per_mm, [(0.998, 10), (0.9, 5)], strict=False):
        assert exp(-per_mm * thickness) == pytest.approx(transmittance, rel=1e-14)
    assert exp(-material.absorption.per_mm[2] * 25) == pytest.approx(1e-6)
    again = read_material(written(tmp_path, "wide.AGF", AGF), "GLASS-B")
    np.testing.assert_allclose(again.dispersion.index(waves), MATERIALS["B270"].dispersion.index(waves), rtol=1e-7)
    (tmp_path / "u.agf").write_text(AGF, encoding="utf-16")
    assert read_material(tmp_path / "u.agf", "GLASS-A").dispersion == material.dispersion


def test_a_file_of_refractiveindex_info_has_its_index_and_its_absorption(tmp_path):
    material = read_material(written(tmp_path, "e48r.yml", NK), None)
    waves = np.linspace(437.0, 1050.0, 50)
    np.testing.assert_allclose(material.dispersion.index(waves), MATERIALS["COP"].index(waves), rtol=1e-14)
    assert material.name == "e48r" and material.absorption.wavelengths_nm == (400.0, 500.0, 600.0)
    assert material.absorption.per_mm[1] == pytest.approx(4 * pi * 3e-7 / 500e-6)
    table = "DATA:\n  - type: tabulated nk\n    data: |\n        0.4 1.42 1e-7\n        0.5 1.41 2e-7\n"
    material = read_material(written(tmp_path, "nk.yaml", table), "own")
    assert (material.name, material.range_nm, material.dispersion.indices) == ("own", (400.0, 500.0), (1.42, 1.41))
    assert material.absorption.per_mm[0] == pytest.approx(4 * pi * 1e-7 / 400e-6)


def test_the_same_file_by_another_program(tmp_path):
    pytest.importorskip("optiland")
    from optiland.materials import MaterialFile

    path = written(tmp_path, "e48r.yml", NK.replace("        0.600 1.0E-7\n", "") + "        0.600 1.0E-7\n")
    material = read_material(path, None)
    other = MaterialFile(str(path))
    for nm in np.linspace(440.0, 590.0, 31):
        assert material.index_at(nm) == pytest.approx(np.asarray(other.n(1e-3 * nm)).item(), rel=1e-12)
        wanted = 4 * pi * np.asarray(other.k(1e-3 * nm)).item() / (1e-6 * nm)
        waves = np.array(material.absorption.wavelengths_nm)
        per_mm = np.array(material.absorption.per_mm)
        assert np.interp(nm, waves, per_mm * waves) / nm == pytest.approx(wanted, rel=1e-12)


def test_a_table_has_index_and_transmittance(tmp_path):
    material = read_material(written(tmp_path, "t.csv", TABLE), None)
    assert material.dispersion.index(np.array([450.0]))[0] == pytest.approx(1.515)
    np.testing.assert_allclose(np.exp(-np.array(material.absorption.per_mm)), [0.99, 0.995, 1.0])
    bare = read_material(written(tmp_path, "bare.txt", "# nm n\n700\t1.50\n400\t1.52\n"), "resin")
    assert bare.absorption is None and bare.dispersion.indices == (1.52, 1.50)


@pytest.mark.parametrize("cut", [" 0.231792344", " 1.01046945", " 103.560653"])
def test_a_line_of_a_catalogue_that_goes_on_in_the_next_is_one(tmp_path, cut):
    whole = read_material(written(tmp_path, "c.agf", AGF), "GLASS-A")
    material = read_material(
        written(tmp_path, "cut.agf", AGF.replace(cut, f"\n{cut}").replace("IT 0.70 0 ", "IT 0.70\n0 ")), "GLASS-A"
    )
    assert (material.dispersion, material.absorption) == (whole.dispersion, whole.absorption)


def test_coefficients_that_are_missing_are_said_and_a_glass_twice_alike_is_one(tmp_path):
    short = written(tmp_path, "c.agf", AGF.replace(" 1.01046945 103.560653 0 0 0 0", ""))
    with pytest.warns(FileWarning, match="GLASS-A has 4 of the 6 coefficients of formula 2 in its line CD"):
        read_material(short, "GLASS-A")
    twice = written(tmp_path, "twice.agf", AGF + AGF.replace("CD 1.03961212 ", "CD  1.03961212  "))
    assert read_material(twice, "GLASS-A").range_nm == (300.0, 2500.0)


@pytest.mark.parametrize("kind", ["formula", "table"])
def test_an_index_against_vacuum_becomes_that_against_air(tmp_path, kind):
    """Air at 20 C: 1.0002724 at the d line, by Birch and Downs, Metrologia 30, 155 (1993)."""
    table = "DATA:\n  - type: tabulated n\n    data: |\n        0.5 1.52\n        0.6751236 1.51\n"
    text = {"formula": NK, "table": table}[kind]
    plain = read_material(written(tmp_path, "a.yml", text), None).index_at(587.5618)
    path = written(tmp_path, "b.yml", text + "SPECS:\n    n_is_absolute: true\n    wavelength_is_vacuum: true\n")
    assert read_material(path, None).index_at(587.5618) == pytest.approx(plain / 1.0002724, abs=1.5e-6)
    spec = small_spec(lens__material_file=str(path))
    assert spec.lens.refractive_index == pytest.approx(plain / 1.0002724, abs=1.5e-6)
    spec.save(tmp_path / "again.toml")
    assert load_spec(tmp_path / "again.toml").lens.dispersion == spec.lens.dispersion
    same = text + "SPECS:\n    n_is_absolute: false\n"
    assert read_material(written(tmp_path, "c.yml", same), None).index_at(587.5618) == plain


@pytest.mark.parametrize(
    "text",
    [
        "wavelength_nm;index;T\n400;1,52;0,99\n500;1,51;0,995\n700;1,50;1\n",
        "T [%]\tn\tWavelength [µm]\n99\t1.52\t0.4\n99.5\t1.51\t0.5\n100\t1.50\t0.7\n",
        "Wellenlänge;Brechzahl;Transmittance\r700;1,50;1,0\r400;1,52;0,99\r500;1,51;0,995\r",
    ],
)
def test_a_table_of_a_spreadsheet_is_the_same_table(tmp_path, text):
    (tmp_path / "t.csv").write_text(text, encoding="utf-16", newline="")
    material = read_material(tmp_path / "t.csv", None)
    wanted = read_material(written(tmp_path, "u.csv", TABLE), None)
    assert material.dispersion.indices == wanted.dispersion.indices
    np.testing.assert_allclose(material.dispersion.wavelengths_nm, wanted.dispersion.wavelengths_nm, rtol=1e-15)
    np.testing.assert_allclose(material.absorption.per_mm, wanted.absorption.per_mm, atol=1e-15)


def spec_file(folder, lens):
    small_spec().save(folder / "small.toml")
    text = (folder / "small.toml").read_text(encoding="utf-8")
    assert "[lens]" in text
    return written(folder, "spec.toml", text.replace("[lens]", f"[lens]\n{lens}"))


def test_a_spec_keeps_the_numbers_and_needs_the_file_no_more(tmp_path):
    written(tmp_path, "c.agf", AGF)
    spec = load_spec(spec_file(tmp_path, 'material = "glass-a"\nmaterial_file = "c.agf"\ndesign_wavelength_nm = 550.0'))
    glass = read_material(tmp_path / "c.agf", "glass-a")
    (tmp_path / "c.agf").unlink()
    assert spec.lens.material == "GLASS-A" and spec.lens.material_file is None
    assert spec.lens.refractive_index == pytest.approx(MATERIALS["N-BK7"].index_at(550.0), rel=1e-14)
    assert spec.lens.media.body.absorption_per_mm == pytest.approx(-np.log(0.9) / 5)
    assert spec.lens.dispersion.absorption == glass.absorption
    spec.save(tmp_path / "again.toml")
    again = load_spec(tmp_path / "again.toml")
    assert again == spec and again.lens.dispersion == spec.lens.dispersion
    assert json.loads(spec.model_dump_json())["lens"]["optical_data"]["source"] == "c.agf: GLASS-A"


@pytest.mark.parametrize(
    ("name", "content", "lens", "message"),
    [
        ("c.agf", AGF, {"material": "GLASS-C"}, r"c\.agf: no glass 'GLASS-C' among its 4; closest: 'GLASS-"),
        ("c.agf", AGF, {}, r"c\.agf: name the glass in it by lens.material"),
        ("c.agf", AGF, {"material": "broken"}, r"broken has the dispersion formula 14, known are 1 to 13"),
        ("c.agf", AGF, {"material": "empty"}, r"empty has no line CD"),
        ("c.agf", AGF.replace("1.03961212", "x1"), {"material": "glass-a"}, r"glass-a has 'x1' where a number must be"),
        ("c.agf", AGF.replace("0.998", "1.998"), {"material": "glass-a"}, r"an internal transmittance of 1\.998"),
        ("c.agf", AGF.replace("0.17 20", "1e20 20"), {"material": "glass-a"}, r"schott_coefficients.5 = 1e\+20"),
        ("c.agf", AGF + "NM X 1\n" * 9 + "NM " + "X" * 300, {"material": "y"}, r"6 glasses, .* names of 60 characters"),
        ("c.agf", "".join(f"NM G{k} 2\n" for k in range(5001)), {"material": "y"}, r"5001 glasses, at most 5000"),
        ("a.yml", "a:\n  secret: [", {}, r"a\.yml: not YAML from line 3, column 1 on; download"),
        ("a.yml", "a: &a secret\nb: *a", {}, r"a\.yml: an alias in line 2, which no material needs"),
        ("a.yml", "DATA: [" + "1, " * 10_000 + "1]", {}, r"more than 10000 entries, or more than 16 levels"),
        ("a.yml", "DATA: " + ":".join(["1"] * 300_000), {}, r"a\.yml: has no list DATA"),
        ("a.yml", NK.replace("0.400 2", "0.0 2"), {}, r"table of tabulated k: numbers must be below 1e\+30"),
        ("a.yml", "DATA:\n  - type: tabulated k\n    data: 1 2\n", {}, r"a\.yml: has no index, only tabulated k"),
        ("a.yml", NK.replace("0.4368 1.052", "0.4368"), {}, r"wavelength_range: '0\.4368', must be 2 numbers"),
        (
            "a.yml",
            NK.replace("1.052", "1.052 3"),
            {},
            r"a\.yml: wavelength_range: '0\.4368 1\.052 3', must be 2 numbers",
        ),
        ("a.yml", NK.replace("0.4368", "1e999"), {}, r"a\.yml: wavelength_range: '1e999 1\.052', must be 2 numbers"),
        ("a.yml", NK + NK[NK.index("  - type: tab") :], {}, r"a\.yml: DATA has two blocks of one type"),
        ("a.yml", NK + "SPECS:\n  n_is_absolute: perhaps\n", {}, r"n_is_absolute: 'perhaps', must be true or false"),
        (
            "c.agf",
            AGF + AGF.replace("1.0396", "1.0397"),
            {"material": "glass-a"},
            r"twice, in lines 2 and 21, with dif",
        ),
        (
            "c.agf",
            AGF.replace(" 0.23179", " 0.23\n179"),
            {"material": "glass-a"},
            r"11 coefficients in its line CD, for",
        ),
        ("t.csv", "nm;n\n450;1,526\n550;1.5185\n", {}, r"t\.csv, line 2, column 2: '1,526' beside numbers with"),
        ("t.csv", "450,1,526\n550,1,5185\n", {}, r"transmittance of 1 mm must|internal transmittance must be above 0"),
        ("a.yml", NK.replace("2.0E-7", "two"), {}, r"table of tabulated k, line 1, column 2: 'two' is no number"),
        ("t.csv", TABLE.replace("1.51", "x"), {}, r"t\.csv, line 3, column 2: 'x' is no number"),
        ("t.csv", "400, 1.52\n", {}, r"must be two rows at least of wavelength \(nm\)"),
        ("t.csv", TABLE.replace("0.995", "1.2"), {}, r"an internal transmittance must be above 0 and at most 1"),
        (
            "t.csv",
            TABLE.replace("of 1 mm", "of 0 mm"),
            {},
            r"t\.csv: 'transmittance of 0 mm': its thickness must be above 0",
        ),
        ("t.csv", "nm,n,alpha (1/mm)\n400,1.52,0.1\n500,1.51,-0.1\n", {}, r"t\.csv: its absorption must be 0 or above"),
        (
            "t.csv",
            "nm,n,alpha (1/mm),k\n400,1.52,0.1,1e-6\n500,1.51,0.1,1e-6\n",
            {},
            r"t\.csv: gives absorption in 2 columns; leave out all but one",
        ),
        ("t.csv", "0.4, 1.52\n0.7, 1.50\n", {}, r"wavelengths must be in nm, each once; they go from 0\.4 to 0\.7"),
        ("t.csv", TABLE.replace("1.52", "5.2"), {}, r"its index at 400 nm is 5\.2, must be 1 to 4"),
        ("t.xml", TABLE, {}, r"a material is read from \.agf, \.yml"),
        ("t.csv", TABLE, {"absorption_per_mm": 0.1}, r"absorption_per_mm: t has its own absorption"),
        ("t.csv", TABLE, {"refractive_index": 1.6}, r"refractive_index = 1\.6, but t has 1\.50"),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path, name, content, lens, message):
    path = written(tmp_path, name, content)
    fields = {f"lens__{key}": value for key, value in lens.items()}
    with pytest.raises(InputError, match=message) as error:
        small_spec(lens__material_file=str(path), **fields)
    assert "\n" not in str(error.value)


def test_the_smallest_file_beyond_a_bound_is_refused_and_the_largest_within_is_read(tmp_path):
    """Values of YAML are texts: 1:30, which a reader of types takes for 90, is no number; neither is a date."""
    text = NK.replace("somebody", "x").replace("DATA:", "NUMBER: 1:30\nDATE: 2001-01-01\nDATA:")
    deep = text + "DEEP: " + "[" * 14 + "]" * 14 + "\nLONG: [" + "1, " * 9900 + "1]\n"
    for name, content in {"plain": text, "deep": deep}.items():
        assert read_material(written(tmp_path, f"{name}.yml", content), None).absorption.wavelengths_nm == (
            400.0,
            500.0,
            600.0,
        )
    with (tmp_path / "large.yml").open("w", encoding="utf-8") as file:
        file.truncate(4 * 2**20 + 1)
    for suffix in ("yml", "agf", "csv"):
        (tmp_path / f"large.{suffix}").write_bytes((tmp_path / "large.yml").read_bytes())
        with pytest.raises(InputError, match="4 MiB, must be at most 4 MiB"):
            read_material(tmp_path / f"large.{suffix}", "x")


@pytest.mark.parametrize("levels", [6, 9])
def test_aliases_of_aliases_take_neither_time_nor_memory(tmp_path, levels):
    """Nine to the power of ``levels`` entries in 500 bytes."""
    lists = [f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join(['*' + chr(97 + k)] * 9)}]\n" for k in range(levels)]
    path = written(tmp_path, "a.yml", "a: &a [x]\n" + "".join(lists) + f"DATA: [{{type: *{chr(97 + levels)}}}]\n")
    assert path.stat().st_size < 600
    with pytest.raises(InputError):  # the first reading loads libraries, which do not count
        read_material(path, None)
    tracemalloc.start()
    with pytest.raises(InputError, match="an alias in line 2"):
        read_material(path, None)
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()


def test_numbers_in_the_spec_itself():
    data = {"formula": "sellmeier", "coefficients": [1.2969, 0.011721], "range_nm": [436.8, 1052.0]}
    spec = small_spec(lens__material="my resin", lens__optical_data=data)
    assert spec.lens.refractive_index == pytest.approx(MATERIALS["COP"].index_at(587.5618), rel=1e-14)
    dim = data | {"absorption_nm": [500.0, 700.0], "absorption_per_mm": [0.01, 0.03]}
    assert small_spec(lens__optical_data=dim).lens.media.body.absorption_per_mm == pytest.approx(0.018756, rel=1e-4)
    for wrong, message in (
        ({"formula": "sellmeier"}, "formula needs coefficients, and range_nm"),
        ({}, "give formula with coefficients and range_nm, or wavelength_nm with refractive_index"),
        (data | {"formula": "agf 99"}, "dispersion formula 'agf 99': must be one of"),
        (data | {"range_nm": [900.0, 500.0]}, r"range_nm = \[900, 500\]: must rise"),
        (data | {"coefficients": [-3.0, 0.01]}, "its index at 436.8 nm is nan, must be 1 to 4"),
        ({"wavelength_nm": [400.0, 500.0], "refractive_index": [1.5]}, "2 and 1 numbers, must be as many"),
        (dim | {"absorption_nm": [700.0, 500.0]}, "absorption_nm must rise"),
    ):
        with pytest.raises(InputError, match=message):
            small_spec(lens__optical_data=wrong)


SELLMEIER = "0 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653"
BK7_D = 1.51680  # of SCHOTT's data sheet


def of_formula(folder, number, coefficients, more=""):
    block = f"  - type: formula {number}\n    wavelength_range: 0.3 2.5\n    coefficients: {coefficients}\n"
    return read_material(written(folder, "f.yml", f"DATA:\n{block}{more}"), None)


@pytest.mark.parametrize("number", [1, 2, 3, 5, 6])
def test_a_formula_of_pairs_with_its_last_number_missing_is_refused(number, tmp_path):
    with pytest.raises(InputError, match=f"6 coefficients, formula {number} has them 1 and then pairs"):
        of_formula(tmp_path, number, SELLMEIER.rpartition(" ")[0])
    assert len(of_formula(tmp_path, number, SELLMEIER).dispersion.coefficients) == 7


@pytest.mark.parametrize(
    ("number", "count", "allowed"),
    [(4, 6, "as 1"), (4, 7, "as 1"), (4, 8, "as 1"), (4, 10, "as 1"), (7, 2, "3 to 6"), (7, 7, "3 to 6"),
     (8, 3, "must be 4"), (8, 5, "must be 4"), (9, 5, "must be 6"), (9, 7, "must be 6")],
)  # fmt: skip
def test_each_formula_has_its_own_number_of_coefficients(number, count, allowed, tmp_path):
    with pytest.raises(InputError, match=allowed):
        of_formula(tmp_path, number, " ".join(["0.1"] * count))


def test_formulas_may_end_where_they_are_complete(tmp_path):
    for number, counts in {4: (1, 5, 9, 11, 17), 7: (3, 5, 6), 8: (4,), 9: (6,)}.items():
        for count in counts:
            assert len(of_formula(tmp_path, number, " ".join(["0.1"] * count)).dispersion.coefficients) == count


def test_older_files_call_an_absolute_index_otherwise(tmp_path):
    """Air at 20 C has 1.0002724 at the d line."""
    older = of_formula(tmp_path, 2, SELLMEIER, "SPECS:\n    n_absolute: true\n    wavelength_vacuum: true\n")
    assert older.index_at(587.5618) == pytest.approx(BK7_D / 1.0002724, abs=2e-6)
    both = "SPECS:\n    n_absolute: {}\n    n_is_absolute: true\n"
    assert of_formula(tmp_path, 2, SELLMEIER, both.format("true")).index_at(587.5618) == older.index_at(587.5618)
    with pytest.raises(InputError, match="n_is_absolute and n_absolute contradict each other"):
        of_formula(tmp_path, 2, SELLMEIER, both.format("false"))


@pytest.mark.parametrize(
    "rows", ["n\n    data: |\n        0.4 1.5\n        0.5 1.49\n        0.5 1.6\n        0.7 1.48\n",
             "nk\n    data: |\n        0.4 1.5 0\n        0.5 1.49 1e-6\n        0.5 1.49 2e-6\n        0.7 1.48 0\n"],
)  # fmt: skip
def test_two_values_at_one_wavelength_are_refused_and_a_row_twice_counts_once(rows, tmp_path):
    with pytest.raises(InputError, match=r"table of tabulated n.*: 1\.49.* and 1\..* at one wavelength, 0\.5 um"):
        read_material(written(tmp_path, "t.yml", f"DATA:\n  - type: tabulated {rows}"), None)
    alike = "DATA:\n  - type: tabulated n\n    data: |\n        0.4 1.5\n        0.5 1.49\n        0.5 1.49\n"
    assert read_material(written(tmp_path, "t.yml", alike), None).dispersion.indices == (1.5, 1.49)


def test_two_indices_and_two_absorptions_of_a_file_are_compared(tmp_path):
    table = "  - type: tabulated n\n    data: |\n        0.5875618 {}\n        0.5875619 {}\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        of_formula(tmp_path, 2, SELLMEIER, table.format(1.51688, 1.51688))
    with pytest.warns(FileWarning, match="formula 2 is taken, tabulated n beside it .* differs by up to 0.00012"):
        assert of_formula(tmp_path, 2, SELLMEIER, table.format(1.51692, 1.51692)).index_at(587.5618) < 1.51681
    k = "  - type: tabulated k\n    data: |\n        0.4 1e-7\n        0.6 1e-7\n"
    nk = "  - type: tabulated nk\n    data: |\n        0.4 1.5 1e-7\n        0.6 1.5 {}\n"
    read_material(written(tmp_path, "k.yml", f"DATA:\n{k}{nk.format(1e-7)}"), None)
    with pytest.warns(FileWarning, match="tabulated k is taken, tabulated nk beside it has another k"):
        read_material(written(tmp_path, "k.yml", f"DATA:\n{k}{nk.format(2e-7)}"), None)


@pytest.mark.parametrize(
    ("n_d", "v_d", "told"),
    [
        ("1.51680", "64.17", ""), ("1.51689", "64.17", ""), ("1.51671", "64.17", ""), ("0", "0", ""), ("-", "-", ""),
        ("1.51692", "64.17", "n_d = 1.51692, its coefficients make 1.516800"), ("1.62", "64.17", "n_d = 1.62"),
        ("1.51680", "64.30", ""), ("1.51680", "64.40", "v_d = 64.4, its coefficients make 64.17"),
        ("1.51680", "60", "v_d = 60"),
    ],
)  # fmt: skip
def test_the_index_and_abbes_number_of_a_catalogue_are_those_of_its_coefficients(n_d, v_d, told, tmp_path):
    catalogue = AGF.replace("1.5168 64.17", f"{n_d} {v_d}")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_material(written(tmp_path, "c.agf", catalogue), "GLASS-A")
    message = " ".join(str(warning.message) for warning in caught)
    assert (told in message) if told else not message


def test_exponents_of_fortran_are_read_in_catalogues_and_formulas(tmp_path):
    catalogue = written(tmp_path, "c.agf", AGF.replace("0.00600069867", "6.00069867D-03"))
    assert read_material(catalogue, "GLASS-A").index_at(587.5618) == pytest.approx(BK7_D, abs=1e-6)
    assert of_formula(tmp_path, 2, SELLMEIER.replace("0.0200179144", "2.00179144d-2")).index_at(
        587.5618
    ) == pytest.approx(BK7_D, abs=1e-6)
