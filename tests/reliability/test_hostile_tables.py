"""Spectra, archives of arrays and radiance tables that lie: refused in one line before they take memory."""

import io
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from refusals import one_line

import lensforge as lf
from lensforge.errors import InputError
from lensforge.optics.material_files import read_material
from lensforge.results.json_npz import arrays_in
from lensforge.scene.target_pattern import read_table
from lensforge.sources.build_source import build_source
from lensforge.sources.radiance_emitter import read_radiance
from lensforge.sources.source_spectrum import read_spectrum_file
from lensforge.surfaces.point_cloud import read_cloud

MIB = 2**20


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"400 1\ninf 2\n", "not all finite"),
        (b"400 1\n1e308 2\n", "not all finite"),
        (b"400 1\n5_00 2\n", "not two columns"),
        (b"OPTIS - Spectrum file v1.0\nLED\n" + b"9" * 5000 + b"\n400 1\n", "samples announced"),
        (b"1 1\n" * 500_001, "500001 lines"),
    ],
)
def test_spectra_that_lie_are_refused(content, words, tmp_path):
    (tmp_path / "x.txt").write_bytes(content)
    with pytest.raises(InputError, match=words) as refusal:
        read_spectrum_file(tmp_path / "x.txt")
    one_line(refusal)


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
    one_line(refusal)


def test_long_rows_of_a_radiance_table_are_drawn_in_smaller_blocks(tmp_path, monkeypatch):
    gamma = np.linspace(0.0, 90.0, 4096)
    file = _radiance(tmp_path / "x.npz", gamma_deg=gamma, radiance=np.ones((1, 1, 1, 4096)))
    source = build_source(lf.RadianceSource(file=file))
    rays = source.sample(4096, 1)
    monkeypatch.setattr("lensforge.sources.radiance_emitter._BLOCK_NUMBERS", 2**40)
    assert np.array_equal(source.sample(4096, 1).directions, rays.directions)


@pytest.mark.parametrize("read", [read_spectrum_file, read_cloud, read_table, lf.load_spec, read_material])
@pytest.mark.parametrize(
    "content",
    [
        "hunter2\n",
        "hunter2:x:0\n",
        "1 hunter2 3\n",
        "[hunter2\n",
        "'hunter2\n",
        "a: *hunter2\n",
        'api_key = "hunter2"\n',
    ],
)
def test_a_file_that_is_something_else_is_not_quoted(read: Callable[..., object], content: str, tmp_path: Path) -> None:
    """A path may name another file than was meant: its content belongs into no message and no log."""
    for suffix in (".yml", ".csv") if read is read_material else (".csv",):
        path = tmp_path / f"other{suffix}"
        path.write_text(content)
        with pytest.raises(InputError) as refusal:
            read(path, "glass") if read is read_material else read(path)
        assert "hunter2" not in str(refusal.value)


@pytest.mark.parametrize("largest", [1e308, 1.1e30, 0.9e-30])
def test_tables_of_light_beyond_all_light_are_refused(largest: float, tmp_path: Path) -> None:
    (tmp_path / "light.csv").write_text(f"{largest}, 0\n0, {largest}\n")
    with pytest.raises(InputError, match="its largest from 1e-30 to 1e\\+30") as refusal:
        read_table(tmp_path / "light.csv")
    one_line(refusal)
    (tmp_path / "light.csv").write_text("1e30, 0\n")
    assert read_table(tmp_path / "light.csv").max() == 1e30
