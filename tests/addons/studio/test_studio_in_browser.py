"""The studio as a person uses it, in a real browser: write, see, search, pause, keep, make the part, and compare."""

import re
from pathlib import Path

import browser
import pytest
from axe_playwright_python.sync_playwright import Axe
from studio_page import phase, pixels, step, studio_on, until

import lensforge as lf
from lensforge.report.folder import load
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.spec.shipped_specs import shipped_specs

pytestmark = browser.needed
NAME = "quickstart"


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A studio on a shipped spec, which it may save."""
    with studio_on(shipped_specs()[NAME].read_text(encoding="utf-8"), tmp_path_factory.mktemp("studio")) as running:
        yield running


def test_a_changed_field_moves_the_bound_and_the_text_and_a_wrong_one_has_its_line(window):
    until(lambda: "upper bound" in window.inner_text("#bounds"))
    before, picture = window.inner_text("#bounds"), pixels(window)
    window.fill("#f-source-side_mm", "12")
    until(lambda: window.inner_text("#bounds") != before, 20.0)
    assert "side_mm = 12\n" in window.input_value(
        "#text"
    ) and "# the search keeps what the ball needs" in window.input_value("#text")
    until(lambda: "blurs the target" in window.inner_text("#bounds"), 20.0)
    until(lambda: pixels(window) != picture, 20.0)
    window.fill("#f-source-side_mm", "-2")
    wrong = until(lambda: window.inner_text("#f-source-side_mm-wrong"), 20.0)
    assert wrong == "source.side_mm = -2: must be at least 0"
    assert window.inner_text("body").count(wrong) == 1, "said once"
    assert window.evaluate("getComputedStyle(document.getElementById('bounds')).opacity") == "0.45", "of another spec"
    assert window.input_value("#f-lens-kind") == "double", "the default, though another field is wrong"
    assert window.get_attribute("#f-source-side_mm", "aria-invalid") == "true"
    window.fill("#text", window.input_value("#text").replace("side_mm = -2", "side_mm = 2.0"))
    until(lambda: window.input_value("#f-source-side_mm") == "2", 20.0)
    assert window.inner_text("#f-source-side_mm-wrong") == ""
    assert window.evaluate("getComputedStyle(document.getElementById('bounds')).opacity") == "1"
    window.select_option("#f-target-kind", "disc")
    until(lambda: "diameter_mm: missing" in window.inner_text("#f-target-diameter_mm-wrong"), 20.0)
    assert window.inner_text("#text-wrong") == "see target.diameter_mm"
    assert window.evaluate("document.activeElement.id") == "f-target-diameter_mm", "where the error is"
    assert "stroke_mm" not in window.input_value("#text"), "a disc has none"
    window.select_option("#examples", NAME)
    until(lambda: "stroke_mm = 60.0" in window.input_value("#text"), 20.0)


def target_fields(window):
    return window.evaluate(
        "[...document.querySelectorAll('[data-section=target] > .field input')].map(each => each.id)"
    )


def test_needed_fields_stand_first_and_those_of_another_receiver_nowhere(window):
    text = until(lambda: window.input_value("#text"))
    head = text.partition("[target]")[0]
    on_plane = '[target]\nedge_mm = 3.0\nkind = "rectangle"\n'
    window.fill("#text", head + on_plane)
    until(lambda: window.query_selector("#f-target-width_mm"), 20.0)
    until(lambda: window.inner_text("#text-wrong"), 20.0)
    names = [f"f-target-{name}_mm" for name in ("distance", "receiver", "width", "height", "edge")]
    assert target_fields(window) == names
    window.click("[data-section='target.…'] > summary")
    until(lambda: window.query_selector("#f-target-half_angle_deg"), 20.0)
    assert not window.query_selector("#f-target-width_deg") and not window.query_selector("#f-target-centre_deg")
    window.fill("#text", head + on_plane.replace("edge_mm", "half_angle_deg"))
    until(lambda: window.query_selector("#f-target-width_deg"), 20.0)
    assert target_fields(window)[:2] == ["f-target-half_angle_deg", "f-target-width_deg"]
    assert not window.query_selector("#f-target-width_mm")
    window.fill("#text", text)
    until(lambda: not window.inner_text("#text-wrong"), 20.0)  # or the page is closed before the text is sent


def test_what_search_refuses_is_refused_on_edit_and_a_line_leads_to_its_field(window):
    text = until(lambda: window.input_value("#text"))
    wide = (
        "[lens]\nrefractive_index = 1.49\nsymmetry = 'square'\n[source]\nkind = 'square'\nside_mm = 1.0\nflux_w = 1.0\n"
    )
    wide += "[constraints]\nmax_radius_mm = 14.0\n[target]\nkind = 'rectangle'\nwidth_mm = 200.0\nheight_mm = 150.0\n"
    wide += "distance_mm = 150.0\nreceiver_mm = 300.0\n"
    window.click("[data-section=lens] > summary")
    window.fill("#text", wide)
    until(
        lambda: (
            "see lens.symmetry" in window.inner_text("#text-wrong")
            or "lens.symmetry = 'square'" in window.inner_text("#text-wrong")
        )
    )
    assert window.get_attribute("#text", "aria-invalid") == "false", "the text is a spec"
    window.click("#text-wrong button")
    assert window.evaluate("document.activeElement.id") == "f-lens-symmetry"
    assert "the target is not symmetric in this way" in window.inner_text("#f-lens-symmetry-wrong")
    window.fill("#text", text)
    until(lambda: not window.inner_text("#text-wrong"))


ODD = (
    "source = 3\n", "lens = []\n", "limits = 3\n", "limits = [1, [2]]\n", "receivers = 'far'\n",
    "sources = {kind = 1}\n",
    "[target]\nkind = ['a']\n", "[target]\nkind = nan\n", "[[receivers]]\ntargets = 3\n", "__proto__ = {a = 1}\n",
    "[source]\nside_mm = inf\n", "[source]\nside_mm = 0x" + "f" * 4000 + "\n", "[lens]\nlevels = [nan, {a = inf}]\n",
    "[source]\nside_mm = 1979-05-27\n", "[[limits]]\nkind = 'points'\nat_mm = nan\n", "constructor = 1\n",
)  # fmt: skip


def test_the_page_lives_through_any_text_and_a_reload(studio, window):
    text = until(lambda: window.input_value("#text"))
    for odd in ODD:
        window.fill("#text", odd)
        until(lambda text=odd: window.request.get(f"{studio.address}spec").json()["text"] == text, 20.0)
        until(lambda: window.inner_text("#text-wrong"), 20.0)
        assert "internal error" not in window.inner_text("#note") + window.inner_text("#text-wrong"), odd
    window.reload()
    window.wait_for_selector("body[data-ready]")
    assert window.input_value("#text") == ODD[-1]
    window.fill("#text", text)
    until(lambda: not window.inner_text("#text-wrong"), 20.0)


def test_a_search_is_seen_paused_kept_through_a_reload_and_ends_with_the_bits_of_the_command(studio, window, tmp_path):
    window.select_option("#accuracy", "draft")
    window.click("#search")
    begun = until(lambda: step(window))
    first = {name: pixels(window, name) for name in ("own", "section", "curves")}
    until(lambda: step(window) > begun)
    until(lambda: all(pixels(window, name) != before for name, before in first.items()), 10.0)
    window.click("#pause")
    phase(window, "paused")
    assert (studio.folder / CHECKPOINT).exists()
    stands, at_rest = step(window), pixels(window)
    window.reload()
    window.wait_for_selector("body[data-phase=paused]")
    until(lambda: step(window) >= stands, 20.0)
    until(lambda: pixels(window) == at_rest, 20.0)
    window.click("#pause")
    phase(window, "searching")
    phase(window, "idle")
    until(lambda: "Pattern error" in window.inner_text("#facts"), 20.0)
    again = lf.design(lf.load_spec(studio.folder / "studio.toml"), accuracy="draft")
    assert load(studio.folder).lens.sha256 == again.lens.sha256
    assert not (studio.folder / CHECKPOINT).exists()


def test_a_change_goes_on_from_the_lens_that_is_there_and_is_kept_at_once(studio, window):
    window.click("#search")
    phase(window, "searching")
    until(lambda: step(window) > 3)
    window.fill("#f-target-stroke_mm", "75")
    until(lambda: "stroke_mm = 75" in (studio.folder / "studio_search.json").read_text(), 60.0)
    until(lambda: step(window) > 3)
    window.click("#enough")
    phase(window, "idle")
    run = load(studio.folder)
    assert run.spec.target.stroke_mm == 75.0 and run.spec.lens.start.name == "studio_start.json"
    assert "ended by its observer after" in run.design.ended
    assert run.light.nmse.value < 0.2, "from a lens that was good already"


def test_the_keyboard_alone_moves_the_sections_and_turns_the_lens(window):
    until(lambda: "peak" in window.inner_text("#own-readout"), 60.0)
    window.focus("#own")
    for key in ("ArrowLeft", "ArrowLeft", "Shift+ArrowUp"):
        window.keyboard.press(key)
    assert re.match(r"x −6 mm, y 30 mm: ", window.inner_text("#own-readout"))
    tabbed = "button, a, input, select, textarea, summary, [tabindex]"
    names = window.evaluate(
        f"""[...document.querySelectorAll('{tabbed}')]
        .filter(each => each.offsetParent && !each.disabled).map(each => each.tabIndex)"""
    )
    assert len(names) > 20 and min(names) >= 0, "each is reached by Tab"


@pytest.mark.parametrize(("width", "scheme"), [(1500, "light"), (1500, "dark"), (400, "light")])
def test_axe_finds_nothing_and_a_narrow_window_needs_no_sideways_scrolling(studio, started, width, scheme):
    context = started.new_context(bypass_csp=True, viewport={"width": width, "height": 900}, color_scheme=scheme)
    page = context.new_page()
    page.goto(studio.address)
    page.wait_for_selector("body[data-ready]")
    until(lambda: page.inner_text("#bounds"), 30.0)
    for details in page.query_selector_all("details:not([open]) > summary")[:6]:
        details.click()
    violations = Axe().run(page).response["violations"]
    assert [(violation["id"], [node["html"][:90] for node in violation["nodes"][:3]]) for violation in violations] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    context.close()


def test_a_page_of_another_site_learns_and_changes_nothing(studio, started):
    page = started.new_page()
    page.route("http://evil.example/", lambda route: route.fulfill(body="<p>x</p>", content_type="text/html"))
    page.goto("http://evil.example/")
    for options in ("{}", "{mode: 'no-cors'}", "{method: 'POST', mode: 'no-cors', body: '{\"text\": \"x\"}'}"):
        answer = page.evaluate(
            f"fetch('{studio.address}spec', {options}).then(got => got.text()).catch(error => 'refused')"
        )
        assert answer in ("refused", ""), options
    page.close()


def test_the_page_says_so_when_the_studio_has_ended(tmp_path, started):
    opened = lf.studio(tmp_path / "gone", browser=False)
    page = started.new_page()
    page.goto(opened.address)
    page.wait_for_selector("body[data-ready]")
    opened.close()
    page.wait_for_selector("body[data-phase=ended]")
    assert "The studio has ended" in page.inner_text("#note")
    assert not list(Path(tmp_path / "gone").glob("*")), "nothing was saved, nothing is left"
    page.close()
