import json
import re
from dataclasses import replace

import pytest
from click.testing import CliRunner
from result_folders import evaluate_arrays, make_folder, make_results, small_lens
from undrawn import undrawn

from lensforge.errors import InputError
from lensforge.report.compare import (
    ComparedPictures,
    _best,
    difference_lines,
    folder_names,
    number_lines,
    render_comparison,
)
from lensforge.results import Fact, Metric


@pytest.fixture
def designs():
    """Two designs: the second has half the light on a receiver of twice the side, and a better NMSE."""
    half = 0.5 * evaluate_arrays()["map"]
    changes = {"map": half, "nmse": Metric(value=0.0023, standard_error=0.0004), "width": 600.0, "height": 600.0}
    return [make_results(), make_results(lens=small_lens(outer_mm=9.0), evaluate=changes)]


@pytest.mark.parametrize(
    ("key", "better"),
    [("nmse", 0), ("rsd", 0), ("efficiency", 1), ("share_in_target", 1), ("uniformity", 1), ("rays", None)],
)
def test_the_better_of_two_figures_is_the_smaller_error_or_the_larger_share(key, better):
    facts = [Fact(key, key, 0.25), Fact(key, key, 0.5)]
    assert _best(facts) == (None if better is None else facts[better].text)


def drawn(monkeypatch, make):
    """The figures behind the pictures that ``make`` returns."""
    figures = []

    def keep(figure, name, title):
        figures.append(figure)
        return ""

    monkeypatch.setattr("lensforge.report.page.to_svg", keep)
    make()
    return figures


def test_the_page_holds_both_designs_and_needs_nothing_else(designs):
    markup = render_comparison(designs, ["first", "second"])
    assert markup.count("<svg") == 2 + 3 + 2
    assert "<script" not in markup
    assert not re.search(r"""(src|href)=["'](?!#|data:)""", markup)
    ids = re.findall(r'\bid="([^"]+)"', markup)
    assert len(ids) == len(set(ids))
    for name in ("first", "second"):
        assert markup.count(f'<h2 class="first">{name}</h2>') == 1
        assert markup.count(f'<p class="title">{name}</p>') == 2


def test_numbers_stand_side_by_side_and_the_better_is_marked(designs):
    lines = {line.title: line.facts for line in number_lines(designs)}
    assert [cell.text for cell in lines["Pattern error (NMSE)"]] == ["0.01230 ± 0.00040", "0.00230 ± 0.00040"]
    assert [cell.note for cell in lines["Pattern error (NMSE)"]] == ["", "best"]
    assert [cell.text for cell in lines["Manufacture"]] == ["pass", "pass"]
    assert not any(cell.note for cell in lines["Efficiency"]), "they are the same"
    three = number_lines([designs[index] for index in (0, 1, 1)])
    assert [cell.note for cell in three[0].facts] == ["", "best", "best"]
    assert not any(cell.note for cell in lines["Outer radius"]), "no radius is better whatever the spec"


def test_none_is_the_better_of_two_targets(designs):
    first, second = designs
    spec = second.lens.spec
    wider = spec.model_copy(
        update={"target": spec.target.model_copy(update={"distance_mm": 1.5 * spec.target.distance_mm})}
    )
    other = replace(second, lens=replace(second.lens, spec=wider))
    assert not any(cell.note for line in number_lines([first, other]) for cell in line.facts)


def test_only_what_differs_in_the_specs_is_listed(designs):
    assert [(line.title, [cell.text for cell in line.facts]) for line in difference_lines(designs)] == [
        ("lens.outer.offset_mm", ["10 mm", "9 mm"])
    ]


def test_maps_share_colours_and_millimetres(designs, monkeypatch):
    first, second = drawn(monkeypatch, lambda: ComparedPictures(("a", "b"), designs).maps)
    assert first.axes[0].images[0].get_clim() == second.axes[0].images[0].get_clim()
    assert first.axes[0].images[0].get_clim()[1] == designs[0].light.map.max()
    assert first.axes[0].get_xlim() == second.axes[0].get_xlim() == (-300.0, 300.0)
    assert first.axes[0].images[0].get_extent() == [-150.0, 150.0, -150.0, 150.0]


def test_designs_too_far_apart_have_a_scale_each(designs, monkeypatch):
    faint = {"map": 0.01 * evaluate_arrays()["map"], "width": 600.0, "height": 600.0}
    pair = [designs[0], make_results(evaluate=faint)]
    first, second = drawn(monkeypatch, lambda: ComparedPictures(("a", "b"), pair).maps)
    for figure, design in ((first, pair[0]), (second, pair[1])):
        assert figure.axes[0].images[0].get_clim()[1] == design.light.map.max()
        assert figure.axes[0].get_xlim()[1] == 0.5 * design.light.first.width
    with undrawn():
        assert "Each map has its own colours" in render_comparison(pair)


def test_lux_only_where_all_know_their_lumens(designs, monkeypatch):
    bright, brighter = (make_results(lens=small_lens(lumens_per_watt=efficacy)) for efficacy in (300.0, 400.0))
    for pair, label, top in (
        ((designs[0], bright), "irradiance (W/m²)", 1.0),
        ((bright, brighter), "illuminance (lx)", 400.0),
    ):
        figures = drawn(monkeypatch, lambda pair=pair: ComparedPictures(("a", "b"), pair).maps)
        assert [figure.axes[1].get_ylabel() for figure in figures] == [label, label]
        tops = [figure.axes[0].images[0].get_clim()[1] for figure in figures]
        assert tops == pytest.approx([top * pair[0].light.map.max()] * 2)


def test_sections_are_drawn_to_one_scale(designs, monkeypatch):
    first, second = drawn(monkeypatch, lambda: ComparedPictures(("a", "b"), designs).sections)
    assert first.axes[0].get_xlim() == second.axes[0].get_xlim()
    assert first.axes[0].get_ylim() == second.axes[0].get_ylim()


def test_folders_of_one_name_are_told_apart(tmp_path):
    assert folder_names([tmp_path / "left", tmp_path / "right"]) == ["left", "right"]
    pair = [tmp_path / side / "lens" for side in ("left", "right")]
    assert folder_names(pair) == [str(path) for path in pair]


def test_one_folder_twice_or_one_design_alone_is_refused(designs, tmp_path):
    with pytest.raises(InputError, match="twice"):
        folder_names([tmp_path, tmp_path / "."])
    with pytest.raises(InputError, match="from 2 to 8"):
        render_comparison(designs[:1])


@pytest.mark.usefixtures("undrawn")
def test_the_command_writes_the_page_where_it_is_told(tmp_path):
    from lensforge.cli.cli import cli

    folders = [make_folder(tmp_path / name) for name in ("first", "second")]
    page = tmp_path / "pages" / "both.html"
    done = CliRunner().invoke(cli, ["report", *map(str, folders), "--out", str(page), "--json"], catch_exceptions=False)
    assert json.loads(done.stdout) == {"report": str(page)}
    assert page.exists()
    with pytest.raises(InputError, match="--out"):
        CliRunner().invoke(cli, ["report", str(folders[0]), "--out", str(page)], catch_exceptions=False)
