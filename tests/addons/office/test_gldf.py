"""GLDF: figures of a data sheet by hand, elements in the order of the schema, and the file read by another program."""

import io
import json
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from cie_luminaire import C_DEG, GAMMA_DEG, LUMINOUS_M, TABLE

import lensforge as lf
from lensforge.addons.office.gldf_file import gldf_bytes, variants_of
from lensforge.addons.office.product_figures import ProductFigures, luminous_m2
from lensforge.errors import InputError
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.opening import LuminousOpening
from lensforge.sources.photometric.photometric_file import LampSet, PhotometricFile

NO_HEIGHT = (0.0,) * 4


def lamp(values, opening, c_deg=C_DEG, gamma_deg=GAMMA_DEG):
    return PhotometricFile(CandelaTable(c_deg, gamma_deg, values), (LampSet(1000.0),), opening=opening)


def test_glare_is_that_of_another_program():
    """eulumdat-ugr 1.0.2 of the luminaire of CIE 190 in 4H 8H, 70/50/20, lamps a quarter of H apart."""
    x_mm, y_mm = (1e3 * side for side in LUMINOUS_M)
    figures = ProductFigures.of(lamp(TABLE, LuminousOpening.of_area(y_mm, x_mm, NO_HEIGHT, False)))
    assert figures.glare == pytest.approx((14.79994, 13.24916), rel=1e-3)


def test_luminance_and_cut_off_of_a_crooked_lamp_are_those_by_hand():
    """Most light at C = 200; its luminance is 3000 cd/m² where I = 3000 A cos(gamma)."""
    turn, gamma = np.meshgrid(np.radians(C_DEG), np.radians(GAMMA_DEG), indexing="ij")
    values = 80.0 * np.cos(gamma) ** 3 * (1.0 + 0.6 * np.sin(gamma) * np.cos(turn - np.radians(195.0)))
    opening = LuminousOpening.disc(120.0)
    area_m2 = np.pi * 0.06**2
    assert luminous_m2(lamp(values, opening)) == pytest.approx(area_m2, rel=1e-12)
    figures = ProductFigures.of(lamp(values, opening))
    plane = values[int(195 / 15)]
    assert figures.luminance_cd_per_m2 == pytest.approx(
        plane[13] / (area_m2 * np.cos(np.radians(65.0))), rel=1e-9
    )  # gamma = 65 is a node
    for side, holds in ((-0.15, False), (0.05, True)):
        angle = figures.cut_off_deg + side
        bright = np.interp(angle, GAMMA_DEG, plane) / (area_m2 * np.cos(np.radians(angle)))
        assert (bright <= 3000.0) == holds, (angle, bright)
    assert 20.0 < figures.cut_off_deg < 80.0


@pytest.mark.parametrize(("diameter_mm", "defined"), [(79.7, False), (79.9, True)])
def test_glare_is_defined_from_a_luminous_area_of_50_square_centimetres_on(diameter_mm, defined):
    assert (ProductFigures.of(lamp(TABLE, LuminousOpening.disc(diameter_mm))).glare is not None) == defined


def test_a_lamp_without_an_area_has_no_luminance():
    assert ProductFigures.of(lamp(TABLE, LuminousOpening())) == ProductFigures(None, None, None)


@pytest.fixture(scope="module")
def lit(small_run):
    spec = small_run.spec.changed(drawing=small_run.spec.drawing.changed(part_number="A-17", part_name="Lamp <1>"))
    return spec, lf.photometry(small_run.lens, rays=4096, lumens=250.0)


def document(content):
    archive = zipfile.ZipFile(io.BytesIO(content))
    return archive, ElementTree.fromstring(archive.read("product.xml"))


def test_the_file_holds_the_figures_of_the_record_in_the_order_of_the_schema(lit):
    spec, photometry = lit
    (variant,) = variants_of(photometry, spec)
    variant = replace(variant, figures=ProductFigures(1234.4, 61.2, (18.04, 16.96)))
    content = gldf_bytes([variant, replace(variant, name="wide")], spec, watts=2.5)
    archive, root = document(content)
    assert archive.read("ldc/light2.ldt") == photometry.ldt
    described = root.find("GeneralDefinitions/Photometries/Photometry[@id='photometry2']/DescriptivePhotometry")
    figures = {element.tag: [part.text for part in element] or element.text for element in described}
    ratio = photometry.light_output_ratio.value
    c0, c90 = photometry.beam_c0, photometry.beam_c90
    assert list(figures.items()) == [
        ("LightOutputRatio", f"{ratio:.4f}"),
        ("LuminousEfficacy", f"{photometry.exit_lm.value / 2.5:.4g}"),
        ("DownwardFluxFraction", "1.0000"),
        ("DownwardLightOutputRatio", f"{ratio:.4f}"),
        ("UpwardLightOutputRatio", "0.0000"),
        ("TenthPeakDivergence", [f"{plane.field_angle_deg.value / 2:.2f}" for plane in (c0, c90)]),
        ("HalfPeakDivergence", [f"{plane.beam_angle_deg.value / 2:.2f}" for plane in (c0, c90)]),
        ("CIE-FluxCode", photometry.figures.flux_code_words),
        ("CutOffAngle", "61.2"),
        ("UGR-4H8H-70-50-20-LQ", ["18.0", "17.0"]),
    ]
    emitters = [entry.text for entry in root.iter("RatedLuminousFlux")]
    assert emitters == ["250", "250"] and root.findtext(".//Header/GldfCreationTimeCode").startswith("1970-01-01")
    names = [entry.findtext("Name/Locale") for entry in root.iter("Variant")]
    assert names == [spec.name, "wide"]
    assert root.findtext(".//ProductMetaData/Name/Locale") == "Lamp <1>"
    assert root.findtext(".//Variant/Description/Locale") == "Luminance at 65°: 1234 cd/m² at most"
    assert gldf_bytes([variant, replace(variant, name="wide")], spec, watts=2.5) == content


def test_every_reference_has_what_it_refers_to(lit):
    spec, photometry = lit
    variants = variants_of(photometry, spec)
    _, root = document(gldf_bytes([*variants, *variants], spec))
    known = {element.get("id") for element in root.iter() if element.get("id")}
    keys = ("fileId", "photometryId", "fixedLightSourceId", "emitterId")
    referred = [element.get(key) for element in root.iter() for key in keys if element.get(key)]
    assert set(referred) <= known and len(referred) == 8


def test_unknown_lumens_and_too_little_power_are_refused(lit):
    spec, photometry = lit
    with pytest.raises(InputError, match="GLDF states lumens, and those of the source are not known"):
        variants_of(photometry.changed(per_1000_lm=True), spec)
    least = photometry.exit_lm.value / 683.0
    variants = variants_of(photometry, spec)
    assert gldf_bytes(variants, spec, 1.001 * least)
    with pytest.raises(InputError, match=r"watts = .*: must be above"):
        gldf_bytes(variants, spec, 0.999 * least)
    (dim,) = variants
    table = dim.file.intensity
    bright = replace(dim, file=replace(dim.file, intensity=replace(table, values=2.0 * table.values)))
    assert gldf_bytes([dim, bright], spec, 2.002 * least)
    with pytest.raises(InputError, match=r"watts = .*: must be above"):
        gldf_bytes([dim, bright], spec, 1.5 * least)


@pytest.mark.nightly("another program, which is installed for it")
def test_gldf_rs_reads_it(lit):
    gldf_rs_python = pytest.importorskip("gldf_rs_python")
    spec, photometry = lit
    read = json.loads(gldf_rs_python.gldf_from_bytes(gldf_bytes(variants_of(photometry, spec), spec, 4.0)))
    (light,) = read["GeneralDefinitions"]["Photometries"]["Photometry"]
    described = light["DescriptivePhotometry"]
    assert described["LightOutputRatio"] == pytest.approx(photometry.light_output_ratio.value, abs=1e-4)
    assert described["CIE-FluxCode"] == photometry.figures.flux_code_words
    (emitter,) = read["GeneralDefinitions"]["Emitters"]["Emitter"]
    assert emitter["FixedLightEmitter"][0]["RatedLuminousFlux"] == 250
