"""Ray files from anywhere, and names that are none: refused in one line, quickly and without memory, or read right.

The broad search is test_hostile_files.py.
"""

import os
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
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.photometric import read_photometric
from lensforge.sources.radiance_emitter import read_radiance
from lensforge.sources.rayfiles.ray_file_io import read_rayfile
from lensforge.sources.rayfiles.ray_file_statistics import describe
from lensforge.sources.rayfiles.ray_file_summary import Histograms
from lensforge.sources.source_spectrum import read_spectrum_file

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
        one_line(refusal)


def test_a_conversion_never_replaces_the_file_itself(tmp_path):
    file = _csv(tmp_path / "led.csv", "0,0,0,0,0,1,1")
    before = file.read_bytes()
    (tmp_path / "link.csv").symlink_to(file)
    for name in ("led.csv", "link.csv"):
        found = CliRunner().invoke(cli, ["rays", str(file), "--to", str(tmp_path / name), "--format", "csv"])
        assert isinstance(found.exception, InputError) and "is the file itself" in str(found.exception)
    assert file.read_bytes() == before


# Ray files


def test_positions_beyond_all_measure_are_dropped_in_sums_and_plots(tmp_path):
    file = _csv(tmp_path / "led.csv", "1e308,0,0,0,0,1,1", "-1e308,0,0,0,0,1,1", "0,0,0,0,1e308,1,1", "1,2,0,0,0,1,1")
    rayfile = read_rayfile(file)
    summary = describe(rayfile)
    assert (summary.rays_dropped.not_finite, summary.bounding_box_mm.min) == (3, (1.0, 2.0, 0.0))
    assert Histograms.of(rayfile).front.sum() == 1.0


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
    for name, (content, words) in lies.items():
        (tmp_path / name).write_bytes(content)
        tracemalloc.start()
        with pytest.raises(InputError, match=words) as refusal:
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
