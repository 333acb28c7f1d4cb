"""Figures on the pages are those of stored results: docs/figures.json and docs/gallery.json."""

import json
import re
import sys
from typing import Any

import pytest
from page_sources import ROOT
from result_tables import TABLES, filled

sys.path.append(str(ROOT / "docs"))
import make_architecture
import make_gallery
import make_led_table

DESIGNS: dict[str, Any] = json.loads((ROOT / "docs" / "figures.json").read_text(encoding="utf-8"))["designs"]


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def rounded(shown: str, value: float) -> bool:
    """True where ``shown`` is ``value``, rounded to the digits that it has."""
    number = shown.replace(",", "")
    digits = len(number.partition(".")[2])
    return f"{value:.{digits}f}" == number


def expected(design: dict[str, Any]) -> dict[str, float]:
    """Figures of a screen, by the words before them."""
    return {
        r"Pattern error \(NMSE\) +": design["nmse"]["value"],
        r"Pattern error \(NMSE\) +[\d.]+ ± ": design["nmse"]["standard_error"],
        r"Efficiency +": 100 * design["efficiency"]["value"],
        r"Efficiency +[\d.]+ ± ": 100 * design["efficiency"]["standard_error"],
        r"\(upper bound ": 100 * design["possible_efficiency"],
        r"Form error +": design["form_error_nm"],
        r"Ray displacement +": 1e3 * design["deviation_mm"],
    }


@pytest.mark.parametrize(("page", "name"), [("README.md", "quickstart"), ("docs/first_lens.md", "lamp")])
def test_the_screen_on_a_page_is_that_of_the_stored_design(page: str, name: str) -> None:
    screen = re.search(r"^(?:\w+: .*\n)?Photometry: .*?```", text_of(page), flags=re.MULTILINE | re.DOTALL)
    assert screen
    seen = 0
    for phrase, value in expected(DESIGNS[name]).items():
        for shown in re.findall(phrase + r"([\d.]+\d)", screen[0]):
            assert rounded(shown, value), f"{page}: {phrase} {shown}, stored {value}"
            seen += 1
    assert seen >= 5


SENTENCES = [
    ("README.md", r"ours has ([\d.]+\d) after", DESIGNS["flat_top"]["uniformity"]["value"]),
    ("README.md", r"ours has [\d.]+\d after (\d+) seconds", DESIGNS["flat_top"]["search_s"]),
    ("docs/first_lens.md", r"by an NMSE of ([\d.]+\d)", DESIGNS["lamp"]["nmse"]["value"]),
    ("docs/first_lens.md", r"and ([\d.]+) % of the light arrives", 100 * DESIGNS["lamp"]["efficiency"]["value"]),
    ("docs/first_lens.md", r"arrives, of ([\d.]+) %", 100 * DESIGNS["lamp"]["possible_efficiency"]),
]


@pytest.mark.parametrize(("page", "phrase", "value"), SENTENCES)
def test_a_sentence_has_the_stored_figure(page: str, phrase: str, value: float) -> None:
    matches = re.findall(phrase, text_of(page).replace("\n", " "))
    assert matches, f"{page}: {phrase}"
    for shown in matches:
        assert rounded(shown, value), f"{page}: {shown}, stored {value}"


@pytest.mark.parametrize("page", TABLES)
def test_tables_are_as_filled_from_the_stored_designs(page: str) -> None:
    assert filled(text_of(page), page, DESIGNS) == text_of(page), "python benchmarks/results.py --fill"


def test_every_stored_design_says_when_and_how_it_was_made() -> None:
    for name, design in DESIGNS.items():
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", design["date"]), name
        assert re.fullmatch(r"[0-9a-f]{7,}", design["commit"]), name
        assert "lensforge " in design["command"] or "benchmarks/" in design["command"], name


def test_the_gallery_shows_every_shipped_spec() -> None:
    folder = ROOT / "examples"
    shipped = {str(path.relative_to(folder).with_suffix("")) for path in folder.rglob("*.toml")}
    assert set(make_gallery.names()) == shipped
    figures = json.loads(text_of("docs/gallery.json"))
    assert set(figures) == shipped
    assert make_gallery.page(figures) == text_of("docs/gallery.md"), "python docs/make_gallery.py --page"
    for name in shipped:
        assert make_gallery.picture(name).is_file()


def test_the_picture_of_the_packages_is_that_of_the_imports() -> None:
    graph = make_architecture.packages(make_architecture.imports())
    again = "python docs/make_architecture.py"
    assert make_architecture.drawing(graph) == text_of("docs/architecture.svg"), again
    page = text_of("docs/architecture.md")
    assert make_architecture.filled(page, graph) == page, again


def test_the_table_of_led_packages_is_that_of_the_etendue_of_each() -> None:
    page = text_of("docs/leds.md")
    assert make_led_table.filled(page) == page, "python docs/make_led_table.py"
    assert make_led_table.filled(page.replace("| 3030 |", "| 3031 |")) == page


def test_a_figure_that_is_not_the_stored_one_is_found() -> None:
    wrong = text_of("docs/validation.md").replace("| quickstart | – | 0.8", "| quickstart | – | 0.9")
    assert wrong != text_of("docs/validation.md")
    assert filled(wrong, "docs/validation.md", DESIGNS) != wrong
    assert rounded("0.0004", 0.000423) and not rounded("0.0005", 0.000423)
