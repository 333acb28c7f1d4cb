"""Ray files from anywhere, and names that are none: refused in one line, quickly and without memory, or read right.

The broad search is test_hostile_files.py.
"""

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from refusals import one_line

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_file_statistics import describe
from lensforge.sources.rayfiles.ray_file_io import read_rayfile

CSV = "x_mm,y_mm,z_mm,kx,ky,kz,flux_w\n"
TM25_TABLES = 36_288
MIB = 2**20


def _csv(path: Path, *rows: str) -> Path:
    path.write_text(CSV + "".join(f"{row}\n" for row in rows))
    return path


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


def test_a_conversion_never_replaces_the_file_itself(tmp_path):
    file = _csv(tmp_path / "led.csv", "0,0,0,0,0,1,1")
    before = file.read_bytes()
    (tmp_path / "link.csv").symlink_to(file)
    for name in ("led.csv", "link.csv"):
        result = CliRunner().invoke(cli, ["rays", str(file), "--to", str(tmp_path / name), "--format", "csv"])
        assert isinstance(result.exception, InputError) and "is the input file" in str(result.exception)
    assert file.read_bytes() == before


def test_fluxes_that_are_next_to_nothing_are_dropped_and_counted(tmp_path):
    file = _csv(tmp_path / "led.csv", "0,0,0,0,0,1,1e-320", "0,0,0,0,0,1,2.4e-38", "0,0,0,0,0,1,2")
    summary = describe(read_rayfile(file))
    assert (summary.rays_dropped.no_flux, summary.rays_used, summary.flux.total) == (2, 1, 2.0)
    with pytest.raises(InputError, match="none of its 1 rays is usable \\(1 no flux\\)"):
        describe(read_rayfile(_csv(tmp_path / "dark.csv", "0,0,0,0,0,1,1e-320")))


def test_rays_that_add_up_to_more_than_any_light_are_refused(tmp_path):
    file = _csv(tmp_path / "led.csv", *["0,0,0,0,0,1,9e11"] * 2)
    with pytest.raises(InputError, match=r"add up to 1\.8e\+12 W") as refusal:
        describe(read_rayfile(file))
    one_line(refusal)
    with pytest.raises(InputError, match="add up"):
        build_source(lf.RayfileSource(file=file))


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
    for name, (content, message) in lies.items():
        (tmp_path / name).write_bytes(content)
        tracemalloc.start()
        with pytest.raises(InputError, match=message) as refusal:
            read_rayfile(tmp_path / name)
        assert tracemalloc.get_traced_memory()[1] < 2 * MIB, name
        tracemalloc.stop()
        one_line(refusal)


def test_spectral_tables_of_more_pairs_than_any_spectrum_are_refused(tmp_path):
    pairs = np.stack([np.linspace(400.0, 700.0, 1_000_001), np.ones(1_000_001)], axis=1).astype("<f4").tobytes()
    (tmp_path / "long").write_bytes(_tm25(tables=1, block=struct.pack("<i", 1_000_001) + pairs, rows=ONE_RAY))
    with pytest.raises(InputError, match="have 1000001 pairs or more, at most 1000000"):
        read_rayfile(tmp_path / "long")


def test_parts_of_a_source_that_hold_none_of_its_light_are_refused(tmp_path):
    parts = [_csv(tmp_path / "a.csv", "0,0,0,0,0,1,1"), _csv(tmp_path / "b.csv", "0,0,0,0,0,1,1e-15")]
    source = lf.RayfilesSource(files=[{"file": part} for part in parts])
    with pytest.raises(InputError, match=r"files\[1\] \(b.csv\): 1e-15 of the flux"):
        build_source(source)
