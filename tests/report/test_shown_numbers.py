"""Every number on a page, a screen, a notebook or a drawing is one of a fact, as the one formatter writes it."""

import re
from collections.abc import Iterable, Iterator
from html import unescape
from pathlib import Path

import pytest
from nightly import first_by_day
from page_text import undrawn_page_of
from shown_folders import FOLDERS, folder_of, lens_of
from undrawn import undrawn

from lensforge.cli.conclusion import blocks_of, rows_of, summary
from lensforge.cli.output import Block, print_screen
from lensforge.made.tolerance_result import Yield
from lensforge.made.yield_facts import budget_sentence, drawn_rows, pass_sentence, worst_phrase
from lensforge.proof.proof_facts import tracer_groups
from lensforge.report import exported_part, headline, light_section
from lensforge.report.compare import render_comparison
from lensforge.report.folder import Run
from lensforge.report.headline import task
from lensforge.report.lens_page import results_html
from lensforge.report.record_tables import number_tables, spec_tables
from lensforge.report.results import Results
from lensforge.report.tradeoff import Tradeoff, TradeoffRow
from lensforge.report.tradeoff_study import tradeoff_page
from lensforge.results import Fact, Group, Metric
from lensforge.results.criteria import shown
from lensforge.shop import shop_files
from lensforge.shop.check_facts import finding_groups
from lensforge.shop.point_tables import GridRequest
from lensforge.shop.shop_files import face_groups, shop_facts, table_facts

_NUMBER = re.compile(r"\d+(?:\.\d+)?[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]*")  # groups of three one by one
_HASH = re.compile(r"\b[0-9a-f]{12,64}\b|\d{4}-\d\d-\d\d \d\d:\d\d UTC")
TEMPLATES = Path(shop_files.__file__).parents[1] / "report" / "templates"


def numbers_in(text: str) -> set[str]:
    """Numbers of a text, without hashes and the time of writing."""
    return set(_NUMBER.findall(_HASH.sub("", text)))


def seen_in(page: str) -> str:
    """Text of a page that a reader sees, without pictures and head, each element apart."""
    body = re.sub(r"<(svg|style|script)\b.*?</\1>", "", page, flags=re.DOTALL).replace("<wbr>", "")
    return unescape(re.sub(r"<[^>]*>", " ", body[body.find("<body") :]))


def texts_of(groups: Iterable[Group]) -> Iterator[str]:
    """All that facts say."""
    for group in groups:
        yield from (group.title, group.note)
        for fact in group.facts:
            yield from said_by(fact)


def said_by(fact: Fact) -> Iterator[str]:
    yield from (fact.label, fact.text, fact.required, fact.bounded_by, fact.note, fact.remedy)
    yield from (fact.limit_note, fact.possible_note, fact.notice)


def known_of(results: Results) -> set[str]:
    """Numbers of the facts of a folder, of its records and its spec, and of sentences that stand in templates."""
    records = [*results.found.values(), *results.others.values()]
    groups = [
        group for record in records for group in results.facts(record, light_section.possible_limits(results.spec))
    ]
    groups += [*headline.criterion_groups(results), *light_section.other_lights(results)]
    groups += [
        *light_section.other_results(results),
        *(tracer_groups(results.proof) if "verify" in results.found else ()),
    ]
    texts = [*texts_of(groups), task(results.spec), headline.times(results) or "", headline.headline(results).criteria]
    texts += [reason for name in ("light", "files", "cutting") for reason in results.verdict.reasons_of(name)]
    texts += [f"{row.path} {row.value}" for table in number_tables(results).values() for row in table]
    texts += [f"{row.path} {row.value}" for table in spec_tables(results).values() for row in table]
    texts += [f"{file.name} {file.size}" for file in exported_part.exported_files(results)]
    texts += results.design.source.warnings if "design" in results.found else ()
    texts += [str(result.conditions) for result in results.others.values()]
    texts += [f"{len(group.facts)} criteria" for group in headline.criterion_groups(results)]
    for study in (record for record in records if isinstance(record, Yield)):
        texts += [pass_sentence(study), budget_sentence(study), *texts_of(drawn_rows(study)), *study.notes]
        texts += [worst_phrase(study, worst) for worst in study.worst]
    texts += [template.read_text(encoding="utf-8") for template in TEMPLATES.glob("*.html")]
    return {number for text in texts for number in numbers_in(text)} | {str(len(results.others)), *map(str, range(40))}


def unknown(text: str, known: set[str]) -> list[str]:
    return sorted(numbers_in(text) - known)


@pytest.mark.parametrize("name", first_by_day(5, FOLDERS))
def test_every_number_of_page_and_notebook_is_one_of_a_fact(name):
    results = folder_of(name)
    known = known_of(results)
    assert unknown(seen_in(undrawn_page_of(results)).partition("Designed with lensforge")[0], known) == []
    with undrawn():
        assert unknown(seen_in(f"<body>{results_html(results)}"), known) == []


@pytest.mark.parametrize("name", FOLDERS)
def test_every_number_of_the_screens_is_one_of_a_fact(name, capsys):
    results = folder_of(name)
    run, known = (
        Run(results.lens, results.found, results.outdated, results.others, folder=Path("run")),
        known_of(results),
    )
    print_screen(summary(run))
    lines = capsys.readouterr().out
    assert len(lines.splitlines()) <= 32
    assert unknown(lines, known) == []
    for stem, result in {**results.found, **results.others}.items():
        print_screen(blocks_of(result, run))
        assert unknown(capsys.readouterr().out.replace(f"run/{stem}.json", ""), known) == [], stem


def test_every_number_of_the_comparison_is_one_of_a_fact():
    designs = [folder_of("every stage"), folder_of("uniform region")]
    known = set.union(*map(known_of, designs))
    with undrawn():
        page = render_comparison(designs, ["a", "b"])
    assert unknown(seen_in(page).partition("Written by")[0], known) == []


def make_tradeoff(lens):
    metrics = {"nmse": Metric(value=0.0123, standard_error=0.0004), "efficiency": Metric(value=0.8134)}
    rows = [
        TradeoffRow(series="presets", setting=name, seconds=seconds, rays=rays, noise_nmse=2.3e-4, **metrics)
        for name, seconds, rays in (("draft", 0.51, 65536), ("standard", 3.2, 524288))
    ]
    rows += [TradeoffRow(series="search", setting="level 1", seconds=4.5, rays=16384, steps=25, functions=9, **metrics)]
    return Tradeoff(
        inputs={"lens": lens.sha256}, name="small", accuracy="draft", threads=2, rows=tuple(rows), seconds=31.5
    )


def test_every_number_of_the_tradeoff_is_one_of_a_fact(capsys):
    tradeoff = make_tradeoff(lens_of())
    groups = [row.facts for row in tradeoff.rows]
    known = {number for text in texts_of(groups) for number in numbers_in(text)}
    print_screen([Block("Error of each preset", list(rows_of(tradeoff.facts)))])
    assert unknown(capsys.readouterr().out, known) == []
    with undrawn():
        page = tradeoff_page(tradeoff)
    tables = re.findall(r"<table.*?</table>", page, flags=re.DOTALL)
    assert len(tables) == 3 and unknown(seen_in("<body>" + " ".join(tables)), known) == []


@pytest.mark.parametrize("name", first_by_day(1, ["moulded", "every stage"], "five seconds each"))
def test_every_number_of_the_page_for_the_shop_is_one_of_a_fact(name):
    results = folder_of(name)
    kept = {}
    with pytest.MonkeyPatch.context() as patch:
        tables = shop_files._tables
        patch.setattr(shop_files, "_tables", lambda *given: kept.update(given=given) or tables(*given))
        made = shop_files.make_handover(results.part, results.check, results.yield_facts, GridRequest(spacing_mm=1.0))
    _, _, drawn, tolerances, grids, hashes = kept["given"]
    lens, part, check = results.lens, results.part, results.check
    criteria = [shown(criterion) for criterion in (*part.criteria, *check.criteria)]
    groups = [shop_facts(lens, part, check), *face_groups(lens, check), *finding_groups(check)]
    texts = [*texts_of([*groups, table_facts(grids), Group("", "", tuple(criteria))]), *hashes, *drawn.notes]
    texts += [
        f"{size.name} {shop_files.shown(size.value_mm)} {size.tolerance} {size.scope_phrase}"
        for size in drawn.views.dimensions
    ]
    rows = [*tolerances.lens, *tolerances.assembly]
    texts += [tolerances.sentence, *(f"{row.name} {row.amount} {row.source} {row.at_most}" for row in rows)]
    texts += [*drawn.views.datums.lines, drawn.title, "A3"]
    page = made.html.decode()
    caption = page[page.index("<figcaption>") :].partition("</figcaption>")[0]
    places = {f"{k}." for k in range(1, len(drawn.notes) + 1)}  # of the notes
    known = {number for text in (*texts, caption, *places) for number in numbers_in(text)}
    assert unknown(seen_in(page), known) == []


def test_a_number_that_no_fact_has_is_found():
    known = {"8.5", "1.20"}
    assert unknown("radius 8.5 mm, ± 1.20", known) == []
    assert unknown("radius 8.50 mm, 345 rays, 1.2 %", known) == ["1.2", "345", "8.50"]
