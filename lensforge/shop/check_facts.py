"""Facts of the manufacturing check: each face, the wall, and what the shop can do with them."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from math import inf

from lensforge.results import Fact, Group
from lensforge.results.figure import facts_in
from lensforge.results.numerals import quantity
from lensforge.results.verdict import Reason
from lensforge.shop.check_measures import Cutter, FaceResult, TurningTool
from lensforge.shop.check_result import Check
from lensforge.shop.findings import BODY
from lensforge.shop.mould_facts import mould_facts
from lensforge.spec import BaseSection, Spec
from lensforge.spec.part_section import usual_flat_mm


def check_facts(check: Check) -> list[Group]:
    """A group for each face and one for the wall, and the findings on each of them."""
    faces = [Group(name, face_title(name), tuple(_face(name, face, check))) for name, face in check.faces.items()]
    walls = Group("walls", "Wall", tuple(facts_in(check, check.criteria)))
    sharpest = (fact for edge in check.edges for fact in facts_in(check, check.criteria, edge))
    edges = [Group("edges", "Edges", tuple(sharpest))] if check.edges else []
    mould = [] if check.mould is None else [Group("mould", "Mould", tuple(mould_facts(check.mould, check)))]
    return [*faces, walls, *edges, *mould, *_orientation(check.spec), *finding_groups(check)]


def _face(name: str, face: FaceResult, check: Check) -> Iterator[Fact]:
    findings = [finding for finding in check.verdicts if finding.place == name]
    yield from (replace(fact, key=f"{name}_{fact.key}") for fact in facts_in(check, findings, face, name))


def _orientation(spec: Spec) -> Iterator[Group]:
    """Feature by which a non-round part is oriented in its mount; None for a plate, which has marks."""
    if spec.plate is None and not all(map(spec.lens.is_revolved, spec.lens.names)):
        mark = _mark(spec.base_made) if spec.lens.drawn_mm is None else _MARK_OF_LENGTH
        yield Group("orientation", "Orientation", (mark,))


_MARK_OF_LENGTH = Fact(
    "azimuth_mark", "Azimuth mark", "length", note="y lies along the part; +x is not marked between its two sides"
)
_TURNED_HOW = "the light is not round, and the part does not show how it is turned"


def _mark(base: BaseSection) -> Fact:
    """The feature of the base that marks +x, or what would mark it."""
    match base.kind:
        case "step":
            return Fact("azimuth_mark", "Azimuth mark", "as in the base's file")
        case "square":
            return Fact("azimuth_mark", "Azimuth mark", "square base", note="+x is not marked among its four sides")
        case "cylinder" if base.flat_mm is not None:
            return Fact(
                "azimuth_mark", "Azimuth mark", "flat", note=f"across +x, {quantity(base.flat_mm, 'mm')} from the axis"
            )
        case "cylinder":
            cure = f"base.flat_mm = {usual_flat_mm(base):g} cuts a flat across +x"
        case _:
            cure = "mark +x beside the optical faces, or give it a base with base.flat_mm"
    return Fact("azimuth_mark", "Azimuth mark", "none", notice=f"{_TURNED_HOW}: {cure}")


def face_title(name: str) -> str:
    """Title of a face."""
    return f"{name.capitalize()} face"


def finding_groups(check: Check) -> list[Group]:
    """The findings by what they are on."""
    named = {**{name: face_title(name) for name in check.faces}, BODY: "Wall"}
    groups = []
    for surface, title in named.items():
        facts = tuple(verdict.answered for verdict in check.verdicts if verdict.place == surface)
        if facts:
            groups.append(Group(f"findings_{surface}", f"Manufacture, {title.lower()}", facts))
    return groups


def cutting_reasons(check: Check) -> Iterator[Reason]:
    """Reasons why the lens cannot be made, or is not meant to be."""
    if not check.spec.manufacture.making.is_judged:
        yield "none", 'manufacture.process = "none": a study of light, of which nothing is made'
        return
    for finding in check.verdicts:
        of_part = finding.key in ("wall", "plate") and check.cut_body == "mould insert"  # which has none of them
        counts = finding.key != "tool" and not of_part
        if counts and not finding.holds:
            yield "fail", _with_remedy(finding)
    for name in check.faces:  # one tool is enough
        tools = [verdict for verdict in check.verdicts if verdict.key == "tool" and verdict.place == name]
        if tools and not any(verdict.holds for verdict in tools):
            yield "fail", "; ".join(map(_with_remedy, tools))


def _with_remedy(finding: Fact) -> str:
    """The reason of a finding and its remedy, in one sentence."""
    return f"{finding.note}: try {finding.remedy}" if finding.remedy else finding.note


def tip_keys(names: Iterable[str]) -> tuple[str, ...]:
    """Keys of the facts on the largest ball, or nose, for each face."""
    return tuple(f"{name}_{kind.tip}" for name in names for kind in (Cutter, TurningTool))


def shape_facts(check: Check, groups: Iterable[Group]) -> list[Fact]:
    """Facts in ``groups`` that decide whether the faces can be made: the largest ball or nose of each face.

    For a moulded part the worst face in each of three: nose of its insert, draft, and released share.
    """
    facts = {fact.key: fact for group in groups for fact in group.facts}
    tips = [facts[key] for key in tip_keys(check.faces) if key in facts]
    if check.mould is None:
        return tips
    kinds = tips, *([facts[f"{name}_{kind}"] for name in check.mould.faces] for kind in ("draft", "drawn"))
    return [min(facts_of_kind, key=_room) for facts_of_kind in kinds if facts_of_kind]


def _room(fact: Fact) -> float:
    """Margin of the value over its limit; infinite without a limit."""
    return fact.value - (fact.limit or 0.0) if isinstance(fact.value, float) else inf
