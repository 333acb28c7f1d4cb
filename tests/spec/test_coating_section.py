"""Coatings in a spec: what may be given, what becomes of a file, and one line for what cannot be."""

import json

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.optics.media import LayerStack, ReflectanceTable
from lensforge.report.headline import task
from lensforge.sources.build_source import build_source
from lensforge.spec import load_spec

TABLE = "angle_deg,wavelength_nm,reflectance\n" + "".join(
    f"{angle},{wave},{share}\n"
    for wave, row in ((600, (0.02, 0.03, 0.2)), (450, (0.01, 0.015, 0.1)))
    for angle, share in zip((0, 45, 80), row, strict=True)
)
LAYERS = {"layers": [{"refractive_index": 1.38, "thickness_nm": 100.0}]}


def written(folder, name, text):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_a_number_is_a_table_of_one_reflectance():
    spec = small_spec(lens__inner__coating={"reflectance": 0.005}, lens__outer__coating={"reflectance": 0})
    assert spec.lens.media.coating("inner") == ReflectanceTable((0.0, 90.0), ((0.005, 0.005),))
    assert spec.lens.media.coating("outer") == ReflectanceTable((0.0, 90.0), ((0.0, 0.0),))
    assert spec.lens.dispersion is None
    waves = small_spec(lens__inner__coating={"reflectance": [[0.01], [0.02]], "wavelength_nm": [400, 700]})
    assert waves.lens.media.coating("inner").reflectance == ((0.01, 0.01), (0.02, 0.02))
    angles = small_spec(lens__inner__coating={"reflectance": [0.01, 0.1], "angle_deg": [0, 60]})
    assert angles.lens.media.coating("inner") == ReflectanceTable((0.0, 60.0), ((0.01, 0.1),))


@pytest.mark.parametrize(
    "text",
    [
        TABLE,
        TABLE.replace(",", "; ").replace("angle_deg", "# a comment\nangle_deg"),
        TABLE.replace(",", ";").replace(".", ","),
        "\ufeffsep=;\n" + TABLE.replace(",", ";").replace(".", ",").split("\n", 1)[1],
    ],
)
def test_a_spec_keeps_the_table_and_needs_the_file_no_more(tmp_path, text):
    small_spec().save(tmp_path / "small.toml")
    content = (tmp_path / "small.toml").read_text(encoding="utf-8")
    content += '\n[lens.outer.coating]\nfile = "coating.csv"\n'
    written(tmp_path, "coating.csv", text)
    spec = load_spec(written(tmp_path, "spec.toml", content))
    (tmp_path / "coating.csv").unlink()
    wanted = ReflectanceTable((0.0, 45.0, 80.0), ((0.01, 0.015, 0.1), (0.02, 0.03, 0.2)), (450.0, 600.0))
    assert spec.lens.media.coating("outer") == wanted
    spec.save(tmp_path / "again.toml")
    assert load_spec(tmp_path / "again.toml") == spec
    assert json.loads(spec.model_dump_json())["lens"]["outer"]["coating"]["angle_deg"] == [0.0, 45.0, 80.0]


def test_layers_know_the_index_of_the_body_and_their_own():
    layers = [{"material": "fused silica", "thickness_nm": 80.0}, {"refractive_index": 2.3, "thickness_nm": 30.0}]
    glass = {"refractive_index": 1.52, "thickness_mm": 1.0, "distance_mm": 20.0, "coating": LAYERS}
    spec = small_spec(lens__material="PMMA", lens__outer__coating={"layers": layers}, lens__cover_glass=glass)
    media, waves = spec.lens.media, np.array([431.0, 587.0])
    assert isinstance(media.coating("outer"), LayerStack) and media.coating("inner") is None
    silica = media.coating("outer").layers[0].index.at(waves)
    np.testing.assert_allclose(silica, MATERIALS["fused silica"].index(waves), atol=2e-6)
    np.testing.assert_allclose(media.coating("outer").body.at(waves), MATERIALS["PMMA"].index(waves), atol=2e-6)
    assert media.coating("outer").range_nm == MATERIALS["fused silica"].trusted_nm
    assert media.cover_glass.coating.body.refractive_index == (1.52,)
    assert media.wavelength_nm == spec.lens.design_wavelength_nm


def test_rays_have_wavelengths_where_a_coating_asks_for_them():
    spectrum = {"kind": "line", "wavelength_nm": 450.0}
    for coating, chromatic in ((LAYERS, True), ({"reflectance": 0.01}, False)):
        spec = small_spec(lens__outer__coating=coating, source__spectrum=spectrum)
        rays = build_source(spec.source, spec.lens.dispersion).sample(10, 0)
        assert (rays.wavelengths_nm is not None) == chromatic
        if chromatic:
            assert (rays.wavelengths_nm == 450.0).all()
            assert (spec.lens.media.body.index(rays.waves) == spec.lens.refractive_index).all()
            assert (rays.take(np.arange(3)).wavelengths_nm == 450.0).all()
    blue = small_spec(lens__outer__coating=LAYERS, lens__design_wavelength_nm=450.0)
    assert blue.lens.media.wavelength_nm == 450.0
    with pytest.raises(InputError, match=r"design_wavelength_nm goes with a material .*, or a coating by"):
        small_spec(lens__design_wavelength_nm=450.0)


@pytest.mark.parametrize(
    ("coating", "message"),
    [
        ({"reflectance": "low"}, r"lens.outer.coating.reflectance"),
        ({"reflectance": float("nan")}, r"lens.outer.coating.reflectance.*finite"),
        ({"reflectance": [0.1, 0.2]}, r"1 rows of 2 numbers, must be a row of 1 \(angle_deg\) for each of 1"),
        ({"reflectance": [0.1, 0.2], "angle_deg": [10, 60]}, r"angle_deg = 10 and 2 in all: must rise from 0"),
        ({"reflectance": [0.1, 0.2], "angle_deg": [0, 0]}, r"angle_deg must rise"),
        ({"reflectance": [[0.1], [0.2]], "wavelength_nm": [500, 400]}, r"wavelength_nm must rise"),
        ({"reflectance": 0.1, **LAYERS}, r"give one of reflectance \(a number, or a table by angle_deg\), file, and"),
        ({}, r"give one of reflectance"),
        ({**LAYERS, "angle_deg": [0, 60]}, r"layers have no angle_deg or wavelength_nm"),
        ({"layers": [{"thickness_nm": 100}]}, r"give one of refractive_index and material"),
        ({"layers": [{"material": "MgF2", "thickness_nm": 100}]}, r"material = 'MgF2': must be one of PMMA"),
        ({"file": "nowhere.csv"}, r"file: .*nowhere.csv.*give a table of the reflectance"),
        ({"file": "nowhere.csv", "reflectance": 0.1}, r"file: give nothing else beside it"),
    ],
)
def test_a_coating_that_cannot_be_is_one_line(coating, message):
    with pytest.raises(InputError, match=message) as error:
        small_spec(lens__outer__coating=coating)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("angle reflectance\n0 0.1\n", r"line 1: no column wavelength_nm; found 'angle', 'reflectance'"),
        ("0 0.1\n5 0.2\n", r"line 1: 2 cells, must be angle_deg, wavelength_nm, reflectance"),
        ("0,500,0,05\n60,500,0,10\n", r"line 1: '0,05': commas between numbers and in them cannot be told apart"),
        (TABLE.rsplit("\n", 2)[0], r"5 rows for 3 angles and 2 wavelengths; must be one a pair"),
        (TABLE.replace("0,600", "45,600", 1), r"6 rows for 3 angles and 2 wavelengths"),
        (TABLE.replace("0.03", "3"), r"reflectance.*at most 1"),
        (TABLE.replace("\n0,", "\n5,"), r"angle_deg = 5 and 3 in all: must rise from 0"),
    ],
)
def test_a_file_that_cannot_be_is_one_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        small_spec(lens__outer__coating={"file": str(written(tmp_path, "c.csv", text))})


def test_the_drawing_and_the_page_name_a_coating_in_a_few_words():
    layers = [{"refractive_index": 1.38, "thickness_nm": 100.0}, {"material": "fused silica", "thickness_nm": 30.0}]
    table = {"reflectance": [0.01, 0.2], "angle_deg": [0, 70]}
    spec = small_spec(lens__inner__coating={"layers": layers}, lens__outer__coating=table)
    wanted = "n = 1.38, 100 nm; fused silica, 30 nm, from outside to the body"
    assert spec.lens.inner.coating.title == wanted
    assert spec.lens.outer.coating.title == "reflects 1 to 20 %, up to 70°"
    assert ", coated inside and outside" in task(spec) and "coated" not in task(small_spec())
    assert small_spec(lens__inner__coating={"reflectance": 0.005}).lens.inner.coating.title == "reflects 0.5 %"
