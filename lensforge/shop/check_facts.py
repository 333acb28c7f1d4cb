"""Facts of the manufacturing check: each face, the wall, and what the shop can do with them."""

from collections.abc import Iterable, Iterator
from math import inf
from typing import NamedTuple

from lensforge.optics.face_roles import CAVITY
from lensforge.results import Fact, FactState, Group
from lensforge.results.criteria import named, state_of
from lensforge.results.fact_table import Row, facts_of
from lensforge.results.numerals import quantity
from lensforge.results.verdict import Reason
from lensforge.shop.check_result import BODY, Check, Cutter, Edge, FaceResult, TurningTool
from lensforge.shop.mould_facts import mould_facts
from lensforge.spec import BaseSection, Spec
from lensforge.spec.part_section import Process, usual_flat_mm


def check_facts(check: Check, spec: Spec) -> list[Group]:
    """A group for each face and one for the wall, and the findings on each of them."""
    faces = [Group(name, face_title(name), tuple(_face(name, face, check, spec))) for name, face in check.faces.items()]
    walls = Group("walls", "Wall", tuple(facts_of(check, _WALLS, judged=check.criteria)))
    edges = [Group("edges", "Edges", tuple(_edge(each, check, spec) for each in check.edges))] if check.edges else []
    mould = [] if check.mould is None else [Group("mould", "Mould", tuple(mould_facts(check.mould, check, spec)))]
    return [*faces, walls, *edges, *mould, *_orientation(spec), *finding_groups(check)]


def _orientation(spec: Spec) -> Iterator[Group]:
    """Feature by which a part whose light is not round is turned in its mount; none of a plate, which has marks."""
    if spec.plate is None and not all(map(spec.lens.is_revolved, spec.lens.names)):
        yield Group("orientation", "Orientation", (_mark(spec.base_made),))


_TURNED_HOW = "the light is not round, and the part does not show how it is turned"


def _mark(base: BaseSection) -> Fact:
    """The feature of the base that shows +x, or what would."""
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


def spec_of(check: Check, spec: Spec) -> Spec:
    """The ``spec`` of the lens, made by the process by which ``check`` judges it."""
    return spec if check.conditions is None else spec.made_by(check.process)


class ProcessWords(NamedTuple):
    """Words of a process: what has edges at a cavity, what edges and optical faces must be without, what is left."""

    inner: str
    burr: str
    traces: str
    left: str


_ON_OPTICS, _OF_TOOLS = "marks of gate, ejector or parting line", "what the tools leave of the inserts"
_WORDS: dict[Process, ProcessWords] = {
    "milled": ProcessWords("the cavity", "burr", "marks", "what the mill leaves"),
    "turned": ProcessWords("the cavity", "burr", "marks", "what the turning tool leaves"),
    "moulded": ProcessWords("the mould’s core", "flash", _ON_OPTICS, _OF_TOOLS),
    "printed": ProcessWords("the cavity", "rests of supports", "layers or marks of supports", ""),
}


def words_of(spec: Spec) -> ProcessWords:
    """The words of the process by which the part of ``spec`` is made."""
    assert spec.manufacture.process is not None  # it is derived
    return _WORDS[spec.manufacture.process]


def face_title(name: str) -> str:
    """Title of a face."""
    return f"{name.capitalize()} face"


def finding_groups(check: Check) -> list[Group]:
    """The findings by what they are on."""
    named = {**{name: face_title(name) for name in check.faces}, BODY: "Wall"}
    groups = []
    for surface, title in named.items():
        facts = tuple(each.answered for each in check.verdicts if each.place == surface)
        if facts:
            groups.append(Group(f"findings_{surface}", f"Manufacture, {title.lower()}", facts))
    return groups


def cutting_reasons(check: Check, spec: Spec) -> Iterator[Reason]:
    """Reasons why the lens cannot be made."""
    for finding in check.verdicts:
        of_part = finding.key in ("wall", "plate") and spec.manufacture.cuts == "inserts"  # an insert has none of them
        counts = finding.key != "tool" and not of_part
        if counts and not finding.holds:
            yield "fail", finding.note
    for name in check.faces:  # one tool is enough
        tools = [each for each in check.verdicts if each.key == "tool" and each.place == name]
        if tools and not any(each.holds for each in tools):
            yield "fail", "; ".join(each.note for each in tools)


_FACE = (
    Row("{name}_reached", "{Tip} reaches", "cutter.reachable_fraction", "of the face, radius {cutter.radius_mm}", "%"),
    Row(
        "{name}_concave",
        "Min. concave radius",
        "curvature.smallest_concave_radius_mm",
        "in any direction{of}",
        none="none",
    ),
    Row("{name}_layers", "Layer steps", "layer_step_um", "between the layers of the print"),
)
_MILLED = (
    Row(
        "{name}_tilt",
        "Max. tool tilt",
        "largest_tilt_deg",
        "of a tool held normal to the face",
        limit="manufacture.max_tilt_deg",
        by="tilt",
    ),
)
_TURNED = (
    Row("{name}_slope", "Max. slope", "cutter.slope_deg", "to tool axis", limit="manufacture.steepest_deg", by="slope"),
    Row("{name}_lathe_tilt", "Tilt of the tool", "cutter.tilt_deg", "of the turning tool, below 0 towards the axis"),
    Row("{name}_corner", "Fillets", "cutter.corner_fraction", "of the face, left by the nose in corners", "%"),
)
_SHAPE = (
    Row(
        "{name}_draft",
        "Draft, {name} face",
        "draft_deg.min",
        limit="lens.faces.{name}.draft_deg",
        sense=">=",
        by="draft",
    ),
    Row("{name}_sphere", "Best-fit sphere", "best_fit_sphere.radius_or_plane", "radius{of}", "mm", digits=5),
    Row("{name}_departure", "Departure, PV", "best_fit_sphere.pv_mm", "from the best-fit sphere{of}", "µm", factor=1e3),
    Row("{name}_departure_rms", "Departure, rms", "best_fit_sphere.rms_mm", "from it{of}", "µm", factor=1e3),
    Row("{name}_area", "Area", "area_mm2", "of the {body}"),
)


def _face(name: str, face: FaceResult, check: Check, spec: Spec) -> Iterator[Fact]:
    findings = [finding for finding in check.verdicts if finding.place == name]
    cutter, by_tool = face.cutter, tuple[Row, ...]()
    tip = "" if cutter is None else cutter.tip
    body = "mould insert" if spec.manufacture.cuts == "inserts" else "lens"
    whose = {"body": body, "of": "" if body == "lens" else f", of the {body}"}
    if cutter is not None:
        turned = isinstance(cutter, TurningTool)
        by_tool = _TURNED if turned else _MILLED
        yield _largest(name, cutter, check, state_of(findings, "nose" if turned else "cutter"))
    rows = (*_FACE, *by_tool, *_SHAPE)
    yield from facts_of(face, rows, spec=spec, judged=findings, name=name, tip=tip, Tip=tip.capitalize(), **whose)


def tip_keys(names: Iterable[str]) -> tuple[str, ...]:
    """Keys of the facts on the largest ball, or nose, of each face."""
    return tuple(f"{name}_{kind.tip}" for name in names for kind in (Cutter, TurningTool))


def shape_facts(check: Check, groups: Iterable[Group]) -> list[Fact]:
    """Facts in ``groups`` that decide if the faces can be made: the largest ball or nose of each face.

    Of a moulded part the face that is worst in each of three: the nose of its insert, its draft, what is released.
    """
    facts = {fact.key: fact for group in groups for fact in group.facts}
    tips = [facts[key] for key in tip_keys(check.faces) if key in facts]
    if check.mould is None:
        return tips
    kinds = tips, *([facts[f"{name}_{kind}"] for name in check.mould.faces] for kind in ("draft", "drawn"))
    return [min(each, key=_room) for each in kinds if each]


def _room(fact: Fact) -> float:
    """The value, less what it must be; infinite where nothing limits it."""
    return fact.value - (fact.limit or 0.0) if isinstance(fact.value, float) else inf


def _largest(name: str, cutter: Cutter, check: Check, state: FactState) -> Fact:
    """The largest ball that reaches the whole face, or nose that fits its concave parts, against the shop's."""
    largest, shop_mm = cutter.largest_radius_mm, cutter.radius_mm
    limits = largest is not None and largest < 1e3  # mm: beyond, it is flat for every tip
    if not limits:
        does = f"no concave region limits the {cutter.tip}"
    elif isinstance(cutter, TurningTool):
        does = "radius that fits the concave parts of the meridian"
    else:
        does = "largest ball that reaches the whole face"
    return Fact(
        f"{name}_{cutter.tip}",
        f"Largest {cutter.tip}, {name} face",
        largest if limits else "any",
        "mm",
        sense=">=",
        limit=shop_mm,
        limit_note="the shop's",
        state=state,
        note=f"{does}{check.relief.beyond_shop(largest, shop_mm, name)}",
        digits=3,
    )


_WALLS = (
    Row("thinnest", "Thinnest wall", "min_wall_mm", "along the normal", like="thinnest wall"),
    Row("thickest", "Thickest wall", "walls.thickest.thickness_mm", "radial, from the LED", like="largest radial wall"),
)


def _edge(edge: Edge, check: Check, spec: Spec) -> Fact:
    one, other = edge.faces
    first = spec.lens.role(one)
    of = words_of(spec).inner if first.before == CAVITY and not first.is_open else "the lens"
    note = f"minimum along their edge, in {of}"
    return Fact(
        f"edge_{other if first.is_open else one}", f"{one.capitalize()} and {other}", edge.angle_deg, "°", note=note
    ).judged_as(named(check.criteria, edge.criterion))
