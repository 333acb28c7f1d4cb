"""Sections that are there only where their files are: referees, stray light, the measured part, the whole loss."""

import json
import re

import numpy as np
import pytest
from part_files import EXTRAS, PHOTO, STRAY, add_part_files, verified
from result_folders import CONTENT, make_folder
from test_report_page import Page, folded

from lensforge.errors import InputError
from lensforge.report import surface_figures
from lensforge.report.build import build_report
from lensforge.report.compare import build_comparison
from lensforge.report.history_figures import history
from lensforge.report.proof_pictures import stray_sentence
from lensforge.report.referees import referee_rows
from lensforge.report.results import load_results
from lensforge.report.tables import rows


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return add_part_files(make_folder(tmp_path_factory.mktemp("part") / "whole"))


@pytest.fixture(scope="module")
def page(folder):
    return Page(build_report(folder).read_text(encoding="utf-8"))


def test_a_folder_without_these_files_has_none_of_these_sections(tmp_path):
    page = Page(build_report(make_folder(tmp_path)).read_text(encoding="utf-8"))
    assert not {"stray", "measured"} & set(page.ids)
    assert "Mitsuba" not in page.text.split("All numbers")[0]
    assert "Loss by level" not in page.text


def test_every_number_of_these_files_is_on_the_page(page):
    for stage, content in {**EXTRAS, "verify": verified()}.items():
        for row in rows(content, without=("gates",)):
            assert folded(f"{row.path} {row.value}") in page.text, (stage, row.path)


def test_sections_pictures_and_links_are_there(page):
    assert {"stray", "measured"} <= set(page.ids)
    assert {"#stray", "#measured"} <= set(page.references)
    # the whole report's, the gaps, 3 of stray light, 3 + 3 of the photograph, 3 of the surface
    assert page.tags.count("svg") == 24 + 1 + 3 + 6 + 3
    for words in ("found in the picture with the LED off", "12 345 points", "PV 12.5 µm, rms 2.25 µm"):
        assert folded(words.replace("12 345", "12\u2009345")) in page.text


def test_gates_of_these_files_count(page, folder, tmp_path):
    assert "All 10 gates hold." in page.text
    copy = add_part_files(make_folder(tmp_path))
    failing = {**PHOTO, "gates": [{**PHOTO["gates"][0], "value": 0.5, "passed": False}]}
    (copy / "compare.json").write_text(json.dumps(failing), encoding="utf-8")
    assert "1 of 10 gates fail: photo clipped." in Page(build_report(copy).read_text(encoding="utf-8")).text


def test_each_referee_has_its_row_and_its_verdict(folder):
    found = referee_rows(load_results(folder))
    assert [row.file for row in found] == ["lens.stl", "lens.stl", "lens.step", "lens.stl"]
    assert found[2].rms_mm == "0.0015"
    assert found[3].name.startswith("Mitsuba 3.9.1")
    assert "within the 0.0085" in found[3].says
    assert [row.state for row in found] == ["pass", "", "pass", "pass"]


def test_the_sentence_on_stray_light_says_how_much_and_which_way(folder):
    sentence = stray_sentence(load_results(folder))
    for words in ("1.25 %", "3.00 %", "86.00 %", "87.50 %", "−1.5 points", "1.35 %", "black base", "0.002 per mm"):
        assert words.replace(" %", "\u2009%") in sentence, words


def test_a_form_map_is_seen_along_the_axis_with_x_to_the_right(folder):
    surface = load_results(folder).surfaces["outer"]
    figure = surface_figures.form_map(np.transpose(surface.form["deviation_um"]))
    image = figure.axes[0].images[0].get_array()  # drawn [y, x]
    middle = image.shape[0] // 2
    assert image[middle, -2] > 6.0 > -6.0 > image[middle, 1]
    assert abs(image[1, middle]) < 0.5


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("stray.json", {key: value for key, value in STRAY.items() if key != "flux"}, "run `lensforge verify --stray`"),
        ("compare.json", {**PHOTO, "ssim": "high"}, "run `lensforge compare --on`"),
        ("compare_outer.json", {"points": 3}, "run `lensforge compare --points --surface outer`"),
    ],
)
def test_a_broken_file_says_what_to_run(tmp_path, file, change, message):
    add_part_files(make_folder(tmp_path))
    (tmp_path / file).write_text(json.dumps(change), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        build_report(tmp_path)
    assert file in str(caught.value)


def test_the_loss_is_shown_where_the_design_wrote_it(tmp_path):
    make_folder(tmp_path, stages=("design",))
    content = json.loads(json.dumps(CONTENT["design"]))
    for level in content["history"]:
        level["loss"] = [2.0 * value for value in level["nmse"]]
    (tmp_path / "design.json").write_text(json.dumps(content), encoding="utf-8")
    levels = load_results(tmp_path).design.history
    assert "Loss by level" in Page(build_report(tmp_path).read_text(encoding="utf-8")).text
    assert history(levels, "loss").axes[0].get_yscale() == "log"
    drawn = np.concatenate([line.get_ydata() for line in history(levels, "loss").axes[0].lines])
    np.testing.assert_allclose(drawn, [1.8, 1.0, 0.6, 0.4, 0.2, 0.1, 0.05])
    negative = [level.model_copy(update={"loss": tuple(-value for value in level.loss)}) for level in levels]
    assert history(negative, "loss").axes[0].get_yscale() == "linear"


def test_a_newer_page_leaves_no_older_pdf(tmp_path):
    make_folder(tmp_path / "one", stages=())
    make_folder(tmp_path / "two", stages=())
    for path in (tmp_path / "one" / "report.pdf", tmp_path / "both.pdf"):
        path.write_bytes(b"%PDF of yesterday")
    build_report(tmp_path / "one")
    build_comparison([tmp_path / "one", tmp_path / "two"], tmp_path / "both.html")
    assert not list(tmp_path.rglob("*.pdf"))


def test_photographs_stand_side_by_side(folder, tmp_path):
    plain = make_folder(tmp_path / "plain")
    markup = build_comparison([folder, plain], tmp_path / "both.html").read_text(encoding="utf-8")
    assert markup.count("<svg") == 2 + 3 + 2 + 1
    text = Page(markup).text
    assert "Photographs of the parts" in text
    assert "SSIM to the simulation 0.925" in text
    assert "Stray light" in text
