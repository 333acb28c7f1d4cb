"""The section of the report on the yield, and the drawing's tolerances, say what the record holds."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from made_yield import PARTS, make_yield
from page_text import Page, folded, text_of, undrawn_page_of
from result_folders import make_results, small_lens, with_leds
from scenes import part_tolerances
from shown_folders import make_sensitivity

from lensforge.made.tolerance_result import FluxNeeded, Variance
from lensforge.made.yield_facts import (
    application_rows,
    budget_row,
    budget_rows,
    cause_rows,
    metric_label,
    sensitivity_facts,
    spread_rows,
    yield_facts,
)
from lensforge.report import yield_section
from lensforge.results import Conditions, Metric
from lensforge.results.chart import light_unit
from lensforge.results.numerals import percent
from lensforge.shop.sheet_tables import tolerance_table
from lensforge.spec.tolerances_section import PartTolerances, amount_words


@pytest.fixture(scope="module")
def lens():
    return small_lens()


@pytest.fixture(scope="module")
def yield_record(lens):
    return make_yield(lens)


@pytest.fixture(scope="module")
def html(lens, yield_record):
    return undrawn_page_of(make_results(("evaluate",), lens, **{"yield": yield_record}))


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


def test_who_passes_is_said_first_with_its_interval(page, yield_record):
    rate = yield_record.pass_rate
    assert rate.value == 38 / PARTS
    interval = f"{percent(rate.low)} to {percent(rate.high)}".replace("\u2009", " ")
    text = page.text.replace("\u2009", " ")
    assert (
        f"Yield 95 % (95 % confidence: {interval}): 38 of {PARTS} parts drawn from the tolerances meet all limits."
        in text
    )
    assert text.index("meet all limits") < text.index("Distribution over the parts")


def test_every_percentile_and_bound_is_on_the_page(page, yield_record):
    for row, (name, spread) in zip(spread_rows(yield_record), yield_record.metrics.items(), strict=True):
        assert row.title == metric_label(name)
        factor = 100.0 if row.facts[0].unit == "%" else 1.0
        wanted = (spread.designed.value, spread.p5, spread.p50, spread.p95, spread.spread)
        assert [fact.value for fact in row.facts] == [factor * value for value in wanted]
        for text in (row.title, *(fact.text for fact in row.facts)):
            assert folded(text) in page.text, text
    assert "≤ 0.0985" in page.text and "outweighs the spread of the parts" not in page.text


def test_every_tolerance_is_on_the_page_with_its_largest_amount(page, yield_record):
    rows = budget_rows(yield_record)
    assert len(rows) == len(yield_record.tolerances) + 1
    for row, record in zip(rows, (*yield_record.budget.alone, yield_record.budget.together), strict=True):
        assert row.title == record.words
        for fact in row.facts:
            assert folded(fact.text) in page.text, fact
    assert [row.fact("at_most").text for row in rows[:3]] == ["0.075 mm", "above 0.8 mm", "0.75°"]
    assert [row.fact("at_most").state for row in rows[:3]] == ["pass", "pass", "pass"]
    assert (rows[-1].fact("at_most").text, rows[-1].fact("at_most").state) == ("× 0.875", "fail")


def test_the_first_group_tells_who_passes_then_what_decides_then_the_budget(yield_record):
    told = yield_facts(yield_record)[0]
    texts = [(fact.label, fact.text.replace("\u2009", " ")) for fact in told.facts if fact.key != "main_cause"]
    assert texts == [
        ("Yield", "95 %"), ("Parts", f"{PARTS}"), ("Rays of each part", f"{yield_record.rays}"),
        ("Tolerances together", "× 0.875"), ("Required yield", "95 %"),
    ]  # fmt: skip
    notes = {fact.key: fact.note.replace("\u2009", " ") for fact in told.facts}
    interval = yield_record.budget.together.interval_words.replace("\u2009", " ")
    assert notes["together"] == f"one factor on all, for a yield of 95 %; {interval}"
    low, high = (
        percent(end).replace("\u2009", " ") for end in (yield_record.pass_rate.low, yield_record.pass_rate.high)
    )
    assert notes["pass_rate"] == f"95 % confidence: {low} to {high}"


def test_each_road_is_on_the_page_with_the_parts_that_hold_its_class(page, yield_record):
    figures = "90 %, 76.9 % to 96 %, nmse, of 62.5 % of the parts".replace(" %", "\u2009%").split(", ", 2)
    causes = ("source, decentre, 50.0 ± 6.2\u2009%", "undecided: within the ray noise")
    for number, (row, main) in enumerate(zip(application_rows(yield_record), causes, strict=True), start=1):
        assert [fact.text for fact in row.facts] == ["M3", *figures, main]
        assert row.title == f"Road {number}" and folded(main) in page.text and folded(figures[2]) in page.text


def test_a_tolerance_of_which_no_amount_is_small_enough_is_named(yield_record):
    row = budget_row(yield_record.budget.alone[0].model_copy(update={"at_most": None, "low": None, "high": None}))
    assert row.fact("interval").text == "the other tolerances alone give too low a yield"
    assert (row.fact("at_most").text, row.fact("at_most").state) == ("–", "fail")


def test_what_reaches_the_required_yield_is_said_where_it_is_missed(lens, yield_record):
    """The second tolerance need shrink by a third, the third by more; none; none alone; and the flux."""
    assert not [fact for fact in yield_facts(yield_record)[0].facts if fact.key in ("cheapest", "flux")]
    low = yield_record.pass_rate.changed(value=0.9)
    flux = FluxNeeded(pass_rate=0.95, factor=1.0421, low=1.03, high=None, most=0.96, best=1.05)

    def first(**changes):
        budget = yield_record.budget.model_copy(update=changes)
        return yield_facts(yield_record.model_copy(update={"pass_rate": low, "budget": budget, "flux": flux}))[0]

    one, other, third, *rest = yield_record.budget.alone
    scales = {other: 2.0 / 3.0, third: 0.5}
    tight = [
        row.changed(at_most=scale * row.specified, low=0.6 * row.specified, high=0.9 * row.specified, unlimited=False)
        for row, scale in scales.items()
    ]
    facts = first(alone=(one, *tight, *rest))
    assert facts.fact("cheapest").text == "source, height, from 0.05 mm to 0.0333 mm"
    assert facts.fact("cheapest").note == (
        "for a yield of 95\u2009%, the others as specified; 0.03 mm to 0.045 mm, by 40 parts"
    )
    assert (facts.fact("flux").text, facts.fact("flux").note) == (
        "× 1.042", "for a yield of 95\u2009%, tolerances as specified; × 1.03 at least",
    )  # fmt: skip
    assert first().fact("cheapest").text == "none is enough"
    few = flux.changed(factor=None, low=None, most=0.9)
    for named_flux, phrase in (
        (few, "× 1.05 gives the highest, 90\u2009%"),
        (few.changed(best=None), "no part passes at any flux"),
    ):
        fact = yield_facts(yield_record.model_copy(update={"flux": named_flux}))[0].fact("flux")
        assert (fact.text, fact.note) == (
            "none is enough",
            f"for a yield of 95\u2009%, tolerances as specified; {phrase}",
        )
    enough = yield_record.budget.together.changed(at_most=1.1, high=1.2)
    assert first(together=enough).fact("cheapest").text == "none"
    study = yield_record.model_copy(update={"pass_rate": low, "flux": flux})
    text = Page(undrawn_page_of(make_results(("evaluate",), lens, **{"yield": study}))).text
    assert "none is enough" in text and "× 1.042" in text


def test_shares_are_in_per_cent_and_other_numbers_in_their_unit():
    assert amount_words("source_flux", 0.05, "") == "5\u2009%" and amount_words("index", 0.001, "") == "0.001"
    assert amount_words("source_tilt_deg", 0.5, "deg") == "0.5°" and amount_words("inner_form_um", 1.0, "um") == "1 µm"


def test_causes_worst_parts_and_remarks_are_there_and_text_is_escaped(page, html, yield_record):
    assert cause_rows(yield_record)[0].line.startswith("source, decentre 50.0 ± 6.2\u2009%, ")
    assert f"Part {PARTS - 1}: fails" in page.text
    assert "a &lt;remark&gt; of the study" in html and "a <remark>" not in html


def test_a_cause_within_two_standard_errors_is_shown_nowhere(yield_record):
    first, second, *_ = yield_record.variance["nmse"].causes
    doubtful = {"share": 1.99 * first.standard_error}
    variance = Variance(
        causes=(second, first.model_copy(update=doubtful)), interactions=Metric(value=0.1, standard_error=0.051)
    )
    few = yield_record.model_copy(update={"variance": {"nmse": variance}})
    assert [fact.label for row in cause_rows(few) for fact in row.facts] == [second.words]
    sure = Variance(causes=(second, first), interactions=Metric(value=0.103, standard_error=0.051))
    rows = cause_rows(yield_record.model_copy(update={"variance": {"nmse": sure}}))
    assert [fact.label for row in rows for fact in row.facts] == [second.words, first.words, "interactions"]
    none = Variance(causes=(first.model_copy(update=doubtful),), interactions=Metric(value=0.5, standard_error=0.3))
    nobody = yield_facts(yield_record.model_copy(update={"variance": {"nmse": none}}))
    assert [fact.text for group in nobody for fact in group.facts if fact.key in ("main_cause", "together")] == [
        "not significant with so few parts", budget_row(yield_record.budget.together).fact("at_most").text,
        "not significant with so few parts",
    ]  # fmt: skip


def test_no_budget_and_no_causes_are_said(lens, yield_record):
    text = text_of(
        make_results((), lens, **{"yield": yield_record.model_copy(update={"budget": None, "variance": {}})})
    )
    assert "Largest tolerances" not in text
    assert "No share is significant against the noise of rays and parts." in text
    assert 'id="yield"' not in undrawn_page_of(make_results((), lens))


def test_the_drawing_has_the_tolerances_of_the_spec_and_says_where_they_are_from(lens):
    given = PartTolerances(preset="precision", faces={"outer": {"gap_mm": 0.0123}})
    spec = lens.spec.with_tolerances(given)
    assert spec.part_tolerances == given
    table = tolerance_table(type(lens)(lens.surfaces, spec, 0, "draft"))
    rows = {row.name: row for row in (*table.lens, *table.assembly)}
    gap, decentre = rows["outer face against inner, gap"], rows["outer face against inner, decentre"]
    assert (gap.amount, gap.source, gap.at_most) == ("± 0.0123 mm", "specification", "")
    assert (decentre.amount, decentre.source) == ("± 0.005 mm", "preset “precision”")
    assert rows["form, inner face"].amount == "0.3 µm rms" and rows["form, inner face"] in table.lens
    assert rows["source, tilt"] in table.assembly
    assert "not computed yet" in table.sentence


def test_the_drawing_has_the_largest_amounts_of_the_yield_study(lens, yield_record):
    table = tolerance_table(lens, yield_facts(yield_record))
    rows = {row.name: row for row in (*table.lens, *table.assembly)}
    assert rows["source, decentre"].at_most == "0.075 mm"
    assert rows["source, height"].at_most == "above 0.8 mm"
    assert table.sentence.startswith("Yield 95\u2009% of 40 parts")


def test_a_spec_without_tolerances_has_no_table(lens):
    spec = lens.spec.with_tolerances(part_tolerances())
    table = tolerance_table(type(lens)(lens.surfaces, spec, 0, "draft"))
    assert (table.lens, table.assembly) == ((), ()) and table.sentence == "The specification sets no tolerances."


def test_the_table_of_parts_keeps_names_with_commas_whole(yield_record):
    renamed = yield_record.model_copy(update={"columns": (*yield_record.columns[:-1], 'wall, left: "share"')})
    rows = list(csv.reader(io.StringIO(renamed.products()[".csv"].decode())))
    assert rows[0] == ["part", *renamed.columns] and len(rows) == PARTS + 1
    np.testing.assert_allclose(np.array(rows[1:], dtype=float)[:, 1:], yield_record.table, rtol=1e-8)


def test_a_yield_by_other_tolerances_has_a_section_of_its_own(lens, yield_record):
    other = yield_record.model_copy(update={"conditions": Conditions.of(tolerances="moulded")})
    results = replace(make_results(("evaluate",), lens, **{"yield": yield_record}), others={"yield_moulded": other})
    both = Page(undrawn_page_of(results)).text
    assert both.count("Distribution over the parts") == 2 and "yield_moulded.csv" in both
    assert str(other.conditions) in both


def test_the_worst_parts_of_a_lattice_are_drawn_over_all_its_periods(monkeypatch):
    """Three by three periods of 60 x 40 mm: axes of 180 x 120 mm, as for the light as designed."""
    drawn = []
    monkeypatch.setattr(yield_section, "picture", lambda name, figure, *_: drawn.append(figure.axes[0]))
    disc = {"kind": "disc", "diameter_mm": 20.0}
    plane = {"kind": "plane", "centre_mm": [0.0, 0.0, 100.0], "width_mm": 60.0, "height_mm": 40.0, "targets": [disc]}
    lamps = {"kind": "endless", "pitch_mm": [60.0, 40.0]}
    lens = small_lens(wanted={"receivers": [plane], "lamps": lamps})
    record = make_yield(lens).model_copy(update={"worst_maps": np.ones((1, 33, 48))})
    yield_section._worst_pictures("yield", record, make_results((), lens))
    for axes in drawn:
        assert [*np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1)] == pytest.approx([180.0, 120.0])
    assert drawn


def test_the_page_shows_each_led_and_the_worst_parts_by_the_one_that_decides(lens, monkeypatch):
    """The second LED has half of the lumens: its light is in its own lux; rows of both stand in one table."""
    light = make_results(("evaluate",), lens).found["evaluate"].changed(lumens_per_watt=300.0)
    lens = with_leds(lens, "near", "far")
    dimmer = light.changed(lumens_per_watt=150.0)
    light = type(light).joined({"near": light, "far": dimmer})
    record = make_yield(lens)
    renamed = {f"far: {name}": spread for name, spread in record.metrics.items()}
    changes = {name.removeprefix("far: "): name for name in renamed}
    study = record.model_copy(
        update={
            "leds": ("near", "far"), "worst_leds": ("far",), "metrics": renamed, "variance": {},
            "bounds": tuple(bound.changed(metric=changes[bound.metric]) for bound in record.bounds),
            "columns": tuple(changes.get(name, name) for name in record.columns),
            "worst": tuple(
                part.changed(metrics={changes[k]: v for k, v in part.metrics.items()}) for part in record.worst
            ),
        }
    )  # fmt: skip
    alone = make_sensitivity()
    errors = type(alone).joined({"near": alone, "far": alone.changed(rays=99)})
    records = {"evaluate": light, "yield": study, "sensitivity": errors}
    text = Page(undrawn_page_of(make_results((), lens, **records))).text
    for phrase in ("meet all limits with each of 2 LEDs", "Yield with far", "Changes by each of 2 errors"):
        assert phrase in text, phrase
    assert "As designed, far" in text and "Part 39, far: fails" in text and "As designed, near" not in text
    assert "decentre in x, near" in text and "decentre in x, far" in text
    tops = []
    monkeypatch.setattr(yield_section, "irradiance_map", lambda *_, unit: tops.append(unit))
    monkeypatch.setattr(yield_section, "picture", lambda *_: None)
    yield_section._worst_pictures("yield", study, make_results((), lens, **records))
    assert tops == 2 * [light_unit(150.0, far_field=False)]


def test_each_of_the_worst_parts_has_its_own_led_verdict_figures_and_picture(lens):
    record = make_yield(lens)
    (worst,) = record.worst
    other = worst.changed(part=7, metrics={**worst.metrics, "nmse": 0.01234}, passes=True)
    pictures = np.stack([np.ones((4, 4)), np.full((4, 4), 2.0)])
    study = record.model_copy(update={"worst": (worst, other), "worst_leds": ("near", "far"), "worst_maps": pictures})
    (led, title, caption, image), (second_led, second_title, second_caption, second_image) = yield_section._worst_maps(
        study
    )
    assert (led, title) == ("near", f"Part {worst.part}, near: fails") and image[0, 0] == 1.0
    assert (second_led, second_title) == ("far", "Part 7, far: passes") and second_image[0, 0] == 2.0
    assert "0.0123" in second_caption and "0.0123" not in caption
    assert "limit" in caption and "limit" not in second_caption


def test_the_tolerance_with_the_largest_effect_comes_first_either_way():
    (row,) = make_sensitivity().rows
    rows = []
    for name, change in (("small", 1e-4), ("large", -3e-3), ("middle", 1e-3)):
        moved = row.change.model_copy(update={"nmse": Metric(value=change, standard_error=1e-6)})
        rows.append(row.model_copy(update={"name": name, "change": moved}))
    titles = [group.title for group in sensitivity_facts(make_sensitivity(rows=tuple(rows)))]
    assert [next(name for name in ("small", "large", "middle") if name in title) for title in titles[1:]] == [
        "large", "middle", "small",
    ]  # fmt: skip
