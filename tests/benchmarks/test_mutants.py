"""The benchmark of single bugs: what is drawn, what is left out, and what is counted."""

import re
from collections import Counter
from pathlib import Path

import pytest
from mutation.draw import Mutant, drawn
from mutation.kept import Outcome, Record, share, stale, table
from mutation.left_out import left_out, within
from mutation.own_tests import files_of, modules

ROOT = Path(__file__).parents[2]


def mutants(module, count):
    return [Mutant(module, "NumberReplacer", k, k, f"{module} {k}") for k in range(count)]


@pytest.mark.parametrize("count", [10, 30, 55])
def test_any_number_of_the_first_ones_has_of_each_module_its_share(count):
    every = [mutants("a.py", 60), mutants("b.py", 40), mutants("c.py", 10), []]
    first = Counter(mutant.module for mutant in drawn(every, seed=3)[:count])
    for module, size in (("a.py", 60), ("b.py", 40), ("c.py", 10)):
        assert abs(first[module] - count * size / 110) < 2


def test_annotations_decorators_and_words_are_left_out_and_nothing_else():
    source = (
        "@cache(8)\ndef f(x: int | None = 2) -> float | None:\n    n: int | str = 3\n    return f'{x + 1}', x + 4\n"
    )
    places, lines = left_out(source), source.split("\n")
    kept = [
        text[match.start()]
        for number, text in enumerate(lines, start=1)
        for match in re.finditer(r"[|+\d]", text)
        if not within((number, match.start()), places)
    ]
    assert kept == ["2", "3", "+", "4"]


def test_every_measured_module_and_its_tests_are_there():
    assert len(modules()) > 50
    for module in modules():
        assert (ROOT / "lensforge" / module).is_file()
        assert all((ROOT / "tests" / f"{name}.py").is_file() for name in files_of(module))


def test_a_number_gives_two_mutants_and_a_name_that_lines_above_do_not_change(tmp_path):
    pytest.importorskip("cosmic_ray")
    from mutation.draw import mutants_of, mutated

    module = tmp_path / "m.py"
    module.write_text("x = 7\n")
    number_mutants = mutants_of(tmp_path, "m.py")
    assert [mutated("x = 7\n", mutant).split() for mutant in number_mutants] == [["x", "=", "8"], ["x", "=", "6"]]
    module.write_text("y = 'no number'\nx = 7\n")
    assert [mutant.key for mutant in mutants_of(tmp_path, "m.py")] == [mutant.key for mutant in number_mutants]


def test_bugs_are_counted_without_those_that_are_none(tmp_path, monkeypatch):
    record = Record(tmp_path / "kept.json", 5, {"a/m.py": 40, "b/m.py": 60})
    ends = [("failed", "failed"), ("passed", "failed"), ("passed", "passed"), ("time", "time"), ("passed", "passed")]
    for k, (first, now) in enumerate(ends):
        record.outcomes[f"a/{k}"] = Outcome(f"a/{k}", "a/m.py", "x", "y", first, now, 1.0)
    record.save()
    assert Record.load(record.path, 5) == record
    monkeypatch.setattr("mutation.kept.equivalent", lambda: {"a/4": "the same value"})
    z2 = 1.959963984540054**2
    low, high = ((0.5 + z2 / 8 + sign * (z2 / 16 + z2**2 / 64) ** 0.5) / (1 + z2 / 4) for sign in (-1, 1))  # Wilson
    assert share(2, 4) == f"2 (50 %, {100 * low:.0f} to {100 * high:.0f})" == "2 (50 %, 15 to 85)"
    assert "| `a` | 40 | 5 | 1 | 2 (50 %, 15 to 85) | 3 (75 %, 30 to 95) | 1 |" in table(record)
    with pytest.raises(SystemExit, match="has the seed 5"):
        Record.load(record.path, 6)


def test_a_reason_whose_line_is_gone_is_named(tmp_path, monkeypatch):
    (tmp_path / "m.py").write_text("x = 7\n", encoding="utf-8")
    reasons = {"m.py: x = 7 @1 NumberReplacer 1": "", "m.py: x = 8 @1 NumberReplacer 1": "", "n.py: x = 7 @1 Not 1": ""}
    monkeypatch.setattr("mutation.kept.equivalent", lambda: reasons)
    assert stale(tmp_path) == [*reasons][1:]
