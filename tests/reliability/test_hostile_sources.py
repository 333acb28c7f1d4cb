"""Files of light from anywhere: rays, far fields, spectra and radiance tables that lie, and names that are none.

Each is refused in one line, quickly and without memory, or read for what it is; the broad search is test_fuzz.py.
"""

import io
import os
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import lensforge as lf
from lensforge.cli import cli
from lensforge.errors import InputError
from lensforge.npz_file import arrays_in
from lensforge.sources.build import build_source, summarise
from lensforge.sources.inspection import inspect
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric.conversion import convert_photometric
from lensforge.sources.radiance_table import read_radiance
from lensforge.sources.rayfiles import describe, read_rayfile
from lensforge.sources.rayfiles.plot import Histograms
from lensforge.sources.spectrum_file import read_spectrum_file

CSV = "x_mm,y_mm,z_mm,kx,ky,kz,flux_w\n"
TM25_TABLES = 36_288
MIB = 2**20


def _csv(path: Path, *rows: str) -> Path:
    path.write_text(CSV + "".join(f"{row}\n" for row in rows))
    return path


def _one_line(refusal: pytest.ExceptionInfo[InputError]) -> str:
    line = str(refusal.value)
    assert line.isprintable() and len(line) < 600
    return line


def _tm25(rays: int = 1, tables: int = 0, extra: int = 0, block: bytes = b"", rows: bytes = b"") -> bytes:
    nan = float("nan")
    flags = (1, 1, 1, 0, 0, 0, 0, 0)
    fixed = struct.pack(
        "<4s2i2fQ28s2i3f3i168x8i", b"TM25", 2013, 0, nan, 1.0, rays, b"", 0, 3 if tables else 0, nan, nan, nan,
        tables, extra, 0, *flags,
    )  # fmt: skip
    padded = block.ljust(-(-len(block) // 32) * 32, b"\0")
    return fixed.ljust(TM25_TABLES, b"\0") + padded + rows


ONE_RAY = np.array([0, 0, 0, 0, 0, 1, 1], dtype="<f4").tobytes()


# What is no file


READERS = {
    "rays": read_rayfile,
    "photometric": read_photometric,
    "spectrum": read_spectrum_file,
    "radiance": read_radiance,
    "spec": lf.load_spec,
}


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_what_is_no_regular_file_is_refused_without_waiting_for_it(reader, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, words in (
        (tmp_path / "pipe", "pipe"),
        (Path("/dev/zero"), "device"),
        (tmp_path, "folder"),
        (tmp_path / "none", "no such file"),
        (tmp_path / "a\0b", "cannot be read"),
        (tmp_path / ("x" * 5000), "cannot be read"),
    ):
        with pytest.raises(InputError, match=words) as refusal:
            reader(path)
        _one_line(refusal)


def test_the_command_says_so_too(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    found = CliRunner().invoke(cli, ["rays", str(tmp_path / "pipe")])
    assert isinstance(found.exception, InputError) and "a pipe, must be a file" in str(found.exception)


def test_a_conversion_never_replaces_the_file_itself(tmp_path):
    file = _csv(tmp_path / "led.csv", "0,0,0,0,0,1,1")
    before = file.read_bytes()
    (tmp_path / "link.csv").symlink_to(file)
    for name in ("led.csv", "link.csv"):
        found = CliRunner().invoke(cli, ["rays", str(file), "--to", str(tmp_path / name), "--format", "csv"])
        assert isinstance(found.exception, InputError) and "is the file itself" in str(found.exception)
    assert file.read_bytes() == before


# Ray files


def test_fluxes_that_are_next_to_nothing_are_dropped_and_counted(tmp_path):
    file = _csv(tmp_path / "led.csv", "0,0,0,0,0,1,1e-320", "0,0,0,0,0,1,2.4e-38", "0,0,0,0,0,1,2")
    summary = describe(read_rayfile(file))
    assert (summary.rays_dropped.no_flux, summary.rays_used, summary.flux.total) == (2, 1, 2.0)
    with pytest.raises(InputError, match="none of its 1 rays is usable \\(1 no flux\\)"):
        describe(read_rayfile(_csv(tmp_path / "dark.csv", "0,0,0,0,0,1,1e-320")))


def test_positions_beyond_all_measure_are_dropped_in_sums_and_plots(tmp_path):
    file = _csv(tmp_path / "led.csv", "1e308,0,0,0,0,1,1", "-1e308,0,0,0,0,1,1", "0,0,0,0,1e308,1,1", "1,2,0,0,0,1,1")
    rayfile = read_rayfile(file)
    summary = describe(rayfile)
    assert (summary.rays_dropped.not_finite, summary.bounding_box_mm.min) == (3, (1.0, 2.0, 0.0))
    assert Histograms.of(rayfile).front.sum() == 1.0


def test_rays_far_from_the_origin_are_drawn(tmp_path):
    found = Histograms.of(read_rayfile(_csv(tmp_path / "far.csv", "9e11,0,0,0,0,1,1", "9e11,0,0,0,0,1,2")))
    assert found.front.sum() == found.side.sum() == 3.0


def test_rays_that_add_up_to_more_than_any_light_are_refused(tmp_path):
    file = _csv(tmp_path / "led.csv", *["0,0,0,0,0,1,9e11"] * 2)
    with pytest.raises(InputError, match=r"add up to 1\.8e\+12 W") as refusal:
        describe(read_rayfile(file))
    _one_line(refusal)
    with pytest.raises(InputError, match="add up"):
        build_source(lf.RayfileSource(file=file))


@pytest.mark.parametrize("name", ["$\\frac{$_^.csv", "é\u202e\x07.csv"])
def test_a_plot_shows_any_file_name_as_it_stands(name, tmp_path):
    file = _csv(tmp_path / name, "0,0,0,0,0,1,1", "1,0,0,0,0.1,1,1")
    found = CliRunner().invoke(cli, ["rays", str(file), "--plot", str(tmp_path / "plot.svg")])
    assert found.exception is None
    assert (tmp_path / "plot.svg").stat().st_size > 10_000


def test_counts_in_headers_take_no_memory(tmp_path):
    huge = 10**18
    lies = {
        "rays": (_tm25(rays=huge, rows=ONE_RAY), "make 28000000000000036288 bytes"),
        "tables": (_tm25(tables=2**31 - 1, rows=ONE_RAY), "2147483647 spectral tables"),
        "extra": (_tm25(extra=2**31 - 1, rows=ONE_RAY), "2147483647 extra columns"),
        "pairs": (_tm25(tables=1, block=struct.pack("<i", 2**30), rows=ONE_RAY), "claims 1073741824 pairs"),
        "spectrum": (_tm25(tables=1, block=struct.pack("<i2f", 1, 1e38, 1.0), rows=ONE_RAY), "not finite and below"),
        "speos": (b"1e300\n1 0 0 0 0 0 1 500 1\n2 0 0 0 0 0 1 500 1\n", r"promises 1e\+300 rays"),
    }
    for name, (content, words) in lies.items():
        (tmp_path / name).write_bytes(content)
        tracemalloc.start()
        with pytest.raises(InputError, match=words) as refusal:
            read_rayfile(tmp_path / name)
        assert tracemalloc.get_traced_memory()[1] < 2 * MIB, name
        tracemalloc.stop()
        _one_line(refusal)


def test_spectral_tables_of_more_pairs_than_any_spectrum_are_refused(tmp_path):
    pairs = np.stack([np.linspace(400.0, 700.0, 1_000_001), np.ones(1_000_001)], axis=1).astype("<f4").tobytes()
    (tmp_path / "long").write_bytes(_tm25(tables=1, block=struct.pack("<i", 1_000_001) + pairs, rows=ONE_RAY))
    with pytest.raises(InputError, match="have 1000001 pairs or more, at most 1000000"):
        read_rayfile(tmp_path / "long")


def test_text_lines_without_an_end_are_refused(tmp_path):
    (tmp_path / "long.csv").write_bytes(CSV.encode() + b"0," * (9 * MIB))
    with pytest.raises(InputError, match="more than 16777216 bytes"):
        read_rayfile(tmp_path / "long.csv")
    (tmp_path / "mac.txt").write_bytes(b"1 4 0 0\r0 0 0 0 0 1 1\r")
    with pytest.raises(InputError, match="none of the known formats"):
        read_rayfile(tmp_path / "mac.txt")


def test_parts_of_a_source_that_hold_none_of_its_light_are_refused(tmp_path):
    parts = [_csv(tmp_path / "a.csv", "0,0,0,0,0,1,1"), _csv(tmp_path / "b.csv", "0,0,0,0,0,1,1e-15")]
    source = lf.RayfilesSource(files=[{"file": part} for part in parts])
    with pytest.raises(InputError, match=r"files\[1\] \(b.csv\): 1e-15 of the flux"):
        build_source(source)


@pytest.mark.parametrize("width", [1e-6, 1e9])
def test_chips_of_any_size_have_an_outline(width):
    chips = [{"x_mm": x, "y_mm": 0.0, "width_mm": width, "height_mm": 1e-6} for x in (-1e9, 1e9)]
    source = build_source(lf.ChipsSource(chips=chips))
    assert np.isfinite(source.outline()).all()


# Photometric files


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
    _one_line(refusal)


def test_eulumdat_is_read_where_it_is_sound(tmp_path):
    (tmp_path / "x.ldt").write_text(_ldt())
    assert read_photometric(tmp_path / "x.ldt").intensity.values.tolist() == [[300.0, 200.0, 0.0]]


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
    _one_line(refusal)


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
        inspect(tmp_path / "x.ies").warnings,
        summarise(build_source(section), section).warnings,
        summarise(build_source(placed), placed).warnings,
    ):
        assert any(words in warning for warning in warnings), warnings


def test_one_half_plane_at_0_and_360_is_light_of_revolution(tmp_path):
    text = _ies(head="1 1000 1 3 2 1 2 0 0 0 1 1 10", angles="0 45 90 0 360", candela="300 200 0 300 200 0")
    (tmp_path / "x.ies").write_text(text)
    assert read_photometric(tmp_path / "x.ies").intensity.c_deg.tolist() == [0.0]
    convert_photometric(tmp_path / "x.ies", tmp_path / "x.ldt")


def test_a_line_break_in_the_name_of_a_file_adds_no_line_to_another(tmp_path):
    file = tmp_path / "a\nTILT=NONE\n1 1.ies"
    file.write_text(_ies())
    convert_photometric(file, tmp_path / "x.ldt")
    assert read_photometric(tmp_path / "x.ldt").intensity.values.shape == (1, 3)


# Spectra and radiance tables


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"400 1\ninf 2\n", "not all finite"),
        (b"400 1\n1e308 2\n", "not all finite"),
        (b"400 1\n5_00 2\n", "not two columns"),
        (b"OPTIS - Spectrum file v1.0\nLED\n" + b"9" * 5000 + b"\n400 1\n", "number of its samples"),
        (b"OPTIS - Spectrum file v1.0\nLED\n\xb2\n400 1\n500 1\n", "number of its samples"),
        (b"1 1\n" * 500_001, "500001 lines"),
    ],
)
def test_spectra_that_lie_are_refused(content, words, tmp_path):
    (tmp_path / "x.txt").write_bytes(content)
    with pytest.raises(InputError, match=words) as refusal:
        read_spectrum_file(tmp_path / "x.txt")
    _one_line(refusal)


def _npy(header: str, data: bytes = b"\0" * 8) -> bytes:
    line = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(line).to_bytes(2, "little") + line + data


def _npz(method=zipfile.ZIP_STORED, **members: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return stream.getvalue()


def _head(descr="'<f8'", shape="(1,)") -> str:
    return f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (_npz(a=_npy(_head(shape="(10**18,)"))), "malformed"),
        (_npz(a=_npy(_head(shape=f"({10**18},)"))), "claims the shape"),
        (_npz(a=_npy(_head(shape="(-1, -1)"))), "claims the shape"),
        (_npz(a=_npy(_head(descr="'|O'"))), "type object"),
        (_npz(a=_npy(_head(descr="'<c16'"), b"\0" * 16)), "type complex128"),
        (_npz(a=_npy("(" * 5000)), "."),
        (_npz(a=b"\x93NUMPY\x07\x00xx"), "."),
        (_npz(zipfile.ZIP_LZMA, a=_npy(_head())), "packed by method 14"),
        (_npz(zipfile.ZIP_DEFLATED, a=_npy(_head(shape="(20000000,)"), b"\0" * 160_000_000)), "bytes unpacked"),
        (_npz(**{f"a{k}": b"" for k in range(1001)}), "more than 1000 arrays"),
        (_npz(a=_npy(_head()))[:-30], "zip"),
        (b"", "zip"),
    ],
)
def test_archives_that_lie_are_refused_before_they_are_unpacked(content, words):
    tracemalloc.start()
    with pytest.raises(ValueError, match=f"(?i){words}") as refusal:
        arrays_in(content, ["a"], 100 * MIB)
    assert tracemalloc.get_traced_memory()[1] < 4 * MIB
    tracemalloc.stop()
    assert "\n" not in str(refusal.value) and len(str(refusal.value)) < 200


def test_archives_of_numpy_are_read_in_any_order_and_type():
    stream = io.BytesIO()
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.asfortranarray(np.eye(3)),
        "c": np.float64(2),
        "d": np.arange(3),
    }
    np.savez_compressed(stream, **arrays, other=np.array(["x"]))
    found = arrays_in(stream.getvalue(), [*arrays, "missing"], MIB)
    assert found.keys() == arrays.keys()
    assert all(np.array_equal(found[name], arrays[name]) for name in arrays)


def _radiance(path: Path, **changes: np.ndarray) -> Path:
    table = {
        "x_mm": [0.0, 1.0],
        "y_mm": [0.0, 1.0],
        "c_deg": [0.0],
        "gamma_deg": [0.0, 90.0],
        "radiance": [[[[1.0, 1.0]]]],
    }
    np.savez(path, **{name: np.asarray(value, dtype=float) for name, value in (table | changes).items()})
    return path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"radiance": [[[[1e308, 1e308]]]]}, "below 1e"),
        ({"radiance": [[[[np.nan, 1.0]]]]}, "finite"),
        ({"radiance": [[[[1e-320, 0.0]]]]}, "its flux is"),
        ({"x_mm": [0.0, 1e308]}, "1e\\+308"),
        ({"gamma_deg": np.linspace(0, 90, 5000), "radiance": np.ones((1, 1, 1, 5000))}, "5000 numbers"),
    ],
)
def test_radiance_tables_beyond_all_light_are_refused(changes, words, tmp_path):
    with pytest.raises(InputError, match=words) as refusal:
        read_radiance(_radiance(tmp_path / "x.npz", **changes))
    _one_line(refusal)


def test_long_rows_of_a_radiance_table_are_drawn_in_smaller_blocks(tmp_path, monkeypatch):
    gamma = np.linspace(0.0, 90.0, 4096)
    file = _radiance(tmp_path / "x.npz", gamma_deg=gamma, radiance=np.ones((1, 1, 1, 4096)))
    source = build_source(lf.RadianceSource(file=file))
    rays = source.sample(4096, 1)
    monkeypatch.setattr("lensforge.sources.radiance._BLOCK_NUMBERS", 2**40)
    assert np.array_equal(source.sample(4096, 1).directions, rays.directions)


# Numbers of a script


@pytest.mark.parametrize("column", range(7))
@pytest.mark.parametrize("value", [1e308, 1e31, 1e13, 1e-320, 5e-324])
def test_given_rays_of_any_number_are_counted_or_refused(column, value):
    rays = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]] * 3)
    rays[0, column] = value
    if value >= 1e31 or (value < 1e-30 and column < 3):  # the only start that is not 0
        with pytest.raises(InputError, match="as its largest number"):
            lf.RaySource(rays)
        return
    section = lf.RaySource(rays)
    source = build_source(section)
    unused = 0 if value < 1.0 and column < 5 else 1  # a start or a slope of next to nothing is as good as 0
    assert (len(source), summarise(source, section).rays) == (3 - unused, 3)
    assert np.isfinite(source.rays.origins).all() and source.rays.flux.sum() == pytest.approx(source.flux_w)
