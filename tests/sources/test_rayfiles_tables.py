"""Rays as spreadsheets and other programs write tables, and the directions that no format may have."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import encoded, image, rays

import lensforge as lf
from lensforge.errors import FileWarning, InputError
from lensforge.sources.light_files import holds_far_field
from lensforge.sources.rayfiles.ray_file_io import decode, is_rayfile

TABLE = "x_mm,y_mm,z_mm,kx,ky,kz,flux_w,wavelength_nm\n0.5,-1.25,1000,0,0.6,0.8,0.125,450\n1,2,3,0,0,1,2.5e-1,550.5\n"
GERMAN = TABLE.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    "content",
    [
        TABLE,
        GERMAN,
        "\ufeff" + GERMAN.replace("\n", "\r\n") + ";;;;;;;\r\n",
        "# by hand\n" + GERMAN.replace(";", "\t"),
        "# by hand\n# " + TABLE,
        TABLE.replace("_mm", "").replace("\n", "\nmm,mm,mm,,,,W,nm\n", 1).replace("flux_w", "flux"),
        "sep=;\n" + GERMAN,
        GERMAN.replace("\n", "\r"),
        GERMAN.replace("x_mm", "X [mm]").replace("kx", "L").replace("flux_w", "Flux (W)").replace("_nm", " / nm"),
        "\n".join(",".join(f'"{cell}"' for cell in line.split(";")) for line in GERMAN.split("\n") if line) + "\n",
        TABLE.replace("x_mm", "x_cm")
        .replace("0.5,", "0.05,", 1)
        .replace("\n1,2", "\n0.1,2")
        .replace("550.5", "550.5 # a"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_rays_of_a_spreadsheet_are_the_same_rays(content, encoding):
    rayfile = decode(image(content.encode(encoding)))
    np.testing.assert_allclose(rayfile.positions_mm, [[0.5, -1.25, 1000.0], [1.0, 2.0, 3.0]], rtol=1e-15)
    np.testing.assert_array_equal(rayfile.directions, [[0.0, 0.6, 0.8], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(rayfile.flux, [0.125, 0.25])
    np.testing.assert_array_equal(rayfile.wavelengths_nm, [450.0, 550.5])
    assert rayfile.verbatim.tobytes() == content.encode(encoding)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TABLE.replace("ky", "kx"), "line 1, column 5: 'kx' is there twice"),
        (
            TABLE.replace("remark", "x").replace("wavelength_nm", "X (mm)"),
            "line 1, column 8: .* twice|second column x_mm",
        ),
        (TABLE.replace("x_mm", "x_yd"), "line 1, column 1: 'x_yd': its unit must be one of mm"),
        (TABLE.replace("x_mm", "x [yd]"), r"line 1, column 1: 'x \[yd\]': its unit must be one of mm, cm"),
        (TABLE.replace("x_mm", "x"), "line 1, column 1: 'x': its unit must be one of mm, cm"),
        (TABLE.replace("flux_w", "flux"), "column 7: 'flux': its unit must be one of w, mw, lm"),
        (TABLE.replace("-1.25", "-1,25"), "line 1: 8 names for 9 columns"),
        (GERMAN.replace("1000", "1.000"), "line 2, column 3: '1.000' beside numbers with decimal commas"),
        (GERMAN.replace("-1,25", "-1.25"), "line 2, column 1: '0,5' beside numbers with decimal points"),
        (GERMAN + "4;5;6;0;0;1;1.5;550\n", "line 4, column 7: '1.5' beside numbers with decimal commas"),
        (GERMAN.replace("1000", "east"), "line 2, column 3: 'east' is no number; semicolons separate"),
    ],
)
def test_rays_of_a_spreadsheet_that_cannot_be_read_have_a_place(content, message):
    with pytest.raises(InputError, match=message):
        decode(image(content.encode()))


def test_a_sign_that_changes_far_down_is_refused():
    """The dialect is that of the first rows; no row is read by another."""
    rows = "0,5;1;1;0;0;1;1\n" * 3000
    with pytest.raises(InputError, match=r"line 3002, column 7: '1\.5' beside numbers with decimal commas"):
        decode(image(f"x_mm;y_mm;z_mm;kx;ky;kz;flux_w\n{rows}1;1;1;0;0;1;1.5\n".encode()))
    with pytest.raises(
        InputError, match=r"line 3002, column 7: '1,5' is no number|'1,5' beside numbers with decimal p"
    ):
        decode(image(f"x_mm;y_mm;z_mm;kx;ky;kz;flux_w\n{rows.replace(',', '.')}1;1;1;0;0;1;1,5\n".encode()))


@pytest.mark.parametrize("added", [(), ("angle",), ("r_std", "run")])
def test_columns_of_rays_that_are_not_used_are_told(added):
    names, *rows = (line.split(",") for line in TABLE.splitlines())
    wide = [[f"{k}7" for k, _ in enumerate(added)] + row for row in rows]
    content = "\n".join(",".join(row) for row in ([*added, *names], *wide)) + "\n"
    rayfile = decode(image(content.encode()))
    assert rayfile.warnings == ((f"columns that are not used: {', '.join(map(repr, added))}",) if added else ())
    assert rayfile.positions_mm.tolist() == [[0.5, -1.25, 1000.0], [1.0, 2.0, 3.0]]
    assert rayfile.header["columns"] == [*added, *names]


def test_text_of_other_programs_may_have_decimal_commas():
    zemax = "2 4\n1,5 2 3 0 0 1 0,5\n4 5 6,25 0 0,6 0,8 0,25\n"
    for content in (zemax.encode(), zemax.replace("\n", "\r").encode("utf-16")):
        rayfile = decode(image(content))
        assert rayfile.positions_mm.tolist() == [[1.5, 2.0, 3.0], [4.0, 5.0, 6.25]]
        assert (rayfile.format, rayfile.flux.tolist()) == ("zemax_text", [0.5, 0.25])


@pytest.mark.parametrize("name", ["zemax_text", "zemax_binary", "lighttools_binary", "csv", "tm25"])
def test_directions_of_another_length_are_said_and_angles_refused(name):
    ones = rays(2000)
    cosines = ones.directions.astype(np.float64)
    assert decode(image(encoded(name, replace(ones, directions=ones.directions.round(2))))).warnings == ()
    longer = decode(image(encoded(name, replace(ones, directions=(1.5 * cosines).astype(np.float32)))))
    assert longer.warnings == (
        "its direction cosines have lengths of 1.5 to 1.5, must be 1: taken for the directions of such vectors",
    )
    few = np.where(np.arange(2000)[:, None] % 20, cosines, 2.0 * cosines).astype(np.float32)
    assert "lengths of 1 to 2, must be 1" in decode(image(encoded(name, replace(ones, directions=few)))).warnings[0]
    degrees = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).astype(np.float32)
    with pytest.raises(InputError, match=r"lengths of 97.31 to 217.6, must be 1: are they angles\?"):
        decode(image(encoded(name, replace(ones, directions=degrees))))


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("um", 1e-3), ("in", 25.4)])
def test_each_unit_of_a_table_of_rays(unit, mm):
    """Of places; of flux mW, and of wavelengths um, beside."""
    head = f"x [{unit}];y [{unit}];z [{unit}];kx;ky;kz;flux [mW];wavelength [um]\n"
    rayfile = decode(image((head + "1.5;2;3;0;0.6;0.8;250;0.4505\n").encode()))
    np.testing.assert_allclose(rayfile.positions_mm, mm * np.array([[1.5, 2.0, 3.0]]), rtol=1e-6)
    assert (rayfile.flux[0], rayfile.wavelengths_nm[0]) == pytest.approx((0.25, 450.5)) and rayfile.flux_unit == "W"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_rays_that_are_named_as_a_far_field_are_read_as_rays(encoding, tmp_path):
    path = tmp_path / "led.ies"
    path.write_bytes(TABLE.encode(encoding))
    assert is_rayfile(path) and not holds_far_field(path) and lf.rays(path).rays == 2
    path.write_bytes("x_mm,y_mm\n1,2\n".encode(encoding))
    assert not is_rayfile(path) and holds_far_field(path), "by its name alone"
    assert not is_rayfile(tmp_path) and not is_rayfile(tmp_path / "none.ray")


def test_a_doubt_on_commas_is_told_once_by_the_name_of_the_file(tmp_path):
    path = tmp_path / "led.csv"
    path.write_text(f"{TABLE.splitlines()[0]}\n1,2,0,0,0,1,1,450\n0,3,1,0,0,1,1,520\n")
    with pytest.warns(FileWarning) as told:
        assert lf.rays(path).rays == 2
    (warning,) = told
    assert str(warning.message).startswith(f"{path}: no number has a decimal point: its commas are taken to separate")
