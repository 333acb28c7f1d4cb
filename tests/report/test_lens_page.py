"""The page on one lens: whole, self-contained, and true to its results."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from page_text import Page, text_of, undrawn_page_of
from result_folders import face_maps, make_folder, make_results, small_lens, with_leds

from lensforge.cli.conclusion import _manufacture
from lensforge.report.stored import load_results
from lensforge.search.design_result import ToolCost
from lensforge.shop.check_measures import FaceFaults
from lensforge.shop.face_faults import Fault
from lensforge.sources.source_place import SourcePlace
from lensforge.spec.source_sections import RayfileSource


@pytest.fixture(scope="module")
def page(drawn_page):
    return Page(drawn_page.markup)


def test_the_page_needs_nothing_else(page, drawn_page):
    assert "script" not in page.tags, "there is no mesh to turn"
    others = {reference for reference in page.references if not reference.startswith(("#", "data:"))}
    assert others == {"yield.csv"}, "the table of parts, for those who have the folder"
    assert not re.search(r"@import|url\((?!#)", drawn_page.markup)


def test_links_and_ids_agree(page):
    assert len(page.ids) == len(set(page.ids))
    assert {reference[1:] for reference in page.references if reference.startswith("#")} <= set(page.ids)


def test_all_figures_are_there():
    page = Page(undrawn_page_of(make_results()))
    # the first, 3 of light, 3 lines, isolines, circle and flux, 2 sections, 3 per face, 3 of the proof and the gaps,
    # 4 of the search
    assert page.tags.count("svg") == 1 + 3 + 3 + 3 + 2 + 2 + 6 + 4 + 4


def test_a_lens_alone_makes_a_page():
    text = text_of(make_results(()))
    assert "Section at φ = 90°" in text
    assert "No 3-D picture: no part has been exported." in text


def test_the_place_of_each_led_stands_where_it_is_named_first():
    """In the header, of several LEDs of each, before any figure and outside of all that is folded."""
    place = SourcePlace(file=None, rotate_z_deg=0.0, tilt_deg=(0.0, 7.5), position_mm=(0.1, -0.2, 0.4))
    made = make_results(("evaluate",))
    lens = with_leds(made.lens, "red", "green")
    light = made.light.model_copy(update={"led": "red", "place": place})
    other = light.changed(led="green", place=place.changed(position_mm=(1.5, 0.0, 0.0)), others=())
    both = light.model_copy(update={"others": (other,)})
    markup = undrawn_page_of(replace(made, lens=lens, found={"evaluate": both}))
    head = re.sub("<[^>]+>|\\s+", " ", markup[markup.index("<header>") : markup.index("<main>")])
    for phrase in (
        "LED, red: tilted by (0, 7.5)°, Shifted by (0.1, −0.2, 0.4) mm",
        "LED, green: tilted by (0, 7.5)°, Shi",
    ):
        assert f"Place of the {phrase}" in head


def test_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make_folder(tmp_path / "lens", ("evaluate",))
    before = sorted(tmp_path.rglob("*"))
    undrawn_page_of(load_results(tmp_path / "lens"), tmp_path / "lens")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("place", "title"),
    [
        (("inner", "residual_mm"), "Inner face: left uncut by the mill"),
        (("outer", "sag_mm"), "Outer face: departure from a sphere"),
        (("inner", "kappa_min"), "Inner face: curvature"),
    ],
)
def test_a_map_without_a_number_is_left_out(place, title):
    name, quantity = place
    full = make_results(("check",))
    assert title in text_of(full)
    face = full.check.faces[name].model_copy(update={quantity: np.full((21, 21), np.nan)})
    assert title not in text_of(make_results(("check",), check={name: face}))


def test_a_face_that_cannot_be_made_is_drawn_and_one_that_can_is_not():
    kinds = np.where(np.isnan(face_maps()["sag_mm"]), np.nan, float(Fault.BASE))
    faults = (FaceFaults(face="outer", places_mm={}, kinds=kinds),)
    text = text_of(make_results(("check",), check={"faults": faults}))
    assert "Outer face: where it cannot be made" in text and "Inner face: where it cannot" not in text
    assert "where it cannot be made" not in text_of(make_results(("check",)))


def test_what_the_tools_cost_stands_on_the_page_in_full_and_on_the_screen_where_it_matters():
    costs = tuple(
        ToolCost(limit=limit, instead=f"manufacture.{limit[:4]}_mm = 1", efficiency=share)
        for limit, share in (("tools", 0.012), ("ball of 1 mm", 0.001))
    )
    results = make_results(("design", "check"), design={"tool_costs": costs})
    text = text_of(results)
    assert "Cost of the tools" in text and "Cost of the ball of 1 mm" in text
    assert "against manufacture.ball_mm = 1" in text
    run = SimpleNamespace(
        folder=Path(), lens=results.lens, spec=results.spec, find=results.find, facts=results.facts,
        verdict=results.verdict,
    )  # fmt: skip
    rows = dict(_manufacture(run))
    assert rows["Cost of the tools"].startswith("1.2") and "Cost of the ball of 1 mm" not in rows


def test_text_of_the_spec_stays_text():
    page = Page(undrawn_page_of(make_results((), small_lens(text="<script>$x_</script>"))))
    assert "script" not in page.tags, "there is no mesh to turn"
    assert "<script>$x_</script>" in page.text


def test_an_outline_noted_by_the_design_is_drawn_and_a_missing_one_is_told():
    lens = small_lens()
    source = RayfileSource(file=Path("/somewhere/led.tm25ray"))
    lens = replace(lens, spec=lens.spec.model_copy(update={"source": source}))
    text = text_of(make_results((), lens))
    assert "is not recorded in this folder" in text
    assert "led.tm25ray" in text
    assert "/somewhere" not in text
    assert "The source is drawn at its size." in text_of(make_results(("design",), lens))
