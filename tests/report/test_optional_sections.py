"""Sections that are there only where their results are: referees, stray light, the measured part."""

import json
import re

import pytest
from addon_rows import addon_rows, needs_addon
from page_text import Page, folded, text_of, undrawn_page_of
from part_files import whole_folder, whole_results
from result_folders import criterion, make_results

from lensforge.errors import InputError
from lensforge.proof.proof_facts import tracer_groups
from lensforge.report.lens_figures import history
from lensforge.report.stored import load_results


@pytest.fixture(scope="module")
def results():
    return whole_results()


@pytest.fixture(scope="module")
def page(results):
    return Page(undrawn_page_of(results))


def test_a_lens_without_these_results_has_none_of_these_sections():
    page = Page(undrawn_page_of(make_results()))
    assert not {"stray", "measured"} & set(page.ids)
    assert "Mitsuba" not in page.text.split("All numbers")[0]


@needs_addon("measure")
def test_sections_pictures_and_links_are_there(page):
    assert {"stray", "measured"} <= set(page.ids)
    assert {"#stray", "#measured"} <= set(page.references)
    # the whole report's, 3 of stray light, 3 + 3 of the photograph, 3 of the surface
    assert page.tags.count("svg") == 26 + 2 + 3 + 6 + 3
    for phrase in ("found in the photograph with the LED off", "12 345", "12.5 µm"):
        assert folded(phrase.replace("12 345", "12\u2009345")) in page.text


@needs_addon("measure")
def test_criteria_of_these_results_count_under_their_names(page):
    assert "All 55 criteria on simulation and files are met." in page.text
    table = page.text[page.text.index("All criteria") :]
    for entry in ("of the flux stray light", "of the target photograph", "of the surface outer surface"):
        assert entry in table
    failing = whole_results(compare={"criteria": (criterion("photo_clipped", 0.5, 0.01),)})
    assert "1 of 55 criteria on simulation and files is not met: photo clipped." in text_of(failing)


def test_each_tracer_has_its_row_and_its_verdict(results):
    rows = tracer_groups(results.proof)
    assert [row.note.partition(";")[0] for row in rows] == [
        "lens.stl", "lens.stl", "lens.step", "lens.stl", "lens.stl",
    ]  # fmt: skip
    assert rows[2].fact("rms").text == "0.0015 mm"
    assert rows[3].title.startswith("Mitsuba 3.9.1") and "within the 0.0085" in rows[3].note
    assert [row.state for row in rows] == ["pass"] * 5


def test_a_tracer_is_judged_by_its_own_receiver(results):
    first = results.proof.first
    bent = first.against_design.model_copy(update={"rms": 0.5})
    far = first.model_copy(update={"name": "far", "against_design": bent, "brep": None, "mitsuba": None})
    proof = results.proof.model_copy(update={"receivers": (first, far)})
    proof = proof.model_copy(update={"criteria": tuple(proof.judge())})
    states = {group.title: group.state for group in tracer_groups(proof)}
    assert [states[f"Mesh with smooth normals, {name}"] for name in (first.name, "far")] == ["pass", "fail"]


@pytest.mark.parametrize(
    ("stem", "change", "message"),
    [
        ("stray", {"flux": None}, "run `lensforge verify --stray`"),
        *((stem, *row) for stem, row in addon_rows("BROKEN").items()),
    ],
)
def test_a_broken_file_says_what_to_run(tmp_path, stem, change, message):
    path = whole_folder(tmp_path) / f"{stem}.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**content, **change}), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        load_results(tmp_path)
    assert f"{stem}.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_loss_has_a_scale_that_holds_it(results):
    levels = results.design.history
    assert history(levels, "loss").axes[0].get_yscale() == "log"
    negative = [level.model_copy(update={"loss": tuple(-value for value in level.loss)}) for level in levels]
    assert history(negative, "loss").axes[0].get_yscale() == "linear"
