"""A yield record agrees with its own table and with the spec; one that was changed does not."""

import pytest
from made_yield import make_yield
from result_folders import small_lens

from lensforge.agreement.parts import yield_contradictions
from lensforge.agreement.record import contradiction
from lensforge.records import Conditions, Metric


@pytest.fixture(scope="module")
def lens():
    return small_lens()


@pytest.fixture(scope="module")
def found(lens):
    return make_yield(lens)


def changed(record, path, value):
    """``record`` with another value at a dotted path."""
    first, _, rest = path.partition(".")
    if isinstance(record, tuple):
        index = int(first)
        one = changed(record[index], rest, value) if rest else value
        return (*record[:index], one, *record[index + 1 :])
    if isinstance(record, dict):
        return {**record, first: changed(record[first], rest, value) if rest else value}
    return record.model_copy(update={first: changed(getattr(record, first), rest, value) if rest else value})


def test_a_record_agrees_with_itself(found, lens):
    assert list(yield_contradictions(found, lens)) == []
    assert contradiction(found, lens, {}) == ""


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("parts", 41, "parts = 41"),
        ("seed", 1, "seed = 1"),
        ("preset", "moulded", "preset = 'moulded'"),
        ("pass_rate.value", 1.0, "pass_rate.value = 1"),
        ("pass_rate.low", 0.9, "pass_rate.low = 0.9"),
        ("pass_rate.high", 1.0, "pass_rate.high = 1"),
        ("bounds.0.bound", 0.05, "pass_rate.value"),
        ("bounds.0.metric", "rsd", "bounds: 'rsd' is no metric"),
        ("metrics.nmse.p5", 0.02, "metrics.nmse.p5"),
        ("metrics.nmse.p95", 0.001, "metrics.nmse.p95"),
        ("metrics.nmse.spread", 0.5, "metrics.nmse.spread"),
        ("metrics.nmse.mean", Metric(value=0.01), "metrics.nmse.mean"),
        ("variance.nmse.causes.0.share", 0.9, "variance.nmse.interactions"),
        ("variance.nmse.causes.1.share", 0.9, "the surest share is not the first"),
        ("variance.nmse.causes.0.tolerance", "index", "not the tolerances that were drawn"),
        ("budget.alone.0.low", 1e3, "budget: source_shift_mm.at_most"),
        ("budget.alone.0.high", None, "an amount without its interval"),
        ("budget.alone.0.specified", 9.0, "not the tolerances that were drawn"),
        ("budget.alone.0.unlimited", True, "unlimited, but with a largest amount"),
        ("budget.alone.0.searched_to", 9.0, "not all tolerances were searched to the same multiple"),
        ("budget.alone.1.unlimited", False, "budget: source_height_mm.unlimited = False"),
        ("budget.pass_rate", 0.5, "budget.pass_rate = 0.5"),
        ("budget.parts", 1000, "budget.parts"),
        ("worst.0.metrics.nmse", 0.05, "worst.0.nmse"),
        ("worst.0.passes", True, "worst.0.passes"),
        ("worst.0.part", 40, "worst.0.part = 40"),
        ("worst", (), "worst: 0 parts"),
        ("tolerances.0.amount", 0.01, "tolerances: not those of the spec"),
        ("columns.0", "of another", "columns: do not begin with the tolerances"),
        ("columns", ("nmse",), "columns: 1 names"),
    ],
)
def test_a_changed_number_is_named(found, lens, path, value, words):
    phrases = list(yield_contradictions(changed(found, path, value), lens))
    assert any(words in phrase for phrase in phrases), phrases


def test_a_part_of_the_table_that_fails_lowers_the_pass_rate(found, lens):
    table = found.table.copy()
    table[0, found.columns.index("nmse")] = 0.2
    phrases = list(yield_contradictions(found.model_copy(update={"table": table}), lens))
    assert any(phrase.startswith("pass_rate.value = 0.95, but") for phrase in phrases)


def test_tolerances_and_seed_may_be_those_of_other_conditions(found, lens):
    other = Conditions.of(tolerances="moulded", tolerances_sha256="ab" * 32, seed=4)
    moved = found.model_copy(update={"conditions": other, "seed": 4, "preset": "moulded"})
    assert list(yield_contradictions(moved, lens)) == []
