"""Ray files from anywhere, and names that are none: refused in one line, quickly and without memory, or read right.

The broad search is test_hostile_files.py.
"""

from pathlib import Path

import pytest
from click.testing import CliRunner
from refusals import one_line

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.sources.build_source import build_source
from lensforge.sources.rayfiles.ray_file_io import read_rayfile
from lensforge.sources.rayfiles.ray_file_statistics import describe

CSV = "x_mm,y_mm,z_mm,kx,ky,kz,flux_w\n"


def _csv(path: Path, *rows: str) -> Path:
    path.write_text(CSV + "".join(f"{row}\n" for row in rows))
    return path


def test_a_conversion_never_replaces_the_file_itself(tmp_path):
    file = _csv(tmp_path / "led.csv", "0,0,0,0,0,1,1")
    before = file.read_bytes()
    (tmp_path / "link.csv").symlink_to(file)
    for name in ("led.csv", "link.csv"):
        found = CliRunner().invoke(cli, ["rays", str(file), "--to", str(tmp_path / name), "--format", "csv"])
        assert isinstance(found.exception, InputError) and "is the file itself" in str(found.exception)
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


def test_parts_of_a_source_that_hold_none_of_its_light_are_refused(tmp_path):
    parts = [_csv(tmp_path / "a.csv", "0,0,0,0,0,1,1"), _csv(tmp_path / "b.csv", "0,0,0,0,0,1,1e-15")]
    source = lf.RayfilesSource(files=[{"file": part} for part in parts])
    with pytest.raises(InputError, match=r"files\[1\] \(b.csv\): 1e-15 of the flux"):
        build_source(source)
