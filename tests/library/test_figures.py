"""Figures that are declared at their fields: what is told, judged, stored, and held against a file."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pytest

from lensforge.errors import InputError
from lensforge.results import Count, Extent, Flag, Metric, NotNegative, Record, StageResult
from lensforge.results.criteria import Criteria
from lensforge.results.figure import Apart, Criterion, Figure, criteria_in, facts_in, figure, figures_of, limits_in
from lensforge.results.files import read_json, write_json
from lensforge.results.record import InCriterion, require_what_follows
from lensforge.results.stage_result import with_checksum


class Rim(Record):
    """A record within a result."""

    gap_um: Annotated[
        NotNegative,
        Figure("Gap", "of {edges} edges, {wide_mm:3} wide", digits=3),
        Criterion("<=", lambda joint: joint.most_um, "gap of the rim", "close {wide_mm:3}", tolerance=0.5),
    ]
    wide_mm: NotNegative
    edges: Count


class Joint(StageResult):
    """A result whose second criterion is missed."""

    stage: ClassVar[str] = "joint"
    made_from: ClassVar[tuple[str, ...]] = ()

    closed: Annotated[Flag, InCriterion(), Criterion(">=", 1.0, "the joint is closed (1: yes)", "close it")]
    slip_mm: Annotated[
        Extent, Figure("Slip", of="rms"), Criterion("<=", 0.25, "largest slip", lambda joint: joint.advice, of="max")
    ]
    torque: Annotated[Metric | None, Figure("Torque", missing="not measured"), Criterion(">=", 2.0, "torque", "turn")]
    share: Annotated[NotNegative, Figure("Light", unit="%"), Criterion("<=", 0.2, "light that is lost", "")]
    rim: Rim
    most_um: Annotated[float, InCriterion("rim_gap", "limit")]
    advice: str = "hold it"
    criteria: Criteria = ()

    @property
    @figure(Figure("Twice the slip", key="twice"), Criterion("<=", lambda _: None, "asks for nothing", ""))
    def twice_mm(self) -> float:
        """A figure that follows from others."""
        return 2.0 * self.slip_mm.rms


def joint(**changes: Any) -> Joint:
    content: dict[str, Any] = {
        "closed": True,
        "slip_mm": Extent(max=0.5, rms=0.125),
        "torque": Metric(value=2.1, unit="N m", standard_error=0.1),
        "share": 0.25,
        "rim": Rim(gap_um=7.25, wide_mm=1.5, edges=3),
        "most_um": 7.0,
    }
    return Joint(**{**content, **changes})


def states(made: Joint) -> dict[str, str]:
    return {criterion.key: criterion.state for criterion in made.criteria}


def test_criteria_follow_from_the_figures() -> None:
    assert states(joint()) == {
        "closed": "pass", "slip": "fail", "torque": "undecided", "share": "fail", "rim_gap": "pass",
    }  # fmt: skip
    judged = {criterion.key: criterion for criterion in joint().criteria}
    assert (judged["slip"].value, judged["slip"].bound, judged["slip"].unit) == (0.5, 0.25, "mm")
    assert (judged["slip"].remedy, judged["slip"].label) == ("hold it", "largest slip")
    assert (judged["rim_gap"].bound, judged["rim_gap"].tolerance, judged["rim_gap"].unit) == (7.0, 0.5, "µm")
    assert judged["rim_gap"].remedy == "close 1.5 mm"
    assert states(joint(closed=False, torque=None)) | {"slip": ""} == {
        "closed": "fail", "slip": "", "torque": "fail", "share": "fail", "rim_gap": "pass",
    }  # fmt: skip


@pytest.mark.parametrize(("most_um", "state"), [(6.75, "pass"), (6.7499, "fail")])
def test_a_value_may_miss_its_limit_by_the_tolerance_and_no_more(most_um: float, state: str) -> None:
    assert states(joint(most_um=most_um))["rim_gap"] == state


def test_facts_are_views_of_the_fields() -> None:
    made = joint()
    told = {fact.key: fact for fact in facts_in(made, made.criteria)}
    assert list(told) == ["slip", "torque", "share", "rim_gap", "twice"]
    assert told["slip"].text == "0.125 mm" and told["slip"].limit is None, "another entry is judged"
    assert told["rim_gap"].sentence == "7.25 µm (required ≤ 7 µm); of 3 edges, 1.5 mm wide"
    assert (told["torque"].state, told["torque"].limit) == ("undecided", 2.0)
    assert (told["share"].value, told["share"].limit, told["share"].unit) == (25.0, 20.0, "%")
    assert told["twice"].value == 0.25
    assert {fact.key: fact.text for fact in facts_in(joint(torque=None))}["torque"] == "not measured"


class Held(StageResult):
    """A result whose radius is judged by its margin."""

    stage: ClassVar[str] = "held"
    made_from: ClassVar[tuple[str, ...]] = ()

    radius_mm: Annotated[NotNegative, Figure("Radius", "at the rim", limit=7.0, judged_by="margin")]
    margin_mm: Annotated[float | None, Criterion(">=", 0.0, "radius below its maximum", "make it smaller")]
    criteria: Criteria = ()


@pytest.mark.parametrize(
    ("radius_mm", "margin_mm", "state", "note"),
    [(6.5, 0.5, "pass", "at the rim"), (7.5, -0.5, "fail", "at the rim"), (6.5, None, "fail", "at the rim; margin")],
)
def test_a_fact_that_another_figure_judges_names_that_only_where_it_has_no_value(
    radius_mm: float, margin_mm: float | None, state: str, note: str
) -> None:
    made = Held(radius_mm=radius_mm, margin_mm=margin_mm)
    (fact,) = facts_in(made, made.criteria)
    assert (fact.limit, fact.state, fact.note) == (7.0, state, note)


def test_the_figures_of_a_class_are_known_without_a_record() -> None:
    assert [(key, declared.label) for key, declared in figures_of(Joint)] == [
        ("slip", "Slip"), ("torque", "Torque"), ("share", "Light"), ("rim_gap", "Gap"), ("twice", "Twice the slip"),
    ]  # fmt: skip


class Beam(Record):
    """A record that is told apart."""

    width_deg: Annotated[
        NotNegative | None, Figure("Width", missing=""), Criterion("<=", 30.0, "width of the beam", "refocus")
    ]


class Spot(StageResult):
    """A result whose figures are judged by limits of their own, one of them asked for by the caller."""

    stage: ClassVar[str] = "spot"
    made_from: ClassVar[tuple[str, ...]] = ()

    nmse: Annotated[
        Metric,
        Figure(
            "NMSE",
            is_square=True,
            limit=lambda spot, most: most,
            limit_note=lambda spot, most: f"{most:g} is asked for",
            possible="least",
            possible_note="{law}",
            remedy="refocus {beam.width_deg:3}",
            when=lambda spot, most: most != 0.0,
        ),
    ]
    share: Annotated[Metric, Figure("Share", unit="%", sense=">=", limit=0.7, possible=0.95)]
    rows: Annotated[Count, Figure("Pixels", value=lambda spot, most: f"{spot.rows} × {2 * spot.rows}")]
    depth_mm: Annotated[float, Figure("Depth", limit=2.0)]
    beam: Annotated[Beam, Apart()]
    least: float | None = 0.01
    law: str = "étendue"


def spot(nmse: float = 0.05, error: float | None = 0.01, share: float = 0.75, depth_mm: float = 1.5) -> Spot:
    return Spot(
        nmse=Metric(value=nmse, standard_error=error),
        share=Metric(value=share, standard_error=0.02),
        rows=48,
        depth_mm=depth_mm,
        beam=Beam(width_deg=24.0),
    )


@pytest.mark.parametrize(
    ("nmse", "error", "state"),
    [(0.079, 0.01, "pass"), (0.081, 0.01, "undecided"), (0.119, 0.01, "undecided"), (0.121, 0.01, "fail"),
     (0.05, None, "undecided")],
)  # fmt: skip
def test_a_figure_with_a_limit_of_its_own_is_judged_by_its_value(nmse: float, error: float | None, state: str) -> None:
    told = {fact.key: fact for fact in facts_in(spot(nmse, error), (), None, 0.1)}
    assert (told["nmse"].state, told["nmse"].limit, told["nmse"].limit_note) == (state, 0.1, "0.1 is asked for")
    assert (told["nmse"].possible, told["nmse"].possible_note, told["nmse"].remedy) == (0.01, "étendue", "refocus 24°")
    unasked = next(iter(facts_in(spot(nmse, error), (), None, None)))
    assert (unasked.limit, unasked.state, unasked.limit_note, unasked.is_square) == (None, "", "", True)


def test_a_law_is_told_with_its_bound_alone() -> None:
    free = spot().model_copy(update={"least": None})
    (told,) = (fact for fact in facts_in(free, (), None, 0.1) if fact.key == "nmse")
    assert (told.possible, told.possible_note) == (None, "")


@pytest.mark.parametrize(("share", "state"), [(0.741, "pass"), (0.739, "undecided"), (0.659, "fail")])
def test_a_share_and_its_limits_are_told_in_per_cent(share: float, state: str) -> None:
    (told,) = (fact for fact in facts_in(spot(share=share), (), None, None) if fact.key == "share")
    assert (told.value, told.standard_error, told.state) == (pytest.approx(100.0 * share), 2.0, state)
    assert (told.limit, told.possible, told.unit) == (pytest.approx(70.0), 95.0, "%")
    assert (told.required, told.bounded_by) == ("≥ 70\u2009%", "≤ 95\u2009%")


@pytest.mark.parametrize(("depth_mm", "state"), [(2.0, "pass"), (2.0001, "fail")])
def test_a_number_without_standard_error_is_exact(depth_mm: float, state: str) -> None:
    (told,) = (fact for fact in facts_in(spot(depth_mm=depth_mm), (), None, None) if fact.key == "depth")
    assert (told.state, told.value, told.limit, told.unit) == (state, depth_mm, 2.0, "mm")


def test_limits_are_those_of_the_figures_that_are_told() -> None:
    limits = [("share", ">=", 0.7), ("depth", "<=", 2.0)]
    assert list(limits_in(spot(), None, 0.1)) == [("nmse", "<=", 0.1), *limits]
    assert list(limits_in(spot(), None, None)) == limits and list(limits_in(spot(), None, 0.0)) == limits
    assert list(limits_in(Held(radius_mm=6.5, margin_mm=0.5))) == [], "judged by another figure"


def test_a_record_apart_is_told_and_judged_but_not_among_the_figures_of_the_result() -> None:
    made = spot()
    assert [(fact.key, fact.text) for fact in facts_in(made, (), None, None)][2:] == [
        ("rows", "48 × 96"), ("depth", "1.5 mm"),
    ]  # fmt: skip
    assert [(fact.key, fact.value) for fact in facts_in(made.beam)] == [("width", 24.0)]
    assert [criterion.key for criterion in criteria_in(made)] == ["beam_width"]
    assert [key for key, _ in figures_of(Spot)] == ["nmse", "share", "rows", "depth", "width"]
    (unknown,) = facts_in(Beam(width_deg=None))
    assert (unknown.key, unknown.value, unknown.text) == ("width", None, "–")


def test_what_a_criterion_tells_stands_once_in_the_file_and_is_read_from_there(tmp_path: Path) -> None:
    for made in (joint(), joint(closed=False, most_um=8.5)):
        made.write(tmp_path)
        stored = read_json(tmp_path / "joint.json", "")
        assert not {"closed", "most_um"} & stored.keys()
        again = Joint.read(tmp_path)
        assert again == made and again.criteria == made.criteria and again.sha256 == made.sha256
        assert (again.closed, again.most_um) == (made.closed, made.most_um)


@pytest.mark.parametrize(
    ("number", "entry", "value"), [(1, "limit", 0.75), (1, "value", 0.2), (4, "tolerance", 1.0), (2, "sense", "<=")]
)
def test_a_criterion_that_does_not_follow_is_refused(tmp_path: Path, number: int, entry: str, value: Any) -> None:
    """The second of them, too; with a checksum that is right."""
    joint().write(tmp_path)
    stored = read_json(tmp_path / "joint.json", "")
    forged = stored["criteria"][number]
    forged[entry] = value
    better = {"<=": forged["value"] <= forged["limit"] + forged["tolerance"], ">=": forged["value"] >= forged["limit"]}
    forged["passed"] = better[forged["sense"]] and forged.get("standard_error") is None
    write_json(tmp_path / "joint.json", with_checksum(stored))
    with pytest.raises(InputError, match="not as it follows from the other entries"):
        Joint.read(tmp_path)


def test_words_of_another_version_are_kept(tmp_path: Path) -> None:
    """A folder whose remedies have since been written better still reads, with the hash that its run states."""
    made = joint()
    made.write(tmp_path)
    stored = read_json(tmp_path / "joint.json", "")
    stored["criteria"][1]["remedy"] = "as it was said before"
    stored["criteria"].reverse()  # which the order in which fields stand may change, too
    write_json(tmp_path / "joint.json", with_checksum(stored))
    again = Joint.read(tmp_path)
    slip = next(criterion for criterion in again.criteria if criterion.key == "slip")
    assert (slip.remedy, slip.label) == ("as it was said before", "largest slip")
    assert [criterion.key for criterion in again.criteria] == [criterion["name"] for criterion in stored["criteria"]]
    assert again.sha256 != made.sha256


class Leaf(Record):
    """A record with a figure that follows from another."""

    wide_mm: float
    area_mm2: float

    def follows(self) -> Iterator[tuple[str, float, float]]:
        yield "area_mm2", self.area_mm2, self.wide_mm**2


class Branch(Record):
    """Several records, and one."""

    leaves: tuple[Leaf, ...]
    last: Leaf


class Tree(Record):
    """Records in records."""

    branches: tuple[Branch, ...]


@pytest.mark.parametrize("place", [None, "branches.1.leaves.2", "branches.0.last", "branches.1.last"])
def test_a_figure_that_does_not_follow_is_named_by_its_whole_path(place: str | None) -> None:
    def leaf(path: str) -> Leaf:
        return Leaf(wide_mm=3.0, area_mm2=8.0 if path == place else 9.0 * (1.0 + 1e-13))

    tree = Tree(
        branches=tuple(
            Branch(leaves=tuple(leaf(f"branches.{i}.leaves.{k}") for k in range(3)), last=leaf(f"branches.{i}.last"))
            for i in range(2)
        )
    )
    if place is None:
        require_what_follows(tree)
        return
    with pytest.raises(ValueError, match=rf"^{re.escape(place)}\.area_mm2 = 8: the other entries make it 9$"):
        require_what_follows(tree)
