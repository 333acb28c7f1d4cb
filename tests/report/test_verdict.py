"""The verdict from the records of the stages: each bound from both sides, and what counts for an exit."""

from contextlib import nullcontext
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from result_folders import PIXELS, criterion, make_folder, make_results, with_leds
from result_folders import finding as any_finding
from shown_folders import SKY, WALL, lens_of

from lensforge.cli.conclusion import _limit_rows, _require_pass, summary
from lensforge.errors import CriterionMissed, InputError
from lensforge.light.light_facts import light_facts
from lensforge.light.receiver_light import LARGEST_NMSE, LEAST_SHARE, Possible
from lensforge.report.folder import Run
from lensforge.report.headline import headline
from lensforge.report.results import Results
from lensforge.report.stored import Stored, load_results
from lensforge.results import Fact, Metric
from lensforge.results.verdict import TITLES, Verdict, worst
from lensforge.scene.lens import Lens

TRANSMITTED = (1.0 - (0.4936 / 2.4936) ** 2) ** 2  # of PMMA's two faces at normal incidence: 0.9232
FLAT = np.ones((PIXELS, PIXELS))


def metric(value: float, error: float | None = 1e-4) -> Metric:
    return Metric(value=value, standard_error=error)


def lit(nmse: Metric | None = None, share: Metric | None = None, target: np.ndarray = FLAT) -> Verdict:
    """The verdict on a lens with these figures of its light."""
    light = {"nmse": nmse or metric(0.01), "share_in_target": share or metric(0.85), "target_map": target}
    return make_results(evaluate=light).verdict


def limit_of(name: str, value: float) -> Fact:
    """A limit of the spec that asks for 1 W/m² at least, judged."""
    return Fact(name, name, value, "W/m²", 0.1, ">=", 1.0, note="light", place="light").judged(0.1)


def with_manufacture(**fields: object) -> Lens:
    return lens_of(manufacture=fields)


@pytest.mark.parametrize(
    ("value", "error", "state"),
    [
        (LARGEST_NMSE - 0.003, 0.001, "pass"),
        (LARGEST_NMSE - 0.0019, 0.001, "undecided"),
        (LARGEST_NMSE, 0.0, "pass"),
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
    assert all("NMSE" in reason and "must be ≤ 0.1" in reason for reason in verdict.reasons.light)


@pytest.mark.parametrize(
    ("excess", "state"), [(0.003, "pass"), (0.0015, "undecided"), (-0.0015, "undecided"), (-0.003, "fail")]
)
def test_the_share_in_the_target_is_judged_against_what_two_faces_transmit(excess: float, state: str) -> None:
    verdict = lit(share=metric(LEAST_SHARE * TRANSMITTED + excess, 0.001))
    assert verdict.light == state
    assert all("Light in the target" in reason for reason in verdict.reasons.light)


def test_a_share_is_judged_by_what_is_possible_where_that_is_less() -> None:
    """Étendue leaves 30 %: 22 % of the light are more than 0.7 of that, and 20 % are less."""
    for share, state in ((0.22, "pass"), (0.2, "fail")):
        possible = Possible(efficiency=0.9, share_in_target=0.3, nmse=0.0, law="étendue")
        light = {"nmse": metric(0.01), "share_in_target": metric(share), "target_map": FLAT, "possible": possible}
        verdict = make_results(evaluate=light).verdict
        assert verdict.light == state
        assert state == "pass" or "must be ≥ 21\u2009%" in verdict.reasons.light[0]


def test_limits_decide_alone_where_a_spec_has_them() -> None:
    """The pattern is hopeless; what counts is that the one limit is held, missed, or too close to call."""
    axis = {"kind": "points", "name": "axis", "at_mm": [[0, 0]], "unit": "w_per_m2", "at_least": 1.0}
    lens = lens_of(limits=[axis])
    for value, state in ((1.3, "pass"), (1.1, "undecided"), (0.5, "fail")):
        limit = limit_of("axis", value)
        verdict = make_results(lens=lens, evaluate={"nmse": metric(0.9), "limits": (limit,)}).verdict
        assert verdict.light == state
        assert all("axis = " in reason and "≥ 1 W/m²".replace(" ", " ") in reason for reason in verdict.reasons.light)


@pytest.mark.parametrize("forged", [{"limit": 0.5}, {"sense": "<="}, {"key": "other", "label": "other"}, None])
def test_a_limit_that_the_spec_does_not_state_is_refused(tmp_path: Path, forged: dict[str, Any] | None) -> None:
    """Also one that is left out: it would be held."""
    axis = {"kind": "points", "name": "axis", "at_mm": [[0, 0]], "unit": "w_per_m2", "at_least": 1.0}
    lens = lens_of(limits=[axis, {**axis, "name": "beside", "at_most": 3.0}])
    limits = (limit_of("axis", 0.7), limit_of("beside", 1.5), replace(limit_of("beside", 1.5), sense="<=", limit=3.0))
    light = make_results(("evaluate",), lens, evaluate={"limits": limits}).light
    folder = make_folder(tmp_path, ("evaluate",), lens, evaluate={"limits": limits})
    assert load_results(folder).light == light and load_results(folder).verdict.light == "fail"
    others = limits[1:] if forged is None else (replace(limits[0], **forged).judged(0.1), *limits[1:])
    changed = light.model_copy(update={"limits": others})
    of_two = with_leds(lens, "first", "second")
    second = make_folder(tmp_path / "two", ("evaluate",), of_two, evaluate={"limits": limits})
    first = light.model_copy(update={"led": "first", "inputs": {**light.inputs, "lens": of_two.sha256}})
    with_second = first.changed(others=(first.changed(led="second", limits=others),))
    for written, place in ((changed, folder), (with_second, second)):
        written.write(place)
        with pytest.raises(InputError, match=r"evaluate\.json: limits: \w+: not as it follows"):
            load_results(place)


def test_light_of_a_state_that_the_lens_has_not_is_refused(tmp_path: Path) -> None:
    of_two = with_leds(lens_of(), "first", "second")
    folder = make_folder(tmp_path, ("evaluate",), of_two)
    light = make_results(("evaluate",), of_two).light.changed(led="first")
    for name, message in (
        ("second", ""),
        ("third", r"evaluate\.json: state = 'third': no state .*; run `lensforge eval"),
    ):
        light.changed(others=(light.changed(led=name),)).write(folder)
        with pytest.raises(InputError, match=message) if message else nullcontext():
            load_results(folder)


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
        verdict.require(cutting=False)  # undecided is no failure


@pytest.mark.parametrize("stem", ["design", "export", "check", "verify"])
def test_a_missed_criterion_of_a_stage_fails_the_files(stem: str) -> None:
    verdict = make_results(**{stem: {"criteria": (criterion("something", 2.0, 1.0),)}}).verdict
    assert (verdict.light, verdict.files) == ("pass", "fail")
    with pytest.raises(CriterionMissed, match="files: something = 2 mm") as missed:
        verdict.require(cutting=False)
    assert missed.value.exit_code == 1
    with pytest.raises(CriterionMissed):
        verdict.require(cutting=False, parts=("files",))
    verdict.require(cutting=False, parts=("light",))


@pytest.mark.parametrize("failing", ["light", "files"])
def test_the_screen_says_why_below_the_part_that_fails(failing: str, tmp_path: Path) -> None:
    missed = {"criteria": (criterion("something", 2.0, 1.0),)}
    dim = {"nmse": metric(0.5), "share_in_target": metric(0.85), "target_map": FLAT}
    results = make_results(export=missed) if failing == "files" else make_results(evaluate=dim)
    blocks = {
        block.title.partition(":")[0]: block.rows
        for block in summary(Run(results.lens, results.found, {}, {}, tmp_path))
    }
    reasons = {
        title: [text for label, text in blocks[title] if label == "Reason"] for title in ("Photometry", "CAD files")
    }
    (reason,) = results.verdict.reasons_of(failing)
    assert reasons == {title: [reason] * (title == TITLES[failing]) for title in reasons}


def test_a_changed_file_fails_until_the_verification_has_judged_it_as_it_is() -> None:
    """A folder with such a file is refused; a later verification judges every file by its content."""
    names = {"step": "lens.step", "stl": "lens.stl", "threemf": "lens.3mf"}
    for field, name in names.items():
        kept = make_results()
        changed = kept.part.model_copy(update={field: b"other"})
        assert changed.altered == (name,)
        for proof in ({}, {"verify": kept.proof}):
            verdict = Results(kept.lens, {"export": changed, **proof}).verdict
            assert verdict.files == "fail" and f"{name} is not the file that was exported" in verdict.reasons.files[0]
        judged = kept.proof.model_copy(update={"altered_files": (name,)})
        after = Results(kept.lens, {"export": changed, "verify": judged}).verdict
        assert after.files == "pass"


def cut(lens: Lens, *findings: Fact) -> Results:
    return make_results(lens=lens, check={"verdicts": findings})


def finding(name: str, surface: str = "inner", holds: bool = False) -> Fact:
    return any_finding(name, surface, holds, f"{name} of {surface}")


@pytest.mark.parametrize("name", ["cutter", "relief", "tilt", "wall"])
def test_cutting_is_said_and_fails_a_run_only_where_it_is_required(name: str) -> None:
    verdict = cut(with_manufacture(), finding(name)).verdict
    assert (verdict.cutting, verdict.reasons.cutting) == ("fail", (f"{name} of inner",))
    verdict.require(cutting=False)
    verdict.require(cutting=False, parts=("cutting",))
    required = with_manufacture(required=True)
    for parts in ((), ("cutting",)):
        with pytest.raises(CriterionMissed, match=f"Manufacture: {name} of inner"):
            cut(required, finding(name)).verdict.require(cutting=True, parts=parts)
    cut(required, finding(name)).verdict.require(cutting=True, parts=("light",))


@pytest.mark.parametrize("required", [False, True])
def test_a_command_ends_by_a_part_that_cannot_be_made_only_where_it_is_required(required: bool) -> None:
    lens = with_manufacture(required=required)
    run: Any = SimpleNamespace(folder="cad_out/x", spec=lens.spec, verdict=cut(lens, finding("draft")).verdict)
    with pytest.raises(CriterionMissed, match=r"^cad_out/x: .*draft of inner") if required else nullcontext():
        _require_pass(run)
    _require_pass(run, "files")


def test_of_several_parts_the_worst_state_counts() -> None:
    """A part that is not judged leaves the others' failure and doubt, but no pass of all."""
    order = ("fail", "undecided", "none", "pass")
    for index, state in enumerate(order):
        assert worst(reversed(order[index:])) == state
    assert worst([]) == "pass"


def test_a_study_of_light_is_not_judged_by_what_no_tool_reaches() -> None:
    study = cut(with_manufacture(process="none"), finding("cutter"))
    assert (study.verdict.cutting, study.verdict.light, study.verdict.files) == ("none", "pass", "pass")
    assert study.verdict.reasons.cutting == (
        'manufacture.process = "none": a study of light, of which nothing is made',
    )
    study.verdict.require(cutting=study.spec.manufacture.required)
    assert headline(study).shown == "pass" and "Manufacture is not judged." in headline(study).sentence


def test_the_headline_is_red_where_what_is_required_fails() -> None:
    lens = with_manufacture(required=False)
    assert headline(cut(lens)).shown == "pass"
    assert headline(cut(lens, finding("cutter"))).shown == "open"
    assert headline(cut(with_manufacture(), finding("cutter"))).shown == "fail", "a process holds unless it need not"
    assert headline(cut(with_manufacture())).shown == "pass"
    for stem in ("export", "verify"):
        worse = {stem: {"criteria": (criterion("something", 2.0, 1.0),)}}
        assert headline(make_results(lens=lens, **worse)).shown == "fail"
    assert headline(make_results(lens=lens, evaluate={"nmse": metric(0.9)})).shown == "fail"


def test_draft_counts_where_a_mould_is_asked_for_and_the_wall_where_a_part_is_cut() -> None:
    part, mould = with_manufacture(), with_manufacture(process="moulded")
    assert cut(mould, finding("draft")).verdict.cutting == "fail"
    assert cut(part, finding("wall", "body")).verdict.cutting == "fail"
    assert cut(mould, finding("wall", "body")).verdict.cutting == "pass"


def test_a_face_needs_one_tool_of_the_shop_not_all() -> None:
    lens = with_manufacture()
    assert cut(lens, finding("tool", holds=False), finding("tool", holds=True)).verdict.cutting == "pass"
    verdict = cut(
        lens, finding("tool", "inner", holds=True), finding("tool", "outer"), finding("tool", "outer")
    ).verdict
    assert verdict.cutting == "fail" and verdict.reasons.cutting == ("tool of outer; tool of outer",)


def test_what_is_undecided_is_decided_by_more_rays() -> None:
    light = make_results(("evaluate",)).light
    share = Metric(value=LEAST_SHARE * TRANSMITTED, standard_error=0.03)
    receiver = light.first.model_copy(update={"share_in_target": share, "nmse": metric(0.01)})
    results = Results(lens_of(), {"evaluate": light.model_copy(update={"receivers": (receiver,)})})
    assert results.verdict.light == "undecided"
    (reason,) = results.verdict.reasons.light
    assert reason.endswith(", too close to tell: take more rays")


def test_limits_that_are_undecided_are_not_counted_as_held_on_the_screen() -> None:
    axis = {"kind": "points", "name": "axis", "at_mm": [[0, 0]], "unit": "w_per_m2", "at_least": 1.0}
    limits = tuple(limit_of(name, value) for name, value in (("near", 1.1), ("well", 1.3), ("far", 0.5)))
    results = make_results(lens=lens_of(limits=[axis]), evaluate={"limits": limits})
    (group,) = (group for group in light_facts(results.light, results.lens) if group.key == "limits")
    (_, held), *others = _limit_rows(group)
    assert held == "1 of 3 met"
    shown = [(label.strip(), reason.partition(":")[0]) for label, reason in others]
    assert shown == [("undecided", "near"), ("missed", "far")]
    many = replace(group, facts=(*group.facts, *(replace(group.facts[2], label=name) for name in "abc")))
    (_, held), *others = _limit_rows(many)
    assert held == "1 of 6 met" and [reason.partition(":")[0] for _, reason in others] == [
        "near", "far", "a", "and 2 more, in evaluate.json",
    ]  # fmt: skip


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize(("field", "good", "bad"), [("nmse", 0.01, 0.2), ("share_in_target", 0.85, 0.3)])
def test_the_light_on_each_receiver_decides(number: int, field: str, good: float, bad: float) -> None:
    results = make_results(("evaluate",), lens_of(wanted={"receivers": (WALL, SKY)}))
    figures = {"nmse": metric(0.01), "share_in_target": metric(0.85)}
    receivers = [receiver.model_copy(update=figures) for receiver in results.light.receivers]
    states = []
    for value in (good, bad):
        receivers[number] = receivers[number].model_copy(update={field: metric(value)})
        light = results.light.model_copy(update={"receivers": tuple(receivers)})
        states.append(Results(results.lens, {"evaluate": light}).verdict)
    assert [state.light for state in states] == ["pass", "fail"]
    (reason,) = states[1].reasons.light
    assert f", {receivers[number].name} = " in reason and receivers[1 - number].name not in reason


@pytest.mark.parametrize(
    ("missed", "phrase"), [(1, "is not met: something 0."), (2, "are not met: something 0, something 1.")]
)
def test_the_criteria_that_are_missed_are_counted_and_named(missed: int, phrase: str) -> None:
    criteria = tuple(criterion(f"something_{number}", 2.0, 1.0) for number in range(missed))
    results = make_results(design={"criteria": (*criteria, criterion("held", 0.5, 1.0))})
    count = len([1 for _ in results.criteria()])
    assert headline(results).criteria == f"{missed} of {count} criteria on simulation and files {phrase}"


@pytest.mark.parametrize("cutting", [False, True])
@pytest.mark.parametrize("parts", [(), ("light",), ("files", "cutting"), ("light", "files", "cutting")])
def test_an_exit_names_what_fails_and_has_the_reasons_of_that_alone(cutting: bool, parts: tuple[str, ...]) -> None:
    """Over all states of the three; what is undecided has a reason, too, and fails nothing."""
    for states in product(("pass", "fail", "undecided"), repeat=3):
        of_name = dict(zip(TITLES, states, strict=True))
        reasons = {
            name: [] if state == "pass" else [(state, f"{name} {state}, {k}") for k in range(2)]
            for name, state in of_name.items()
        }
        verdict = Verdict.of(**reasons)
        assert verdict.states == of_name
        asked = [name for name in parts or TITLES if cutting or name != "cutting"]
        failed = [name for name in asked if of_name[name] == "fail"]
        with pytest.raises(CriterionMissed) if failed else nullcontext() as missed:
            verdict.require(cutting=cutting, parts=parts)
        if failed:
            named, _, told = str(missed.value).partition(": ")
            assert named == ", ".join(TITLES[name] for name in failed)
            assert told.split("; ") == [f"{name} fail, {k}" for name in failed for k in range(2)]


def test_of_two_damaged_records_the_one_that_is_made_again_counts(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "run")
    made = load_results(folder)
    for stem in ("check", "verify"):
        (folder / f"{stem}.json").write_text("{")
    stored = Stored.read(folder)
    assert stored.results().outdated.keys() == {"check", "verify"}
    renewed = stored.with_result(made.proof).results()
    assert renewed.outdated.keys() == {"check"} and renewed.proof == made.proof
    assert stored.with_result(made.check).with_result(made.proof).results().outdated == {}
