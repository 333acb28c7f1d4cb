"""Names of columns: each quantity and unit is read as what it is, or refused; none is guessed."""

import re
import warnings
from math import log, pi

import numpy as np
import pytest

from lensforge.errors import FileWarning, InputError
from lensforge.optics.material_files import read_material
from lensforge.results.table_names import DEGREES, MILLIMETRES, NANOMETRES, SHARE, Column
from lensforge.results.text_table import TextTable
from lensforge.sources.source_spectrum import read_spectrum_file
from lensforge.spec.coating_section import CoatingSection
from lensforge.spec.scatter_section import TableScatter
from lensforge.surfaces.point_files import read_cloud

WAVELENGTH, SHARED_LIGHT = Column(("wavelength", "lambda", "nm"), NANOMETRES), Column(("reflectance", "r"), SHARE)
COLUMNS = (WAVELENGTH, SHARED_LIGHT)


def columns(content, wanted=COLUMNS, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return TextTable.of(content, "t.csv").columns(wanted, **options)


@pytest.mark.parametrize(
    ("cell", "factor"),
    [
        ("lambda_um", 1e3), ("lambda (Å)", 0.1), ("lambda / Angstrom", 0.1), ("lambda_A", 0.1), ("lambda in µm", 1e3),
        ("Wavelength [nanometers]", 1.0), ("lambda (microns)", 1e3), ("lambdaum", 1e3), ("LAMBDA", 1.0),
    ],
)  # fmt: skip
def test_a_unit_in_a_name_is_converted(cell, factor):
    assert WAVELENGTH.factor_of(cell) == pytest.approx(factor)


@pytest.mark.parametrize(
    ("column", "cell", "factor"),
    [
        (SHARED_LIGHT, "reflectance_%", 0.01), (SHARED_LIGHT, "reflectance %", 0.01), (SHARED_LIGHT, "R%", 0.01),
        (SHARED_LIGHT, "%R", 0.01), (SHARED_LIGHT, "% R", 0.01), (SHARED_LIGHT, "reflectance_percent", 0.01),
        (SHARED_LIGHT, "R [pct]", 0.01), (SHARED_LIGHT, "R (-)", 1.0), (SHARED_LIGHT, "R (1)", 1.0),
        (Column(("angle",), DEGREES), "angle (radians)", 180.0 / pi), (Column(("angle",), DEGREES), "angle [°]", 1.0),
        (Column(("angle",), DEGREES), "angle_mrad", 0.18 / pi), (Column(("x",), MILLIMETRES), "x_in", 25.4),
        (Column(("x",), MILLIMETRES), "x (inches)", 25.4), (Column(("x",), MILLIMETRES), "X/m", 1000.0),
        *((Column(("a",), {"per_mm": 1.0, "per_cm": 0.1}), f"a{unit}", 0.1)
          for unit in ("_per_cm", " (1/cm)", " [cm-1]", " / cm^-1", " (cm⁻¹)", "/cm")),
    ],
)  # fmt: skip
def test_a_unit_of_each_kind_is_known_by_its_spellings(column, cell, factor):
    assert column.factor_of(cell) == pytest.approx(factor)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("lambda_nm,transmittance\n450,0.99", "line 1: no column reflectance; found 'lambda_nm', 'transmittance'"),
        ("frequency_THz,R\n450,0.01", "line 1: no column wavelength_nm; found 'frequency_THz', 'R'"),
        ("wavelength_THz,R\n450,0.01", "column 1: 'wavelength_THz': its unit must be one of nm, um, angstrom"),
        ("wavelength (cm-1),R\n450,0.01", "'wavelength .cm-1.': its unit"),
        ("lambda,R (dB)\n450,-20", "column 2: 'R .dB.': its unit must be one of %"),
        ("lambda,log10 R\n450,-2", "no column reflectance; found 'lambda', 'log10 R'"),
        ("lambda,R_s\n450,0.1", "column 2: 'R_s': its unit must be"),
        ("a,b\n450,0.1", "line 1: names not known: 'a', 'b'; must be wavelength_nm, reflectance; put #"),
        ("lambda,R\neV,%\n2,1", "line 1, column 1: 'lambda' with 'eV' below: its unit must be one of nm"),
        ("lambda,R_%\nnm,dB\n2,1", "column 2: 'R_%' with 'dB' below: its unit"),
        ("lambda_nm,R\num,\n0.4,0.1", "'lambda_nm' with 'um' below: its unit"),
        ("lambda,R\nof,glass\n400,0.1", "line 2: 'of,glass' between names and numbers is no row of units"),
        ("# wavenumber,R\n450,0.1", "line 1: no column wavelength_nm; found 'wavenumber', 'R'"),
        ("# THz dB\n450 0.1", "line 1: no column wavelength_nm; found 'THz', 'dB'"),
        ("# lambda transmittance\n450 0.1", "no column reflectance"),
        ("lambda R T\n450 0.1", "line 1: 3 names for 2 columns: 'lambda', 'R', 'T'"),
        ("made,today\nhue,chroma\n450,0.1", "line 2: names not known: 'hue', 'chroma'; must be wavelength_nm, reflec"),
    ],
)
def test_what_is_not_wanted_is_not_taken_for_it(content, message):
    with pytest.raises(InputError, match=message):
        columns(content)


@pytest.mark.parametrize(
    "content",
    [
        "lambda,R\nnm,%\n400,50\n", "nm,R\n,%\n400,50\n", "R;lambda\n%;Å\n50;4000\n", "# lambda,R\n# nm,%\n400,50\n",
        "# lambda_um R_%\n0.4 50\n", "# a title\n#lambda [nm]\tR [%]\n400\t50\n", "% lambda R_%\n400 50\n",
        "lambda R_%\n------ ----\n400 50\n", "// nm, %R\n400, 50\n", "# R (%), nm\n# a remark of 2026\n50,400\n",
    ],
)  # fmt: skip
def test_names_in_a_remark_and_units_in_a_row_below_are_read(content):
    np.testing.assert_allclose(columns(content), [[400.0, 0.5]])


@pytest.mark.parametrize("remark", ["# Cool white", "# measured in air, 2026-01-01", "# 400 0.5", "#", "# nm"])
def test_a_remark_of_no_names_stays_one(remark):
    np.testing.assert_array_equal(columns(f"{remark}\n400 0.5\n"), [[400.0, 0.5]])


def test_columns_that_are_left_over_are_told():
    with pytest.warns(FileWarning, match="line 1: columns that are not used: 'R_std', 'remark'"):
        rows = TextTable.of("R_std,lambda,R,remark\n9,400,0.5,1", "t.csv").columns(COLUMNS)
    np.testing.assert_array_equal(rows, [[400.0, 0.5]])
    with pytest.warns(
        FileWarning, match="line 1: 'hue', 'chroma': taken as a title, and the columns as wavelength_nm, r"
    ):
        TextTable.of("hue chroma\n400 0.5", "t.csv").columns(COLUMNS)


def written(folder, content, name="t.csv"):
    (folder / name).write_text(content, encoding="utf-8")
    return folder / name


@pytest.mark.parametrize(
    ("name", "per_mm"),
    [
        ("transmittance", -log(0.9)), ("transmittance_10mm", -log(0.9) / 10), ("T (25 mm)", -log(0.9) / 25),
        ("internal transmittance over 1 cm", -log(0.9) / 10), ("tau_5mm_%", -log(0.009) / 5),
        ("%T 10mm", -log(0.009) / 10), ("TAU_I 1 CM", -log(0.9) / 10), ("T_25MM", -log(0.9) / 25),
        ("absorption_per_mm", 0.9), ("alpha (1/cm)", 0.09), ("absorption coefficient / m^-1", 0.9e-3),
        ("k", 4.0 * pi * 0.9 / 450e-6),
    ],
)  # fmt: skip
def test_a_third_column_of_a_material_absorbs_as_its_name_says(name, per_mm, tmp_path):
    material = read_material(written(tmp_path, f"wavelength_nm,index,{name}\n650,1.49,0.9\n450,1.5,0.9\n"), None)
    assert material.absorption.per_mm[0] == pytest.approx(per_mm) and material.absorption.wavelengths_nm == (
        450.0,
        650.0,
    )


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("wavelength_nm,group_index,k", "no column index; found 'wavelength_nm', 'group_index', 'k'"),
        ("wavelength_nm,n_g,k", "'n_g': its unit"),
        ("wavelength_nm,n,alpha", "column 3: 'alpha': its unit must be one of per_mm, per_cm, per_m"),
        ("wavelength_nm,n,transmittance_0mm", "its thickness must be above 0 mm"),
        ("wavelength_nm,n,T (dB)", "'T .dB.': its unit"),
    ],
)
def test_columns_of_a_material_that_are_something_else_are_refused(names, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_material(written(tmp_path, f"{names}\n450,1.5,0.9\n650,1.49,0.9\n"), None)


def test_absorption_that_is_given_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match="gives absorption in 2 columns"):
        read_material(written(tmp_path, "nm,n,k,T\n450,1.5,0,0.9\n650,1.49,0,0.9\n"), None)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("wavelength_nm,photon_flux", "no column power; found"),
        ("wavelength_nm,power (dBm)", "column 2: 'power .dBm.': its unit must be one to which it is proportional"),
        ("wavelength_nm,intensity_dB", "'intensity_dB': its unit"),
        ("wavelength_nm,irradiance (umol/m2/s)", "its unit"),
        ("wavelength_nm,power (photons/s/nm)", "its unit"),
        ("wavelength_nm,flux (lm/nm)", "its unit"),
        ("wavelength_nm,power (W/THz)", "its unit"),
        ("frequency_THz,power", "no column wavelength_nm"),
        ("energy (eV),power", "no column wavelength_nm"),
    ],
)
def test_spectra_of_something_else_than_power_by_wavelength_are_refused(names, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_spectrum_file(written(tmp_path, f"{names}\n450,1\n650,2\n"))


@pytest.mark.parametrize(
    "unit", ["W/nm", "mW/(m² nm)", "µW/cm²/nm", "%", "a.u.", "W m^-2 nm^-1", "1", "counts/s", "rel. units"]
)
def test_a_spectrum_takes_any_unit_that_power_is_proportional_to(unit, tmp_path):
    waves, power = read_spectrum_file(written(tmp_path, f"# lambda (A);power ({unit})\n4500;1\n6500;2\n"))
    assert (waves.tolist(), power.tolist()) == ([450.0, 650.0], [1.0, 2.0])


def test_coatings_and_scatter_functions_take_no_other_quantity(tmp_path):
    rows = "\n0,450,0.2\n60,450,0.9\n"
    with pytest.raises(InputError, match="no column reflectance; found 'angle_deg', 'wavelength_nm', 'absorptance'"):
        CoatingSection.read(written(tmp_path, f"angle_deg,wavelength_nm,absorptance{rows}"))
    percent = CoatingSection.read(written(tmp_path, f"aoi,nm,R\ndeg,,%{rows}"))
    np.testing.assert_allclose(percent["reflectance"], [[0.002, 0.009]])
    with pytest.raises(InputError, match="no column bsdf; found 'incidence_deg', 'scattering_deg', 'log10_bsdf'"):
        TableScatter.read(written(tmp_path, "incidence_deg,scattering_deg,log10_bsdf\n0,0,2\n0,10,2\n"))
    with pytest.raises(InputError, match="'bsdf_log10': its unit must be one of per_sr"):
        TableScatter.read(written(tmp_path, "incidence_deg,scattering_deg,bsdf_log10\n0,0,2\n0,10,2\n"))
    table = TableScatter.read(written(tmp_path, "aoi,theta_s,bsdf\nrad,rad,1/sr\n0,0,2\n0,0.5,1\n"))
    np.testing.assert_allclose(table["scattering_deg"], [0.0, np.rad2deg(0.5)])


@pytest.mark.parametrize("units", ["µm;W/nm", "um;mW nm-1", "[µm];[W/m²/nm]", "µm;µW·cm^-2·nm^-1"])
def test_a_row_of_units_may_have_quotients(units, tmp_path):
    waves, density = read_spectrum_file(written(tmp_path, f"wavelength;power\n{units}\n0,45;1,5\n0,55;3\n0,65;0,5\n"))
    np.testing.assert_allclose(waves, [450.0, 550.0, 650.0])
    np.testing.assert_allclose(density / density[0], [1.0, 2.0, 1.0 / 3.0])


@pytest.mark.parametrize("name", ["n-1", "n - 1", "index-1", "n−1", "n + 1"])
def test_a_sum_is_another_quantity(name, tmp_path):
    rows = f"wavelength_nm,{name}\n400,1.5\n700,1.4\n"
    with pytest.raises(InputError, match=f"no column index; found 'wavelength_nm', '{re.escape(name)}'"):
        read_material(written(tmp_path, rows), None)


def test_angles_that_can_only_be_radians_are_told(tmp_path):
    rows = "angle,wavelength,reflectance\n0,450,0.01\n0.785,450,0.02\n1.571,450,1\n"
    with pytest.warns(FileWarning, match="angles end at 1.571 degrees: in radians the column is angle_rad"):
        CoatingSection.read(written(tmp_path, rows))


def test_points_take_a_row_of_units_and_tell_what_is_left_over(tmp_path):
    points = np.random.default_rng(1).uniform(0.1, 1.0, (100, 3))
    lines = "\n".join(",".join(f"{value:.6f}" for value in row) for row in points)
    np.testing.assert_allclose(read_cloud(written(tmp_path, f"x,y,z\nin,in,in\n{lines}\n")), 25.4 * points, atol=2e-5)
    more = lines.replace("\n", ",7\n") + ",7"
    with pytest.warns(FileWarning, match="columns that are not used: 'deviation'"):
        read_cloud(written(tmp_path, f"x,y,z,deviation\n{more}\n"))
