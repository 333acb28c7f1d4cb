"""The verdict from the records of the stages: each bound from both sides, and what counts for an exit."""

import numpy as np
import pytest
from result_folders import PIXELS, criterion, make_results, small_lens
from result_folders import finding as any_finding

from lensforge.errors import CriterionMissed
from lensforge.lens import Lens
from lensforge.manufacturing.result import Finding
from lensforge.records import Metric
from lensforge.results import Results
from lensforge.spec import parse_spec
from lensforge.verdict import LARGEST_NMSE, LEAST_SHARE, Verdict

TRANSMITTED = (1.0 - (0.4936 / 2.4936) ** 2) ** 2  # of PMMA's two faces at normal incidence: 0.9232
FLAT = np.ones((PIXELS, PIXELS))


def metric(value: float, error: float | None = 1e-4) -> Metric:
    return Metric(value=value, standard_error=error)


def lit(nmse: Metric | None = None, share: Metric | None = None, target: np.ndarray = FLAT) -> Verdict:
    """The verdict on a lens with these figures of its light."""
    light = {"nmse": nmse or metric(0.01), "share_in_target": share or metric(0.85), "target_map": target}
    return make_results(evaluate=light).verdict


def with_manufacture(**fields: object) -> Lens:
    lens = small_lens()
    spec = parse_spec(lens.spec.model_dump() | {"manufacture": fields}, "test")
    return Lens(lens.inner, lens.outer, spec, lens.seed, lens.accuracy)


def test_a_good_lens_passes_and_needs_nothing() -> None:
    verdict = make_results().verdict
    assert (verdict.light, verdict.files, verdict.cutting) == ("pass", "pass", "pass")
    verdict.require(small_lens().spec)


@pytest.mark.parametrize(
    ("value", "error", "state"),
    [
        (LARGEST_NMSE - 0.003, 0.001, "pass"),
        (LARGEST_NMSE - 0.0019, 0.001, "undecided"),
        (LARGEST_NMSE, 0.0, "undecided"),
        (LARGEST_NMSE + 0.0019, 0.001, "undecided"),
        (LARGEST_NMSE + 0.003, 0.001, "fail"),
        (0.46, 0.001, "fail"),
        (-1e-5, 1e-5, "pass"),  # without noise it may come out below 0
        (0.01, None, "undecided"),
        (0.46, None, "undecided"),
    ],
)
def test_nmse_is_judged_outside_two_standard_errors(value: float, error: float | None, state: str) -> None:
    verdict = lit(nmse=metric(value, error))
    assert verdict.light == state
    assert (verdict.reasons.light == ()) == (state == "pass")
    assert all("NMSE" in reason and "at most 0.1" in reason for reason in verdict.reasons.light)


@pytest.mark.parametrize(
    ("excess", "state"), [(0.003, "pass"), (0.0015, "undecided"), (-0.0015, "undecided"), (-0.003, "fail")]
)
def test_the_share_in_the_target_is_judged_against_what_two_faces_transmit(excess: float, state: str) -> None:
    verdict = lit(share=metric(LEAST_SHARE * TRANSMITTED + excess, 0.001))
    assert verdict.light == state
    assert all("share of the light" in reason for reason in verdict.reasons.light)


def test_a_picture_with_much_light_in_its_dark_parts_is_judged_by_its_bright_ones() -> None:
    """Half of the picture at 9 % of the other half: no lens puts more than 92 % of the light there."""
    picture = FLAT.copy()
    picture[: PIXELS // 2] = 0.09
    bound = LEAST_SHARE * TRANSMITTED / 1.09
    assert lit(share=metric(bound + 0.001, 1e-4), target=picture).light == "pass"
    assert lit(share=metric(bound - 0.001, 1e-4), target=picture).light == "fail"


def test_stages_that_have_not_run_leave_their_part_undecided() -> None:
    for missing, parts in (
        ("evaluate", {"light"}),
        ("export", {"files"}),
        ("verify", {"files"}),
        ("check", {"cutting"}),
    ):
        stages = [stem for stem in ("design", "evaluate", "export", "check", "verify") if stem != missing]
        verdict = make_results(stages).verdict
        states = {name: getattr(verdict, name) for name in ("light", "files", "cutting")}
        assert {name for name, state in states.items() if state == "undecided"} == parts, missing
        assert set(states.values()) <= {"pass", "undecided"}
        verdict.require(small_lens().spec)  # undecided is no failure


@pytest.mark.parametrize("stem", ["design", "export", "check", "verify"])
def test_a_missed_criterion_of_a_stage_fails_the_files(stem: str) -> None:
    verdict = make_results(**{stem: {"criteria": (criterion("something", 2.0, 1.0),)}}).verdict
    assert (verdict.light, verdict.files) == ("pass", "fail")
    with pytest.raises(CriterionMissed, match="files: something = 2 mm") as missed:
        verdict.require(small_lens().spec)
    assert missed.value.exit_code == 1
    with pytest.raises(CriterionMissed):
        verdict.require(small_lens().spec, ("files",))
    verdict.require(small_lens().spec, ("light",))


def cut(lens: Lens, *findings: Finding) -> Results:
    return make_results(lens=lens, check={"verdicts": findings})


def finding(name: str, surface: str = "inner", holds: bool = False) -> Finding:
    return any_finding(name, surface, holds, f"{name} of {surface}")


@pytest.mark.parametrize("name", ["cutter", "relief", "tilt", "wall"])
def test_cutting_is_said_and_fails_a_run_only_where_it_is_required(name: str) -> None:
    verdict = cut(with_manufacture(), finding(name)).verdict
    assert (verdict.cutting, verdict.reasons.cutting) == ("fail", (f"{name} of inner",))
    verdict.require(with_manufacture().spec)
    verdict.require(with_manufacture().spec, ("cutting",))
    required = with_manufacture(required=True)
    for parts in ((), ("cutting",)):
        with pytest.raises(CriterionMissed, match=f"cutting: {name} of inner"):
            cut(required, finding(name)).verdict.require(required.spec, parts)
    cut(required, finding(name)).verdict.require(required.spec, ("light",))


def test_draft_counts_where_a_mould_is_asked_for_and_the_wall_where_a_part_is_cut() -> None:
    part, mould = with_manufacture(), with_manufacture(make="insert")
    assert cut(part, finding("draft")).verdict.cutting == "pass"
    assert cut(mould, finding("draft")).verdict.cutting == "fail"
    assert cut(part, finding("wall", "body")).verdict.cutting == "fail"
    assert cut(mould, finding("wall", "body")).verdict.cutting == "pass"


def test_a_face_needs_one_tool_of_the_shop_not_all() -> None:
    lens = with_manufacture()
    assert cut(lens, finding("tool", holds=False), finding("tool", holds=True)).verdict.cutting == "pass"
    found = cut(lens, finding("tool", "inner", holds=True), finding("tool", "outer"), finding("tool", "outer")).verdict
    assert found.cutting == "fail" and found.reasons.cutting == ("tool of outer; tool of outer",)
