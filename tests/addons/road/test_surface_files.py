"""Files of a road's surface: where its angles stand, and from where its name counts."""

from pathlib import Path

import numpy as np
import pytest

from lensforge.addons.road.road_section import load_roads
from lensforge.addons.road.road_surface import read_surface
from lensforge.errors import InputError


def _written(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text)
    return path


TABLE = "0,2,180\n0,700,700,700\n1,300,200,100\n"


def test_a_road_has_its_angles_in_a_remark_and_no_gamma_for_its_tangent(tmp_path: Path) -> None:
    wanted = read_surface(_written(tmp_path, rf"tan_gamma\beta,{TABLE}"))
    table = read_surface(_written(tmp_path, rf"# tan_gamma\beta,{TABLE}"))
    np.testing.assert_array_equal(table.beta_deg, [0.0, 2.0, 180.0])
    np.testing.assert_array_equal(table.r, wanted.r)
    for mark in ("", "# "):
        with pytest.raises(InputError, match="rows must be those of tan gamma, not of gamma"):
            read_surface(_written(tmp_path, rf"{mark}gamma\beta,{TABLE}"))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,2,170\n0,700,700,700\n1,300,200,100\n", "beta ends at 170 degrees, must end at 180, .* behind the eye$"),
        ("0,1,2\n0,700,700,700\n180,300,200,100\n", "beta ends at 2 degrees, .*; rows and columns are swapped"),
        ("0,2,180\n0,700,700,700\n", "no r-table; give a row of beta from 0 to 180, then rows of tan gamma"),
        ("1,2,180\n0,700,700,700\n1,300,200,100\n", "beta must begin with 0 and rise, .*; found 1, 2"),
        ("0,9,2,180\n0,7,7,7,7\n1,3,2,1,1\n", "beta must begin with 0 and rise, .*; found 9, 2"),
        ("0,2,180\n0.5,700,700,700\n1,300,200,100\n", "tan gamma must begin with 0 and rise, .*; found 0.5, 1"),
        ("0,2,180\n0,700,700,700\n1,300,,100\n", "no number at tan gamma = 1, beta = 2, but some beyond it; give it"),
    ],
)
def test_a_table_of_a_road_is_refused_by_what_it_lacks(rows: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_surface(_written(tmp_path, rf"tan_gamma\beta,{rows}"))
    assert "\n" not in str(caught.value)


def test_the_wet_surface_of_a_road_is_the_one_beside_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    road = 'lighting_class="M3"\nwidth_m=7.0\npole_height_m=9.0\npole_spacing_m=30.0\nwet_surface_file="wet.csv"\n'
    for folder in ("sub", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "wet.csv").write_text(folder)
    (tmp_path / "sub" / "r.toml").write_text(f"[[roads]]\n{road}[[roads]]\n{road}")
    monkeypatch.chdir(tmp_path / "other")
    assert [road.wet_surface_file for road in load_roads(Path("../sub/r.toml"))] == [tmp_path / "sub" / "wet.csv"] * 2
