"""Lenses of several kinds in a folder: verdict and sweep count every part, each page leads to the others."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from filled import filled
from result_folders import make_results
from scenes import small_spec, sphere

import lensforge as lf
from lensforge.cli.conclusion import _manufacture
from lensforge.cli.progress import DesignProgress
from lensforge.report.headline import kinds
from lensforge.report.pipeline import _of_lens
from lensforge.report.results import Results
from lensforge.report.stored import RunRecord, verdicts_of_kinds
from lensforge.report.sweep import _row
from lensforge.report.variation import Variant
from lensforge.results.criteria import at_most
from lensforge.results.verdict import Verdict
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Margins
from lensforge.shop.check_measures import Cutter
from lensforge.spec.spec_files import section_sha256

GRID = {"kind": "grid", "columns": 3, "rows": 3, "pitch_mm": 20.0, "kinds": "place"}
PASSES = Verdict.of([], [], [])
FAILS = Verdict.of([("fail", "dark")], [("fail", "STEP is not valid")], [("fail", "too tight")])


def three_kinds() -> Lens:
    spec = small_spec(lamps=GRID, base={"kind": "none"}, target__receiver_mm=200.0)
    faces = [{"inner": sphere(3.0), "outer": sphere(radius)} for radius in (6.0, 6.2, 6.4)]
    return Lens(faces[0], spec, 0, "draft", others={"edge": faces[1], "corner": faces[2]})


def test_the_verdict_on_several_parts_is_the_worst_and_names_them() -> None:
    """Their light is the same."""
    verdict = PASSES.with_parts({"edge": PASSES, "corner": FAILS})
    assert (verdict.light, verdict.files, verdict.cutting) == ("pass", "fail", "fail")
    assert verdict.reasons.files == ("corner: STEP is not valid",) and verdict.reasons.light == ()
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


def test_the_screen_names_the_kind_that_cannot_be_cut_and_its_folder(tmp_path: Path) -> None:
    """All rows of the first kind, whose check is shown, may hold."""
    lens, verdict = three_kinds(), PASSES.with_parts({"edge": FAILS, "corner": PASSES})
    results = make_results(("check",), lens)
    run = SimpleNamespace(folder=tmp_path, lens=lens, spec=lens.spec, find=results.find, facts=results.facts)
    rows = dict(_manufacture(SimpleNamespace(**vars(run), verdict=verdict)))
    assert rows["Not met"] == "edge: too tight" and rows["Remedy"] == f"see `lensforge check {tmp_path / 'edge'}`"
    assert not {"Not met", "Remedy"} & set(dict(_manufacture(SimpleNamespace(**vars(run), verdict=PASSES))))


@pytest.mark.parametrize(
    ("kinds_of", "sigma_deg", "shown"),
    [("place", None, "level 4/4"), ("one", None, "level 4/2"), ("one", 2.0, "level 4/4"), ("place", 2.0, "level 4/6")],
)
def test_the_levels_of_all_searches_are_counted(kinds_of: str, sigma_deg: float | None, shown: str) -> None:
    """For one lens and for all kinds; of a frosted lens first for the polished one."""
    heard = list[str]()
    frosted = {"offset_mm": 6.0, "scatter": sigma_deg and {"kind": "gaussian", "sigma_deg": sigma_deg}}
    spec = small_spec(
        lamps={**GRID, "kinds": kinds_of}, base={"kind": "none"}, target__receiver_mm=200.0, lens__outer=frosted
    )
    clock = SimpleNamespace(live=True, show=heard.append, note=heard.append, expect=lambda *_, **__: None)
    step = SimpleNamespace(level=3, nmse=0.1, steps_done=1, steps_total=9, seconds=1.0, within="")
    DesignProgress(clock, spec).on_step(step)
    assert heard[-1] == f"{shown}, NMSE 0.1000"


@pytest.mark.parametrize(("radius_mm", "shown"), [(999.0, 999.0), (1000.0, "any"), (None, "any")])
def test_what_is_nearly_flat_limits_no_tip(radius_mm: float | None, shown: float | str) -> None:
    cutter = Cutter(radius_mm=1.0, reachable_fraction=1.0, largest_radius_mm=radius_mm, residual_mm=0.0)
    assert cutter.usable_radius_mm == shown


def test_each_page_leads_to_those_of_the_other_kinds() -> None:
    lens = three_kinds()
    first, corner = (kinds(Results(design), linked=True) for design in (lens, lens.of_kind("corner")))
    assert [(row.name, row.lamps, row.page) for row in first] == [
        ("middle", 1, None),
        ("edge", 4, "edge/report.html"),
        ("corner", 4, "corner/report.html"),
    ]
    assert [row.page for row in corner] == ["../report.html", "../edge/report.html", None]
    assert kinds(Results(replace(lens, others={}, spec=small_spec())), linked=True) == []


def test_a_row_of_a_sweep_counts_the_part_of_every_kind() -> None:
    """Criteria of further kinds are named by them, and the worst part decides on the cutting."""
    light, kinds = lf.evaluate(three_kinds(), rays=256, pixels=8), []
    design = SimpleNamespace(max_radius_mm=6.4, height_mm=5.0, steps=3, seconds=1.0, constraints=filled(Margins))
    for kind, verdict, height in (("middle", PASSES, 1.0), ("edge", FAILS, 3.0), ("corner", PASSES, 2.0)):
        criteria = [("check", at_most("height", height, 2.5, "mm", "lower it"))]
        lens = SimpleNamespace(kind=kind)
        kinds.append(SimpleNamespace(lens=lens, light=light, design=design, verdict=verdict, criteria=criteria.copy))
    row = _row(Variant(1.0, {}, small_spec()), kinds)
    assert [(criterion.key, criterion.holds) for criterion in row.criteria] == [
        ("height", True), ("edge: height", False), ("corner: height", True)
    ]  # fmt: skip
    assert (row.cutting, row.efficiency) == ("fail", light.efficiency)


def test_results_in_the_folder_of_a_kind_are_of_its_lens_and_of_the_same_source() -> None:
    lens = three_kinds()
    corner = lens.of_kind("corner")
    light = lf.evaluate(lens, rays=256, pixels=8)
    inputs = _of_lens(light, corner).inputs
    assert inputs["lens"] == corner.sha256 != light.inputs["lens"] == lens.sha256
    assert inputs["source"] == section_sha256(lens.spec.source)
