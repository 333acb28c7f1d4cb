import base64
import io
import json
import re
import shutil
import subprocess
from html import escape
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from result_folders import CONTENT, STAGES, check_arrays, evaluate_arrays, gate, make_folder, small_lens

from lensforge.errors import InputError
from lensforge.report import solid_view
from lensforge.report.build import build_report
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
        self.hidden = tag == "style"
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
    assert "script" not in page.tags
    assert all(reference.startswith(("#", "data:")) for reference in page.references)
    assert not re.search(r"@import|url\((?!#)", markup)
    assert str(folder) not in markup


def test_links_and_ids_agree(page):
    assert len(page.ids) == len(set(page.ids))
    assert {reference[1:] for reference in page.references if reference.startswith("#")} <= set(page.ids)


def test_every_number_of_every_file_is_on_the_page(page, folder):
    content = {**CONTENT, "lens": json.loads((folder / "lens.json").read_text())}
    for stage in ("lens", *STAGES):
        for row in rows(content[stage], without=("gates", "verdicts", "spec")):
            assert folded(f"{row.path} {row.value}") in page.text, row.path


def test_all_figures_are_there(page):
    # 3 of light, 3 lines, flux and circle, 2 sections, 3 for each face, 3 of the proof, 2 of the search
    assert page.tags.count("svg") == 3 + 3 + 2 + 2 + 6 + 3 + 2


def test_gates_that_hold_are_said_to_hold(page):
    assert "All 5 gates hold." in page.text
    assert page.text.count("✓ pass") == 5
    assert "✗ fail" not in page.text


def test_a_failed_gate_comes_with_its_remedy(tmp_path):
    make_folder(tmp_path, stages=("export",))
    content = {**CONTENT["export"], "gates": [gate("form_error", 12.5, 10.0)]}
    (tmp_path / "export.json").write_text(json.dumps(content))
    text = Page(build_report(tmp_path).read_text()).text
    assert "1 of 1 gates fail: form error." in text
    assert "Try: try something else." in text


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_has_not_run_is_one_sentence(tmp_path, stage):
    make_folder(tmp_path, stages=[other for other in STAGES if other != stage])
    text = Page(build_report(tmp_path).read_text()).text
    assert text.count(f"There is no {stage}.json") == 1
    assert f"run lensforge {stage}." in text
    assert f"Not run yet: {stage}." in text


def test_a_lens_alone_makes_a_page(tmp_path):
    text = Page(build_report(make_folder(tmp_path, stages=())).read_text()).text
    assert "Section at φ = 90°" in text
    assert "No 3-D picture: there is no lens.stl." in text


@pytest.mark.parametrize("stage", ["evaluate", "check", "verify"])
def test_missing_arrays_are_one_sentence(tmp_path, stage):
    make_folder(tmp_path)
    (tmp_path / f"{stage}.npz").unlink()
    assert f"There is no {stage}.npz" in Page(build_report(tmp_path).read_text()).text


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
    (tmp_path / "report.html").write_text("the old report")
    (tmp_path / file).write_text(text)
    with pytest.raises(InputError, match=re.escape(file)) as caught:
        build_report(tmp_path)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "report.html").read_text() == "the old report"


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
    assert "Inner face: left by the mill" not in Page(build_report(tmp_path).read_text()).text


def test_text_of_the_spec_stays_text(tmp_path):
    make_folder(tmp_path, stages=(), lens=small_lens(text="<script>$x_</script>"))
    page = Page(build_report(tmp_path).read_text())
    assert "script" not in page.tags
    assert "<script>$x_</script>" in page.text


def test_an_outline_noted_by_the_design_is_drawn_and_a_missing_one_is_told(tmp_path):
    lens = small_lens()
    source = {"kind": "rayfile", "file": "/somewhere/led.tm25ray"}
    record = json.loads((make_folder(tmp_path, stages=("design",), lens=lens) / "lens.json").read_text())
    record["spec"]["source"] = source
    (tmp_path / "lens.json").write_text(json.dumps(record))
    text = Page(build_report(tmp_path).read_text()).text
    assert "is not recorded in this folder" in text
    assert "/somewhere" not in text
    outline = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    (tmp_path / "design.json").write_text(json.dumps({**CONTENT["design"], "source_outline_mm": outline}))
    assert "The source is drawn at its size." in Page(build_report(tmp_path).read_text()).text


def test_the_part_is_shown_from_three_sides(tmp_path):
    markup = build_report(make_folder(tmp_path, stages=(), stl=True)).read_text()
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
    markup = build_report(make_folder(tmp_path, stages=(), stl=True)).read_text()
    assert "No 3-D picture: this machine has no off-screen renderer (OpenGL)." in markup


def test_a_mesh_that_is_none_is_one_line(tmp_path):
    (make_folder(tmp_path, stages=()) / "lens.stl").write_bytes(b"not a mesh")
    with pytest.raises(InputError, match=r"lens\.stl"):
        build_report(tmp_path)


BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_FRAME = """<!DOCTYPE html><body><iframe width="{width}" height="4000" srcdoc="{page}"></iframe><script>
addEventListener("load", () => {{
  const page = document.querySelector("iframe").contentDocument;
  const pictures = [...page.querySelectorAll("svg, img")];
  const seen = pictures.filter(picture => picture.getBoundingClientRect().width > 200).length;
  document.title = [page.documentElement.scrollWidth, pictures.length, seen].join(" ");
}});
</script></body>"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
@pytest.mark.parametrize("width", [400, 1280])
def test_a_browser_shows_every_picture_without_scrolling_sideways(page, folder, tmp_path, width):
    frame = tmp_path / "frame.html"
    frame.write_text(_FRAME.format(width=width, page=escape((folder / "report.html").read_text())))
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]
    command = [BROWSER, *options, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", frame.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    overall, pictures, seen = map(int, re.search(r"<title>([\d ]+)</title>", shown)[1].split())
    assert overall <= width
    assert pictures == seen == page.tags.count("svg")
