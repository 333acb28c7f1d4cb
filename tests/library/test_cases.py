"""Results of several LEDs and receivers: each case once, in order, and told by its names where there are several."""

from pathlib import Path
from typing import Annotated, Any, ClassVar

import pytest

from lensforge.errors import InputError
from lensforge.results import InFile, NotNegative, Record, ResultByLed, StageResult
from lensforge.results.case import Case
from lensforge.results.criteria import Criteria, under
from lensforge.results.figure import Criterion, Figure, criteria_in
from lensforge.results.files import read_json, write_json
from lensforge.results.stage_result import with_checksum


class Wall(Record):
    """A receiver."""

    name: str
    gap_mm: Annotated[
        NotNegative,
        Figure("Gap", lambda lit, wall: f"{lit.led} {wall.name}"),
        Criterion("<=", 2.0, "gap", "close it"),
    ]


class Frame(Record):
    """A thing whose criteria always begin with its name."""

    name: str
    width_mm: Annotated[NotNegative, Figure("Width"), Criterion("<=", 5.0, "width", "saw it")]


class Lit(ResultByLed):
    """A result by LED with receivers."""

    stage: ClassVar[str] = "lit"
    made_from: ClassVar[tuple[str, ...]] = ()

    others: "tuple[Lit, ...]" = ()
    receivers: tuple[Wall, ...]
    frames: tuple[Frame, ...] = ()
    flux: Annotated[float, Figure("Flux"), Criterion(">=", 1.0, "flux", "add light")]
    beam: Annotated[bytes | None, InFile("beam.ies")] = None
    criteria: Criteria = ()

    def judge(self):
        """Judge the whole, and each of its parts."""
        yield from criteria_in(self)
        for case in Case(self).among("receivers"):
            yield from map(case.named, criteria_in(self, case.record))
        for frame in self.frames:
            yield from (under(frame.name, criterion) for criterion in criteria_in(self, frame))


def lit(*gaps: float, flux: float = 1.5, **more: Any) -> Lit:
    names = ("wall", "sky", "floor")
    walls = [Wall(name=name, gap_mm=gap) for name, gap in zip(names, gaps, strict=False)]
    return Lit(receivers=walls, flux=flux, beam=b"%g" % flux, **more)


def of_two() -> Lit:
    """Two LEDs on two receivers: the far one on the sky is too wide, and has too little flux."""
    return Lit.joined({"near": lit(0.5, 1.25), "far": lit(0.75, 2.5, flux=0.875)})


def test_leds_stand_outside_and_receivers_inside() -> None:
    made = of_two()
    cases = list(made.cases("receivers"))
    assert [(case.led, case.name, case.record.gap_mm) for case in cases] == [
        ("near", "wall", 0.5), ("near", "sky", 1.25), ("far", "wall", 0.75), ("far", "sky", 2.5),
    ]  # fmt: skip
    assert [case.number for case in cases] == [0, 1, 0, 1] and [case.number for case in made.cases()] == [0, 1]
    assert [case.title("Light") for case in cases][::3] == ["Light, near, wall", "Light, far, sky"]
    assert [(case.title("Light"), case.result.flux) for case in made.cases()] == [
        ("Light, near", 1.5),
        ("Light, far", 0.875),
    ]


@pytest.mark.parametrize(
    ("made", "titles"),
    [
        (lit(0.5), ["Light"]),
        (lit(0.5, 1.0), ["Light, wall", "Light, sky"]),
        (Lit.joined({"near": lit(0.5), "far": lit(0.75)}), ["Light, near", "Light, far"]),
        (Lit.joined({"near": lit(0.5)}), ["Light"]),
    ],
)
def test_a_name_is_told_where_there_are_several(made: Lit, titles: list[str]) -> None:
    assert [case.title("Light") for case in made.cases("receivers")] == titles


def test_a_result_without_parts_is_one_case() -> None:
    (case,) = StageResult().cases()
    assert (case.title("Light"), case.suffix, case.criteria, case.record) == ("Light", "", [], None)


def test_criteria_have_the_names_of_all_but_the_first() -> None:
    made = of_two()
    assert [(criterion.key, criterion.state) for criterion in made.all_criteria()] == [
        ("flux", "pass"), ("gap", "pass"), ("sky: gap", "pass"),
        ("far: flux", "fail"), ("far: gap", "pass"), ("far: sky: gap", "fail"),
    ]  # fmt: skip
    assert [criterion.label for criterion in made.all_criteria()][-2:] == ["far: gap", "far: sky: gap"]


def test_a_case_has_its_criteria_without_its_name_and_the_first_those_of_the_whole() -> None:
    told = [[(criterion.key, criterion.value) for criterion in case.criteria] for case in of_two().cases("receivers")]
    assert told == [
        [("flux", 1.5), ("gap", 0.5), ("sky: gap", 1.25)],
        [("gap", 1.25)],
        [("flux", 0.875), ("gap", 0.75), ("sky: gap", 2.5)],
        [("gap", 2.5)],
    ]


def test_the_figures_of_a_case_are_of_its_led_and_receiver_and_have_its_state() -> None:
    facts = [fact for case in of_two().cases("receivers") for fact in case.facts()]
    assert [(fact.key, fact.value, fact.state, fact.note) for fact in facts] == [
        ("gap", 0.5, "pass", "near wall"), ("gap", 1.25, "pass", "near sky"),
        ("gap", 0.75, "pass", "far wall"), ("gap", 2.5, "fail", "far sky"),
    ]  # fmt: skip
    assert [(fact.key, fact.state) for case in of_two().cases() for fact in case.facts()] == [
        ("flux", "pass"), ("flux", "fail"),
    ]  # fmt: skip


@pytest.mark.parametrize(("widths", "states"), [((5.0, 5.5), ["pass", "fail"]), ((5.5, 5.0), ["fail", "pass"])])
def test_one_whose_criteria_always_begin_with_its_name_has_its_own(
    widths: tuple[float, ...], states: list[str]
) -> None:
    frames = [Frame(name=f"frame{number}", width_mm=width) for number, width in enumerate(widths)]
    made = lit(0.5, frames=frames)
    assert [fact.state for case in made.cases("frames") for fact in case.facts()] == states


def test_files_of_all_but_the_first_end_in_the_name_of_their_led(tmp_path: Path) -> None:
    made = of_two()
    assert made.file_names("lit") == {"lit.json", "lit.npz", "beam.ies", "beam_far.ies"}
    made.write(tmp_path)
    assert (tmp_path / "beam.ies").read_bytes() == b"1.5" and (tmp_path / "beam_far.ies").read_bytes() == b"0.875"
    assert Lit.read(tmp_path) == made


def test_a_judgement_with_the_second_led_that_does_not_follow_is_refused(tmp_path: Path) -> None:
    of_two().write(tmp_path)
    stored = read_json(tmp_path / "lit.json", "")
    forged = stored["others"][0]["criteria"][2]
    assert (forged["name"], forged["value"], forged["passed"]) == ("sky: gap", 2.5, False)
    forged |= {"value": 1.5, "passed": True}
    write_json(tmp_path / "lit.json", with_checksum(stored))
    with pytest.raises(InputError, match="sky: gap: not as it follows from the other entries"):
        Lit.read(tmp_path)
