"""Lenses of several kinds in a result folder: the verdict counts every part, the page leads to each, studies refuse."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from scenes import small_spec, sphere

import lensforge as lf
from lensforge.errors import InputError
from lensforge.report.headline import kinds
from lensforge.report.results import Results
from lensforge.report.stored import RunRecord, verdicts_of_kinds
from lensforge.results.verdict import Verdict
from lensforge.scene.lens import Lens

GRID = {"kind": "grid", "columns": 3, "rows": 3, "pitch_mm": 20.0, "kinds": "place"}
PASSES = Verdict.of([], [], [])
FAILS = Verdict.of([("fail", "dark")], [("fail", "STEP is not valid")], [("fail", "too tight")])


def three_kinds() -> Lens:
    spec = small_spec(lamps=GRID, base={"kind": "none"}, target__receiver_mm=200.0)
    faces = [{"inner": sphere(3.0), "outer": sphere(radius)} for radius in (6.0, 6.2, 6.4)]
    return Lens(faces[0], spec, 0, "draft", others={"edge": faces[1], "corner": faces[2]})


def test_the_verdict_on_several_parts_is_the_worst_and_names_them() -> None:
    """Their light is the same."""
    found = PASSES.with_parts({"edge": PASSES, "corner": FAILS})
    assert (found.light, found.files, found.cutting) == ("pass", "fail", "fail")
    assert found.reasons.files == ("corner: STEP is not valid",) and found.reasons.light == ()
    assert FAILS.with_parts({}) == FAILS


def test_a_kind_counts_by_the_record_of_its_own_lens(tmp_path: Path) -> None:
    lens = three_kinds()
    for kind, verdict in (("edge", FAILS), ("corner", PASSES)):
        (tmp_path / kind).mkdir()
        lens.of_kind(kind).save(tmp_path / kind / "lens.json")
        given = {"name": "small", "accuracy": "draft", "seed": 0, "results": {}, "others": {}, "outdated": {}}
        RunRecord(**given, verdict=verdict).write(tmp_path / kind)
    assert verdicts_of_kinds(tmp_path, lens) == {"edge": FAILS, "corner": PASSES}
    lens.of_kind("edge").save(tmp_path / "corner" / "lens.json")
    later = verdicts_of_kinds(tmp_path, lens)["corner"]
    assert later.files == "undecided" and "the folder corner has no part of this lens" in later.reasons.files[0]
    assert verdicts_of_kinds(tmp_path, lens.of_kind("corner")) == {}
    assert verdicts_of_kinds(tmp_path, replace(lens, others={}, spec=small_spec())) == {}


def test_each_page_leads_to_those_of_the_other_kinds() -> None:
    lens = three_kinds()
    first, corner = (kinds(Results(each), linked=True) for each in (lens, lens.of_kind("corner")))
    assert [(each.name, each.lamps, each.page) for each in first] == [
        ("middle", 1, None),
        ("edge", 4, "edge/report.html"),
        ("corner", 4, "corner/report.html"),
    ]
    assert [each.page for each in corner] == ["../report.html", "../edge/report.html", None]
    assert kinds(Results(replace(lens, others={}, spec=small_spec())), linked=True) == []


@pytest.mark.parametrize(
    ("verb", "study"),
    [
        ("correct", lambda lens: lf.correct(lens, points="points.csv", surface="outer")),
        ("compare", lambda lens: lf.compare(lens, points="points.csv", surface="outer")),
        ("tradeoff", lambda lens: lf.tradeoff(lens.spec)),
    ],
)
def test_studies_of_one_lens_refuse_several_in_one_line(verb: str, study: Callable[[Lens], object]) -> None:
    with pytest.raises(InputError, match=f"{verb}: .*lamps.kinds"):
        study(three_kinds())
