import base64
import hashlib
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from result_folders import (
    STAGES,
    check_arrays,
    evaluate_arrays,
    gate,
    make_folder,
    make_results,
    page_of,
    small_lens,
)

from lensforge.errors import InputError
from lensforge.manufacturing.verdicts import ShopVerdict
from lensforge.records import Metric
from lensforge.report import solid_view
from lensforge.report.build import render_report
from lensforge.report.cards import cards
from lensforge.report.tables import plain, rows
from lensforge.results import load_results
from lensforge.spec.source import RayfileSource


def folded(text):
    return re.sub(r"\s+", " ", text).strip()


class Page(HTMLParser):
    """Text, tags and references of a page."""

    def __init__(self, markup):
        super().__init__()
        self.text, self.tags, self.references, self.ids, self.hidden = "", [], [], [], False
        self.feed(markup)
        self.text = folded(self.text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.hidden = tag in ("style", "script")
        self.text += " " if tag == "div" else ""
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href"):
                self.references.append(value)

    def handle_endtag(self, tag):
        self.hidden = False
        self.text += " " if tag in ("td", "div", "p") else ""

    def handle_data(self, data):
        if not self.hidden:
            self.text += data


@pytest.fixture(scope="module")
def results():
    return make_results()


@pytest.fixture(scope="module")
def markup(results):
    return page_of(results)


@pytest.fixture(scope="module")
def page(markup):
    return Page(markup)


def text_of(results, folder=None):
    return Page(page_of(results, folder)).text


def test_the_page_needs_nothing_else(page, markup):
    assert "script" not in page.tags, "there is no mesh to turn"
    assert all(reference.startswith(("#", "data:")) for reference in page.references)
    assert not re.search(r"@import|url\((?!#)", markup)


def test_links_and_ids_agree(page):
    assert len(page.ids) == len(set(page.ids))
    assert {reference[1:] for reference in page.references if reference.startswith("#")} <= set(page.ids)


def test_every_number_of_every_record_is_on_the_page(page, results):
    content = {stem: plain(result) for stem, result in results.found.items()}
    for stem, record in {**content, "lens": results.lens.to_json()}.items():
        for row in rows(record, without=("gates", "verdicts", "spec")):
            assert folded(f"{row.path} {row.value}") in page.text, (stem, row.path)


def test_all_figures_are_there(page):
    # the first, 3 of light, 3 lines, isolines, circle and flux, 2 sections, 3 per face, 3 of the proof and the gaps,
    # 4 of the search
    assert page.tags.count("svg") == 1 + 3 + 3 + 3 + 2 + 6 + 4 + 4


def test_gates_that_hold_are_said_to_hold(page):
    assert "All 5 gates hold." in page.text
    table = page.text[page.text.index("All gates") :]
    assert table.count("✓ pass") == 5
    assert "✗" not in page.text


def test_the_three_verdicts_stand_at_the_top(page):
    for words in ("✓ Light: pass", "✓ Files: pass", "✓ Cutting: pass"):
        assert page.text.index(words) < page.text.index("All 5 gates hold.")


def test_a_verdict_that_is_no_pass_comes_with_its_reason():
    worse = {"nmse": Metric(value=0.3, standard_error=0.001)}
    reason = "a ball of 1 mm radius reaches 75.0 % of the inner face"
    verdicts = (ShopVerdict(name="cutter", surface="inner", holds=False, reason=reason),)
    text = text_of(make_results(evaluate=worse, check={"verdicts": verdicts}))
    assert "✗ Light: fail" in text
    assert "Light: NMSE less its noise = 0.3, at most 0.1" in text
    assert "✗ Cutting: fail" in text
    assert f"Cutting: {reason}" in text
    assert "All 5 gates hold." in text, "they are another matter"
    assert "✓ Files: pass" in text


def test_what_has_not_run_leaves_a_verdict_undecided():
    text = text_of(make_results(("design",)))
    for words in ("Light: undecided", "Files: undecided", "Cutting: undecided"):
        assert words in text
    assert "Cutting: the part has not been checked" in text


def test_headline_numbers_say_whether_they_are_what_was_asked_for():
    gates = (
        gate("cavity clearance", 0.5, -0.001, ">="),
        gate("radius margin", -0.25, -0.001, ">="),
    )
    results = make_results(("design", "check"), design={"gates": gates})
    states = {card.label: card.state for card in cards(results)}
    assert states["Cavity room"] == "pass"
    assert states["Lens radius"] == "fail"
    assert states["Thinnest wall"] == "pass"
    assert states["Ball mill"] == "open", "0.77 mm at most, the shop has 1 mm"
    assert states["Lens height"] == ""
    text = text_of(results)
    assert "Lens radius✗ fail" in text
    assert text.index("radius marginTry") < text.index("Lens radius"), "what fails comes first"


@pytest.mark.parametrize(("efficacy", "peak"), [(None, "42.5 W/m²"), (301.7, "12 800 lx")])
def test_light_is_in_watts_or_by_the_efficacy_in_lux(efficacy, peak):
    image = evaluate_arrays()["map"]
    image *= 42.5 / image.max()
    markup = page_of(make_results(("evaluate",), small_lens(lumens_per_watt=efficacy), evaluate={"map": image}))
    assert peak in Page(markup).text
    label = "illuminance (lx)" if efficacy else "irradiance (W/m²)"
    assert markup.count(label) >= 6, "three maps and three lines"
    assert ("irradiance (W/m²)" in markup) == (efficacy is None)


def test_the_level_is_the_mean_in_the_mask():
    image = np.arange(256.0).reshape(16, 16)
    changes = {"map": image, "uniform_mm": 100.0, "uniformity": Metric(value=0.5), "rsd": Metric(value=0.25)}
    found = {card.label: card for card in cards(make_results(("evaluate",), evaluate=changes))}
    inside = slice(5, 11)  # pixels of 18.75 mm whose centres lie within 50 mm of the axis
    assert float(found["Mean irradiance"].value.replace("\u2009", "")) == pytest.approx(
        image[inside, inside].mean(), 0.01
    )
    assert found["Uniformity"].value == "0.5"


def test_a_failed_gate_comes_with_its_remedy():
    text = text_of(make_results(("export",), export={"gates": (gate("form_error", 12.5, 10.0),)}))
    assert "1 of 1 gates fail: form error." in text
    assert "Try: try something else." in text


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_has_not_run_is_one_sentence(stage):
    text = text_of(make_results([other for other in STAGES if other != stage]))
    assert text.count(f"There is no {stage}.json") == 1
    assert f"run lensforge {stage}." in text
    assert f"Not run yet: {stage}." in text


def test_an_outdated_stage_is_named_with_its_reason():
    why = "it was made from another lens; run `lensforge evaluate` again"
    text = text_of(make_results(("design", "export", "check", "verify"), outdated={"evaluate": why}))
    assert f"evaluate.json does not count: {why}." in text
    assert "Out of date: evaluate." in text
    assert "Not run yet" not in text
    assert "There is no evaluate.json" not in text


def test_a_record_of_an_earlier_version_is_named_without_the_path_of_its_folder(tmp_path):
    make_folder(tmp_path)
    path = tmp_path / "evaluate.json"
    path.write_text(path.read_text(encoding="utf-8").replace("lensforge-evaluate-2", "lensforge-evaluate-1"))
    text = text_of(load_results(tmp_path), tmp_path)
    assert 'evaluate.json does not count: schema = "lensforge-evaluate-1"' in text
    assert str(tmp_path) not in text


def test_a_lens_alone_makes_a_page():
    text = text_of(make_results(()))
    assert "Section at φ = 90°" in text
    assert "No 3-D picture: no part has been exported." in text


def test_files_are_listed_with_their_hashes(tmp_path, results):
    part = results.part.files["lens.step"]
    assert f"lens.step 6\u2009B {part.sha256}".replace("\u2009", " ") in text_of(results).replace("\u2009", " ")
    make_folder(tmp_path)
    (tmp_path / "report.html").write_text("the page before", encoding="utf-8")
    listed = text_of(load_results(tmp_path), tmp_path)
    listed = listed[listed.index("SHA-256") : listed.index("Specification")]
    for path in tmp_path.iterdir():
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        assert (digest in listed) == (path.name != "report.html"), path.name


def test_nothing_is_written(tmp_path, monkeypatch, results):
    monkeypatch.chdir(tmp_path)
    make_folder(tmp_path / "lens")
    before = sorted(tmp_path.rglob("*"))
    page_of(load_results(tmp_path / "lens"), tmp_path / "lens")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("stage", ["evaluate", "check", "verify"])
def test_missing_arrays_are_one_line(tmp_path, stage):
    make_folder(tmp_path)
    (tmp_path / f"{stage}.npz").unlink()
    with pytest.raises(InputError, match=rf"{stage}\.npz: no such file; run `lensforge {stage}` again"):
        load_results(tmp_path)


def changed(folder, file, *path, value=None):
    """Take the entry at ``path`` out of a JSON file, or give it another value."""
    content = json.loads((folder / file).read_text(encoding="utf-8"))
    inner = content
    for name in path[:-1]:
        inner = inner[name]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    (folder / file).write_text(json.dumps(content), encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("lens.json", "{}"),
        ("design.json", '{"steps": 7, "hist'),
        ("design.json", "[1, 2]"),
        ("verify.json", "\x00\x01"),
    ],
)
def test_a_file_that_is_no_record_is_one_line(tmp_path, file, text):
    (make_folder(tmp_path) / file).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(file)) as caught:
        load_results(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "path", "value"),
    [
        ("design.json", ("history", 0, "nmse"), None),
        ("evaluate.json", ("flux",), None),
        ("evaluate.json", ("receiver_mm",), 0.0),
        ("evaluate.json", ("nmse",), "bad"),
        ("export.json", ("form_error_nm", "max"), None),
        ("check.json", ("inner", "cutter"), None),
        ("verify.json", ("deviation_mm",), None),
    ],
)
def test_a_broken_record_is_one_line(tmp_path, file, path, value):
    changed(make_folder(tmp_path), file, *path, value=value)
    with pytest.raises(InputError, match=re.escape(file)) as caught:
        load_results(tmp_path)
    assert "\n" not in str(caught.value)
    assert ".".join(map(str, path)) in str(caught.value)


BROKEN_ARRAYS = {
    "evaluate.npz": [
        {key: value for key, value in evaluate_arrays().items() if key != "target_map"},
        {**evaluate_arrays(), "raw_map": np.ones((3, 4))},
        {**evaluate_arrays(), "map": np.full((16, 16), np.nan)},
        {**evaluate_arrays(), "axis_mm": np.zeros(3)},
        {**evaluate_arrays(), "target_map": np.full((16, 16), "text")},
    ],
    "check.npz": [
        {**check_arrays(), "inner_sag_mm": np.full((21, 21), np.inf)},
        {**check_arrays(), "inner_sag_mm": np.array(1.0)},
    ],
    "verify.npz": [{"irradiance": np.ones((8, 8)), "design_irradiance": np.full((8, 8), np.inf)}],
}


@pytest.mark.parametrize(("file", "arrays"), [(file, case) for file, cases in BROKEN_ARRAYS.items() for case in cases])
def test_broken_arrays_are_one_line(tmp_path, file, arrays):
    np.savez(make_folder(tmp_path) / file, **arrays)
    with pytest.raises(InputError, match=re.escape(file.removesuffix(".npz"))) as caught:
        load_results(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kept", [0, 10, 900])
def test_a_truncated_npz_is_one_line(tmp_path, kept):
    path = make_folder(tmp_path) / "evaluate.npz"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"evaluate\.npz"):
        load_results(tmp_path)


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("inner_residual_mm", "Inner face: left by the mill"),
        ("outer_sag_mm", "Outer face: departure from a sphere"),
        ("inner_kappa_min", "Inner face: curvature"),
    ],
)
def test_a_map_without_a_number_is_left_out(name, title):
    assert title in text_of(make_results(("check",)))
    assert title not in text_of(make_results(("check",), check={name: np.full((21, 21), np.nan)}))


def test_text_of_the_spec_stays_text():
    page = Page(page_of(make_results((), small_lens(text="<script>$x_</script>"))))
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


def test_the_part_is_shown_from_three_sides(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the renderer finds lensforge wherever its caller stands
    markup = render_report(make_results(("export",)))
    if "No 3-D picture" in markup:
        pytest.skip("no off-screen renderer here")
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)', markup)
    assert len(pictures) == 3
    for picture in pictures:
        alpha = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))))[..., 3]
        assert 0.05 < (alpha > 0).mean() < 0.95, "a part before a transparent ground"
    assert "10 × 10 × 10 mm over all" in markup
    assert "script" in Page(markup).tags, "it can be turned"


def test_without_a_renderer_the_page_says_so(monkeypatch):
    monkeypatch.setattr(solid_view, "_COMMAND", ("sh", "-c", "kill -SEGV $$"))
    markup = render_report(make_results(("export",)))
    assert "No 3-D picture: this machine has no off-screen renderer (OpenGL)." in markup


def test_a_mesh_that_is_none_is_one_line():
    with pytest.raises(InputError, match=r"lens\.stl: not a readable mesh; run `lensforge export` again"):
        render_report(make_results(("export",), export={"stl": b"not a mesh"}))
