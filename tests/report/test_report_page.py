import base64
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from result_folders import CONTENT, STAGES, check_arrays, evaluate_arrays, gate, make_folder, small_lens

from lensforge.errors import InputError
from lensforge.report import solid_view
from lensforge.report.build import build_report
from lensforge.report.cards import cards
from lensforge.report.results import load_results
from lensforge.report.tables import rows


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
def folder(tmp_path_factory):
    return make_folder(tmp_path_factory.mktemp("report") / "whole")


@pytest.fixture(scope="module")
def page(folder):
    return Page(build_report(folder).read_text(encoding="utf-8"))


def test_the_page_needs_nothing_else(page, folder):
    markup = (folder / "report.html").read_text(encoding="utf-8")
    assert "script" not in page.tags, "there is no mesh to turn"
    assert all(reference.startswith(("#", "data:")) for reference in page.references)
    assert not re.search(r"@import|url\((?!#)", markup)
    assert str(folder) not in markup


def test_links_and_ids_agree(page):
    assert len(page.ids) == len(set(page.ids))
    assert {reference[1:] for reference in page.references if reference.startswith("#")} <= set(page.ids)


def test_every_number_of_every_file_is_on_the_page(page, folder):
    content = {**CONTENT, "lens": json.loads((folder / "lens.json").read_text(encoding="utf-8"))}
    for stage in ("lens", *STAGES):
        for row in rows(content[stage], without=("gates", "verdicts", "spec")):
            assert folded(f"{row.path} {row.value}") in page.text, row.path


def test_all_figures_are_there(page):
    # the first, 3 of light, 3 lines, isolines, circle and flux, 2 sections, 3 per face, 3 of the proof, 3 of the search
    assert page.tags.count("svg") == 1 + 3 + 3 + 3 + 2 + 6 + 3 + 3


def test_gates_that_hold_are_said_to_hold(page):
    assert "All 5 gates hold." in page.text
    table = page.text[page.text.index("All gates") :]
    assert table.count("✓ pass") == 5
    assert "✗ fail" not in page.text


def test_headline_numbers_say_whether_they_are_what_was_asked_for(tmp_path):
    make_folder(tmp_path, stages=("design", "check"))
    gates = [gate("constraint g1", 0.5, -0.001, ">="), gate("constraint g3", -0.25, -0.001, ">=")]
    (tmp_path / "design.json").write_text(json.dumps({**CONTENT["design"], "gates": gates}), encoding="utf-8")
    states = {card.label: card.state for card in cards(load_results(tmp_path))}
    assert states["Cavity room"] == "pass"
    assert states["Lens radius"] == "fail"
    assert states["Thinnest wall"] == "pass"
    assert states["Ball mill"] == "open", "0.77 mm at most, the shop has 1 mm"
    assert states["Lens height"] == ""
    text = Page(build_report(tmp_path).read_text(encoding="utf-8")).text
    assert "Lens radius✗ fail" in text
    assert text.index("constraint g3Try") < text.index("Lens radius"), "what fails comes first, with its remedy"


@pytest.mark.parametrize(("efficacy", "peak"), [(None, "42.5 W/m²"), (301.7, "12 800 lx")])
def test_light_is_in_watts_or_by_the_efficacy_in_lux(tmp_path, efficacy, peak):
    make_folder(tmp_path, stages=("evaluate",), lens=small_lens(lumens_per_watt=efficacy))
    images = evaluate_arrays()
    images["irradiance"] *= 42.5 / images["irradiance"].max()
    np.savez(tmp_path / "evaluate.npz", **images)
    markup = build_report(tmp_path).read_text(encoding="utf-8")
    assert peak in Page(markup).text
    label = "illuminance (lx)" if efficacy else "irradiance (W/m²)"
    assert markup.count(label) >= 6, "three maps and three lines"
    assert ("irradiance (W/m²)" in markup) == (efficacy is None)


def test_a_failed_gate_comes_with_its_remedy(tmp_path):
    make_folder(tmp_path, stages=("export",))
    content = {**CONTENT["export"], "gates": [gate("form_error", 12.5, 10.0)]}
    (tmp_path / "export.json").write_text(json.dumps(content), encoding="utf-8")
    text = Page(build_report(tmp_path).read_text(encoding="utf-8")).text
    assert "1 of 1 gates fail: form error." in text
    assert "Try: try something else." in text


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_has_not_run_is_one_sentence(tmp_path, stage):
    make_folder(tmp_path, stages=[other for other in STAGES if other != stage])
    text = Page(build_report(tmp_path).read_text(encoding="utf-8")).text
    assert text.count(f"There is no {stage}.json") == 1
    assert f"run lensforge {stage}." in text
    assert f"Not run yet: {stage}." in text


def test_a_lens_alone_makes_a_page(tmp_path):
    text = Page(build_report(make_folder(tmp_path, stages=())).read_text(encoding="utf-8")).text
    assert "Section at φ = 90°" in text
    assert "No 3-D picture: there is no lens.stl." in text


@pytest.mark.parametrize("stage", ["evaluate", "check", "verify"])
def test_missing_arrays_are_one_sentence(tmp_path, stage):
    make_folder(tmp_path)
    (tmp_path / f"{stage}.npz").unlink()
    assert f"There is no {stage}.npz" in Page(build_report(tmp_path).read_text(encoding="utf-8")).text


def without(content, *path):
    copy = json.loads(json.dumps(content))
    inner = copy
    for name in path[:-1]:
        inner = inner[name]
    del inner[path[-1]]
    return json.dumps(copy)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("lens.json", "{}"),
        ("design.json", '{"steps": 7, "hist'),
        ("design.json", "[1, 2]"),
        ("design.json", without(CONTENT["design"], "history", 0, "nmse")),
        ("evaluate.json", without(CONTENT["evaluate"], "flux")),
        ("evaluate.json", json.dumps({**CONTENT["evaluate"], "receiver_mm": 0.0})),
        ("evaluate.json", json.dumps({**CONTENT["evaluate"], "nmse": "bad"})),
        ("export.json", without(CONTENT["export"], "form_error_nm", "max")),
        ("check.json", without(CONTENT["check"], "inner", "cutter")),
        ("verify.json", without(CONTENT["verify"], "deviation_mm")),
        ("verify.json", "\x00\x01"),
    ],
)
def test_a_broken_json_file_is_one_line(tmp_path, file, text):
    make_folder(tmp_path)
    (tmp_path / "report.html").write_text("the old report", encoding="utf-8")
    (tmp_path / file).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(file)) as caught:
        build_report(tmp_path)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "the old report"


BROKEN_ARRAYS = {
    "evaluate.npz": [
        {key: value for key, value in evaluate_arrays().items() if key != "target"},
        {**evaluate_arrays(), "raw": np.ones((3, 4))},
        {**evaluate_arrays(), "irradiance": np.full((16, 16), np.nan)},
        {**evaluate_arrays(), "axis_mm": np.zeros(3)},
        {**evaluate_arrays(), "target": np.full((16, 16), "text")},
    ],
    "check.npz": [
        {**check_arrays(), "inner_sag_mm": np.full((21, 21), np.nan)},
        {**check_arrays(), "inner_sag_mm": np.array(1.0)},
    ],
    "verify.npz": [{"irradiance": np.ones((8, 8)), "design_irradiance": np.full((8, 8), np.inf)}],
}


@pytest.mark.parametrize(("file", "arrays"), [(file, case) for file, cases in BROKEN_ARRAYS.items() for case in cases])
def test_broken_arrays_are_one_line(tmp_path, file, arrays):
    np.savez(make_folder(tmp_path) / file, **arrays)
    with pytest.raises(InputError, match=re.escape(file)):
        build_report(tmp_path)


@pytest.mark.parametrize("kept", [0, 10, 900])
def test_a_truncated_npz_is_one_line(tmp_path, kept):
    path = make_folder(tmp_path) / "evaluate.npz"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"evaluate\.npz"):
        build_report(tmp_path)


def test_a_cutter_that_reaches_nothing_leaves_no_map(tmp_path):
    make_folder(tmp_path, stages=("check",))
    np.savez(tmp_path / "check.npz", **{**check_arrays(), "inner_residual_mm": np.full((21, 21), np.nan)})
    assert "Inner face: left by the mill" not in Page(build_report(tmp_path).read_text(encoding="utf-8")).text


def test_text_of_the_spec_stays_text(tmp_path):
    make_folder(tmp_path, stages=(), lens=small_lens(text="<script>$x_</script>"))
    page = Page(build_report(tmp_path).read_text(encoding="utf-8"))
    assert "script" not in page.tags, "there is no mesh to turn"
    assert "<script>$x_</script>" in page.text


def test_an_outline_noted_by_the_design_is_drawn_and_a_missing_one_is_told(tmp_path):
    lens = small_lens()
    source = {"kind": "rayfile", "file": "/somewhere/led.tm25ray"}
    record = json.loads(
        (make_folder(tmp_path, stages=("design",), lens=lens) / "lens.json").read_text(encoding="utf-8")
    )
    record["spec"]["source"] = source
    (tmp_path / "lens.json").write_text(json.dumps(record), encoding="utf-8")
    text = Page(build_report(tmp_path).read_text(encoding="utf-8")).text
    assert "is not recorded in this folder" in text
    assert "/somewhere" not in text
    outline = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    (tmp_path / "design.json").write_text(
        json.dumps({**CONTENT["design"], "source_outline_mm": outline}), encoding="utf-8"
    )
    assert "The source is drawn at its size." in Page(build_report(tmp_path).read_text(encoding="utf-8")).text


def test_the_part_is_shown_from_three_sides(tmp_path):
    markup = build_report(make_folder(tmp_path, stages=(), stl=True)).read_text(encoding="utf-8")
    if "No 3-D picture" in markup:
        pytest.skip("no off-screen renderer here")
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)', markup)
    assert len(pictures) == 3
    for picture in pictures:
        alpha = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))))[..., 3]
        assert 0.05 < (alpha > 0).mean() < 0.95, "a part before a transparent ground"
    assert "10 × 10 × 10 mm over all" in markup


def test_without_a_renderer_the_page_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(solid_view, "_COMMAND", ("sh", "-c", "kill -SEGV $$"))
    markup = build_report(make_folder(tmp_path, stages=(), stl=True)).read_text(encoding="utf-8")
    assert "No 3-D picture: this machine has no off-screen renderer (OpenGL)." in markup


def test_a_mesh_that_is_none_is_one_line(tmp_path):
    (make_folder(tmp_path, stages=()) / "lens.stl").write_bytes(b"not a mesh")
    with pytest.raises(InputError, match=r"lens\.stl"):
        build_report(tmp_path)
