import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from result_folders import CONTENT, evaluate_arrays, make_folder, small_lens

from lensforge.cli import cli
from lensforge.errors import InputError
from lensforge.report.compare import build_comparison, difference_lines, names_of, number_lines
from lensforge.report.compare_pictures import ComparedPictures
from lensforge.report.drawing import to_svg
from lensforge.report.results import load_results


@pytest.fixture
def folders(tmp_path):
    """Two designs: the second has half the light on a receiver of twice the side, and a better NMSE."""
    first = make_folder(tmp_path / "first")
    second = make_folder(tmp_path / "second", lens=small_lens(outer_mm=9.0))
    images = evaluate_arrays()
    images["irradiance"] = 0.5 * images["irradiance"]
    np.savez(second / "evaluate.npz", **images)
    (second / "evaluate.json").write_text(
        json.dumps({**CONTENT["evaluate"], "nmse": 0.0023, "receiver_mm": 600.0}), encoding="utf-8"
    )
    return first, second


def drawn(monkeypatch, make):
    """The figures behind the pictures that ``make`` returns."""
    figures = []

    def keep(figure, name, title):
        figures.append(figure)
        return to_svg(figure, name, title)

    monkeypatch.setattr("lensforge.report.pictures.to_svg", keep)
    make()
    return figures


def test_the_page_holds_both_designs_and_needs_nothing_else(folders, tmp_path):
    markup = build_comparison(folders, tmp_path / "compare.html").read_text(encoding="utf-8")
    assert markup.count("<svg") == 2 + 3 + 2
    assert "<script" not in markup
    assert not re.search(r"""(src|href)=["'](?!#|data:)""", markup)
    ids = re.findall(r'\bid="([^"]+)"', markup)
    assert len(ids) == len(set(ids))
    for name in ("first", "second"):
        assert markup.count(f"<h4>{name}</h4>") == 3


def test_numbers_stand_side_by_side_and_the_better_is_marked(folders):
    lines = {line.name: line.cells for line in number_lines([load_results(folder) for folder in folders])}
    assert [cell.text for cell in lines["NMSE"]] == ["0.0123", "0.0023"]
    assert [cell.best for cell in lines["NMSE"]] == [False, True]
    assert not any(cell.best for cell in lines["Efficiency"]), "they are the same"
    three = number_lines([load_results(folders[index]) for index in (0, 1, 1)])
    assert [cell.best for cell in three[0].cells] == [False, True, True]
    assert not any(cell.best for cell in lines["Lens radius"]), "no radius is better whatever the spec"


def test_a_stage_that_one_has_not_run_leaves_a_gap(folders):
    (folders[1] / "evaluate.json").unlink()
    designs = [load_results(folder) for folder in folders]
    cells = next(line.cells for line in number_lines(designs) if line.name == "NMSE")
    assert [cell.text for cell in cells] == ["0.0123", "–"]
    assert len(ComparedPictures(("a", "b"), designs).maps) == 1


def test_only_what_differs_in_the_specs_is_listed(folders):
    lines = difference_lines([load_results(folder) for folder in folders])
    assert [(line.name, [cell.text for cell in line.cells]) for line in lines] == [
        ("lens.outer_offset_mm", ["10 mm", "9 mm"])
    ]


def test_maps_share_colours_and_millimetres(folders, monkeypatch):
    designs = [load_results(folder) for folder in folders]
    first, second = drawn(monkeypatch, lambda: ComparedPictures(("a", "b"), designs).maps)
    assert first.axes[0].images[0].get_clim() == second.axes[0].images[0].get_clim()
    assert first.axes[0].images[0].get_clim()[1] == designs[0].images["irradiance"].max()
    assert first.axes[0].get_xlim() == second.axes[0].get_xlim() == (-300.0, 300.0)
    assert first.axes[0].images[0].get_extent() == [-150.0, 150.0, -150.0, 150.0]


def test_designs_too_far_apart_have_a_scale_each(folders, tmp_path, monkeypatch):
    images = evaluate_arrays()
    images["irradiance"] = 0.01 * images["irradiance"]
    np.savez(folders[1] / "evaluate.npz", **images)
    designs = [load_results(folder) for folder in folders]
    first, second = drawn(monkeypatch, lambda: ComparedPictures(("a", "b"), designs).maps)
    for figure, design in ((first, designs[0]), (second, designs[1])):
        assert figure.axes[0].images[0].get_clim()[1] == design.images["irradiance"].max()
        assert figure.axes[0].get_xlim()[1] == 0.5 * design.evaluate.receiver_mm
    assert "Each map has its own colours" in build_comparison(folders, tmp_path / "both.html").read_text(
        encoding="utf-8"
    )


def test_lux_only_where_all_know_their_lumens(folders, tmp_path, monkeypatch):
    bright = make_folder(tmp_path / "bright", lens=small_lens(lumens_per_watt=300.0))
    brighter = make_folder(tmp_path / "brighter", lens=small_lens(lumens_per_watt=400.0))
    for pair, label, top in (
        ((folders[0], bright), "irradiance (W/m²)", 1.0),
        ((bright, brighter), "illuminance (lx)", 400.0),
    ):
        designs = [load_results(folder) for folder in pair]
        figures = drawn(monkeypatch, lambda designs=designs: ComparedPictures(("a", "b"), designs).maps)
        assert [figure.axes[1].get_ylabel() for figure in figures] == [label, label]
        tops = [figure.axes[0].images[0].get_clim()[1] for figure in figures]
        assert tops == pytest.approx([top * designs[0].images["irradiance"].max()] * 2)


def test_sections_are_drawn_to_one_scale(folders, monkeypatch):
    designs = [load_results(folder) for folder in folders]
    first, second = drawn(monkeypatch, lambda: ComparedPictures(("a", "b"), designs).sections)
    assert first.axes[0].get_xlim() == second.axes[0].get_xlim()
    assert first.axes[0].get_ylim() == second.axes[0].get_ylim()


def test_folders_of_one_name_are_told_apart(tmp_path):
    pair = [load_results(make_folder(tmp_path / side / "lens", stages=())) for side in ("left", "right")]
    assert names_of(pair) == [str(tmp_path / "left" / "lens"), str(tmp_path / "right" / "lens")]


def test_one_folder_twice_or_alone_is_refused(folders, tmp_path):
    with pytest.raises(InputError, match="twice"):
        build_comparison([folders[0], folders[0] / "."], tmp_path / "compare.html")
    with pytest.raises(InputError, match="from 2 to 8"):
        build_comparison([folders[0]], tmp_path / "compare.html")


def test_the_command_writes_the_page_where_it_is_told(folders, tmp_path):
    page = tmp_path / "pages" / "both.html"
    done = CliRunner().invoke(cli, ["report", *map(str, folders), "--out", str(page)], catch_exceptions=False)
    assert done.output == f"report\t{page}\n"
    assert page.exists()
    with pytest.raises(InputError, match="--out"):
        CliRunner().invoke(cli, ["report", str(folders[0]), "--out", str(page)], catch_exceptions=False)
