"""Readers against bytes that were packed here, field by field, and not by our writers."""

import struct
import warnings

import numpy as np
import pytest
from rayfile_samples import image

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file_io import decode

ROW = (1.0, 2.0, 3.0, 0.0, 0.6, 0.8, 0.5)


def tm25(columns=7, flags=(1, 1, 1, 0, 0, 0, 0, 0), spectral=0, tables=(), labels=(), extra_text="", rows=2, **more):
    """A TM-25 file by its table of offsets; rows count up from 0 in steps of 1/8."""
    head = bytearray(288)
    struct.pack_into("<4siiffQ", head, 0, b"TM25", more.get("version", 2013), 1, 0.0, 2.0, rows)
    struct.pack_into("<28sii", head, 28, b"2024-02-29", 3, spectral)
    struct.pack_into("<Iff", head, 64, more.get("wavelength_bits", 0x7F800001), 390.0, 510.0)
    struct.pack_into("<3i", head, 76, len(tables), len(labels), 4 * len(extra_text))
    struct.pack_into("<8i", head, 256, *flags)
    texts = b"".join(f"text {index}".encode("utf-32-le").ljust(4000, b"\0") for index in range(9))
    block = b"".join(
        struct.pack("<i", len(table)) + struct.pack(f"<{2 * len(table)}f", *sum(table, ())) for table in tables
    )
    block += b"\0" * (-len(block) % 32)
    marks = b"".join(label.encode("utf-32-le").ljust(512, b"\0") for label in labels)
    values = np.arange(rows * columns, dtype="<f4") / 8.0
    return bytes(head) + texts + block + marks + extra_text.encode("utf-32-le") + values.tobytes()


def test_tm25_plain():
    rayfile = decode(image(tm25()))
    np.testing.assert_array_equal(rayfile.positions_mm, [[0.0, 0.125, 0.25], [0.875, 1.0, 1.125]])
    np.testing.assert_array_equal(rayfile.directions[1], [1.25, 1.375, 1.5])
    np.testing.assert_array_equal(rayfile.flux, [0.75, 1.625])
    assert (rayfile.flux_unit, rayfile.header_flux_w, rayfile.header_flux_lm) == ("W", 2.0, None)
    assert rayfile.wavelengths_nm is None
    assert rayfile.header["name"] == "text 0"
    assert rayfile.header["data_reference"] == "text 8"
    assert rayfile.header["creation_method"] == "measured"
    (warning,) = rayfile.warnings
    assert warning.startswith("its direction cosines have lengths of 0.8989 to 2.373, must be 1")


def test_tm25_tables_are_padded_once_as_one_block_and_extra_columns_are_passed():
    tables = [[(400.0, 1.0), (500.0, 0.5)], [(450.0, 1.0)]]  # 4+16 and 4+8 bytes: 32, not 2 x 32
    content = tm25(columns=9, spectral=3, tables=tables, labels=("phase", "age"), extra_text="12345678")
    rayfile = decode(image(content))
    assert rayfile.positions_mm[0].tolist() == [0.0, 0.125, 0.25]
    assert rayfile.positions_mm[1, 0] == 9 / 8
    assert rayfile.header["spectral_tables"][1] == {"wavelength_nm": [450.0], "weight": [1.0]}
    assert rayfile.header["extra_columns"] == ["phase", "age"]
    assert rayfile.header["extra_text"] == "12345678"
    assert "extra" in rayfile.warnings[0]


def test_tm25_table_with_a_signalling_nan_is_refused_without_a_warning():
    content = bytearray(tm25(spectral=3, tables=[[(400.0, 1.0), (500.0, 0.5)]]))
    content[36292:36296] = (0x7F800001).to_bytes(4, "little")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match="spectral table 1 holds numbers that are not finite"):
            decode(image(bytes(content)))


def test_tm25_all_columns_in_their_order():
    """x y z k k k, W, nm, lm, six of Stokes, two of tristimulus, index: radiant flux is used, the rest is named."""
    rayfile = decode(image(tm25(columns=18, flags=(1,) * 8, spectral=4)))
    assert rayfile.flux[0] == 6 / 8
    assert rayfile.wavelengths_nm[0] * 1 == pytest.approx(7 / 8 * 1000)  # under 100: µm
    assert any("radiant flux (W) is used" in warning for warning in rayfile.warnings)
    assert any("stokes, tristimulus" in warning for warning in rayfile.warnings)


def test_tm25_lumens_come_from_the_luminous_column():
    rayfile = decode(image(tm25(columns=8, flags=(1, 1, 0, 1, 1, 0, 0, 0), spectral=2)))
    assert rayfile.flux_unit == "lm"
    assert rayfile.flux[0] == 7 / 8
    assert rayfile.header_flux is None


def test_tm25_single_wavelength_is_shared():
    bits = struct.unpack("<I", struct.pack("<f", 450.0))[0]
    rayfile = decode(image(tm25(spectral=1, wavelength_bits=bits)))
    assert rayfile.single_wavelength == 450.0


def test_tm25_of_another_version_is_read_with_a_warning_if_its_size_closes():
    assert "2020" in decode(image(tm25(version=2020))).warnings[0]
    with pytest.raises(InputError, match="truncated"):
        decode(image(tm25(version=2020)[:-4]))


@pytest.mark.parametrize(
    ("offset", "layout", "value", "message"),
    [
        (4, ">i", 2013, "big-endian"),
        (20, "<Q", 2**63, "truncated"),
        (20, "<Q", 0, "holds no rays"),
        (76, "<i", 3, "pairs"),
        (76, "<i", 999, "pairs"),
        (80, "<i", -1, "negative count"),
        (84, "<i", 2**31 - 32, "truncated"),
        (256, "<i", 0, "positions or directions"),
        (264, "<i", 0, "no flux"),
        (268, "<i", 7, "column flag"),
    ],
)
def test_tm25_headers_that_lie(offset, layout, value, message):
    content = bytearray(tm25())
    struct.pack_into(layout, content, offset, value)
    with pytest.raises(InputError, match=message):
        decode(image(bytes(content)))


def zemax(rays=1, unit=4, ray_format=0, flux_type=0, row=ROW, byte_order="<"):
    header = struct.pack(
        f"{byte_order}iI100s7fI13f4i", 1010, rays, b"made here", 9.0, 9.0, 0.55, 0, 0, 0, 0, unit,
        *(0.0,) * 13, ray_format, flux_type, 0, 0,
    )  # fmt: skip
    assert len(header) == 208
    return header + struct.pack(f"{byte_order}{len(row)}f", *row)


@pytest.mark.parametrize(("unit", "factor"), [(0, 1000.0), (1, 25.4), (2, 10.0), (3, 304.8), (4, 1.0)])
def test_zemax_binary_units(unit, factor):
    rayfile = decode(image(zemax(unit=unit)))
    np.testing.assert_allclose(rayfile.positions_mm, [[factor, 2 * factor, 3 * factor]])
    assert rayfile.single_wavelength == pytest.approx(550.0)
    assert rayfile.total_flux() == 0.5  # OpticStudio takes the rays, not the header's 9 W


def test_zemax_binary_flux_types():
    assert decode(image(zemax(flux_type=1))).flux_unit == "lm"
    spectral = decode(image(zemax(ray_format=2, flux_type=1, row=(*ROW, 0.45))))
    assert spectral.flux_unit == "W"  # spectral rays always are
    np.testing.assert_allclose(spectral.wavelengths_nm, [450.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"unit": 5}, "length unit 5"),
        ({"ray_format": 1}, "ray format 1"),
        ({"flux_type": 2}, "flux type 2"),
        ({"rays": 2**32 - 1}, "truncated"),
        ({"rays": 0}, "no rays"),
        ({"byte_order": ">"}, "big-endian"),
    ],
)
def test_zemax_binary_headers_that_lie(changes, message):
    with pytest.raises(InputError, match=message):
        decode(image(zemax(**changes)))


@pytest.mark.parametrize("first", ["2 2", "2 2 0 1", "2 2 0 0 0 0 0", "2.000000\t2.000000\t0.0"])
def test_zemax_text_first_lines(first):
    rayfile = decode(image(f"{first}\n1 2 3 0 0 1 0.5\r\n4 5 6 0 0 1 0.25\n".encode()))
    np.testing.assert_array_equal(rayfile.positions_mm, [[10, 20, 30], [40, 50, 60]])
    assert rayfile.flux_unit == ("lm" if first == "2 2 0 1" else "W")


def test_zemax_text_counts_its_rays():
    with pytest.raises(InputError, match="promises 3 rays, the file holds 2"):
        decode(image(b"3 4\n1 2 3 0 0 1 0.5\n4 5 6 0 0 1 0.25\n"))
    with pytest.raises(InputError, match="length unit 9"):
        decode(image(b"1 9\n1 2 3 0 0 1 0.5\n"))


def lighttools(row=ROW, flux_type=0, far_field=0, colour=0, unit=1, major=2):
    head = struct.pack("<4s6I4f", b"LTRF", major, 0, flux_type, far_field, colour, unit, 7.0, 8.0, 9.0, 2.0)
    assert len(head) == 44
    return head + struct.pack(f"<{len(row)}f", *row) + b"LTRFEND"


def test_lighttools_binary():
    for unit, mm in enumerate((1.0, 1.0, 10.0, 1000.0, 25.4, 304.8, 1e-3, 1e-6)):
        rayfile = decode(image(lighttools(unit=unit)))
        np.testing.assert_allclose(rayfile.positions_mm, mm * np.array([[1.0, 2.0, 3.0]]), rtol=1e-6)
    assert (rayfile.flux_unit, rayfile.total_flux()) == ("W", 2.0)
    coloured = decode(image(lighttools(row=(*ROW, 450.0), flux_type=1, colour=2)))
    assert (coloured.flux_unit, coloured.wavelengths_nm[0]) == ("lm", 450.0)
    far = decode(image(lighttools(row=ROW[3:], far_field=1)))
    assert far.positions_mm.tolist() == [[7.0, 8.0, 9.0]]
    assert far.directions.tolist() == [[0.0, np.float32(0.6), np.float32(0.8)]]


@pytest.mark.parametrize("changes", [{"major": 3}, {"colour": 1}, {"unit": 8}, {"flux_type": 2}, {"far_field": 2}])
def test_lighttools_binary_refuses_what_it_does_not_know(changes):
    with pytest.raises(InputError, match="export it so, or as TM-25"):
        decode(image(lighttools(**changes)))


def test_lighttools_text_with_carriage_returns_and_long_exponents():
    content = (
        "# LightTools\r\nlt_rdf_version: 2.0\r\nlt_datatype: luminous_flux\r\nlt_far_field_data: no\r\n"
        "lt_color_info: none\r\nlt_length_units: centimeters\r\nlt_radiant_flux: 4\r\nlt_startofdata\r\n"
        " 1.5e-016 2 3 0 0 1 0.5\r\n 4 5 6 0 0 1 0.25\r\nlt_endofdata"
    )
    rayfile = decode(image(content.encode()))
    np.testing.assert_allclose(rayfile.positions_mm, [[1.5e-15, 20, 30], [40, 50, 60]])
    assert (rayfile.flux_unit, rayfile.total_flux()) == ("lm", 4.0)
    mm = {"system": 1, "millimeters": 1, "centimeters": 10, "meters": 1e3, "inches": 25.4, "feet": 304.8}
    for unit, length in (mm | {"microns": 1e-3, "micrometers": 1e-3, "nanometers": 1e-6}).items():
        positions_mm = decode(image(content.replace("centimeters", unit).encode())).positions_mm
        np.testing.assert_allclose(positions_mm[:, 1:], length * np.array([[2, 3], [5, 6]]), rtol=1e-6, err_msg=unit)
    for old, new, message in (
        ("luminous_flux", "photons", "lt_datatype: photons"),
        ("centimeters", "furlongs", "lt_length_units: furlongs"),
        ("lt_color_info: none", "lt_color_info: wavelength", "rows of 7 numbers"),
        ("lt_endofdata", "", "truncated"),
        (" 4 5 6", " 4 5 x", "line 10, column 3: 'x' is no number"),
    ):
        with pytest.raises(InputError, match=message):
            decode(image(content.replace(old, new).encode()))


def test_speos_weights_are_scaled_by_the_header():
    rows = struct.pack("<16f", *ROW[:6], 550.0, 1.0, *ROW[:6], 450.0, 3.0)
    rayfile = decode(image(struct.pack("<7f", 8.0, *(2.0,) * 5, 100.0) + rows))
    assert (rayfile.flux_unit, rayfile.total_flux(), rayfile.header_flux_lm) == ("W", 8.0, 100.0)
    assert rayfile.header_role == "scale"  # weights that disagree with the header are no fault of the file
    np.testing.assert_allclose(next(rayfile.absolute_blocks(8.0)).flux, [2.0, 6.0])


def test_csv_names_its_columns_in_any_order():
    content = b"\xef\xbb\xbf# made by hand\nflux_lm,kx,ky,kz,x_mm,y_mm,z_mm,remark\n0.5,0,0,1,1,2,3,7\n"
    with pytest.raises(InputError, match=r"line 2: no column kx; found 'flux_lm', 'ex', 'ky'"):
        decode(image(content.replace(b"kx", b"ex")))
    with pytest.raises(InputError, match="none of the known"):
        decode(image(content.replace(b"k", b"e")))
    rayfile = decode(image(content))
    assert rayfile.positions_mm.tolist() == [[1.0, 2.0, 3.0]]
    assert (rayfile.flux_unit, rayfile.flux[0]) == ("lm", 0.5)
    with pytest.raises(InputError, match="exactly one"):
        decode(image(content.replace(b"remark", b"flux_w")))


def test_a_format_that_is_not_public_is_refused_with_what_to_export():
    """Five records of 28 bytes and a ray: the binary layout of ASAP."""
    records = [
        struct.pack("<7i", 1024 * 7 + 247, 1, 2, 3, 4, 5, 6),
        struct.pack("<24si", b"blue die".ljust(24), 9),
        struct.pack("<8sf16s", b"z label", 1.5, b"f label"),
        struct.pack("<16s2fi", b"y label", -1.0, 1.0, -1),
        struct.pack("<16s2fi", b"x label", -1.0, 1.0, 7),
    ]
    content = b"".join(records) + struct.pack("<7f", *ROW)
    with pytest.raises(InputError, match=r"none of the known formats.*export TM-25 \(\.tm25ray\), LightTools or Zemax"):
        decode(image(content))


def test_speos_text_by_hand():
    content = b"2\r\n1 0 1 2 0 0 1 450 0.5\r\n2 3 4 5 0 1 0 0.6 1.5\r\n"
    rayfile = decode(image(content))
    assert rayfile.positions_mm.tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert rayfile.directions.tolist() == [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    assert (rayfile.wavelengths_nm.tolist(), rayfile.flux.tolist()) == ([450.0, 0.6], [0.5, 1.5])
    polarised = decode(image(b"1\n1 0 1 2 0 0 1 450 0.5 1 2 3 4 5\n"))
    assert any("columns 10 to 14" in warning for warning in polarised.warnings)
    with pytest.raises(InputError, match="promises 3 rays, the file holds 2"):
        decode(image(content.replace(b"2\r", b"3\r", 1)))
