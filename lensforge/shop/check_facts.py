"""Facts of the manufacturing check: each face, the wall, and what the shop can do with them."""

from collections.abc import Iterator, Sequence

from lensforge.optics.media import CAVITY, OPENING, SIDES
from lensforge.results import Bound, Fact, FactState, Group
from lensforge.results.criteria import kept, state_of
from lensforge.results.numerals import quantity
from lensforge.results.verdict import Reason
from lensforge.shop.check_result import BODY, FLAT_MM, Check, Edge, FaceResult, Finding
from lensforge.spec import Spec

_SUBJECTS = {
    "cutter": "Ball reaches it",
    "relief": "Base is clear",
    "tilt": "Tilt is allowed",
    "tool": "Tool reaches it",
    "draft": "Draft suffices",
    "wall": "Wall suffices",
    "gap": "Ball fits between lenses",
    "plate": "Walls of the plate suffice",
}


def check_facts(check: Check, spec: Spec) -> list[Group]:
    """A group for each face and one for the wall, and the findings on each of them."""
    faces = [Group(name, face_title(name), tuple(_face(name, face, check, spec))) for name, face in check.faces.items()]
    walls = Group("walls", "Wall", tuple(_wall(check, spec)))
    edges = [Group("edges", "Edges", tuple(_edge(each, check, spec) for each in check.edges))] if check.edges else []
    return [*faces, walls, *edges, *finding_groups(check)]


def face_title(name: str) -> str:
    """Title of a face."""
    return f"{name.capitalize()} face"


def finding_groups(check: Check) -> list[Group]:
    """The findings by what they are on: can it be cut?"""
    named = {**{name: face_title(name) for name in check.faces}, BODY: "Wall"}
    groups = []
    for surface, title in named.items():
        facts = tuple(_finding(each) for each in check.verdicts if each.surface == surface)
        if facts:
            groups.append(Group(f"findings_{surface}", f"Cutting, {title.lower()}", facts))
    return groups


def cutting_reasons(check: Check, spec: Spec) -> Iterator[Reason]:
    """Reasons why the lens cannot be cut."""
    for finding in check.verdicts:
        of_part = finding.name in ("wall", "plate") and spec.manufacture.make == "insert"  # an insert has none of them
        counts = finding.name != "tool" and not of_part
        if counts and not finding.holds:
            yield "fail", finding.reason
    for name in check.faces:  # one tool is enough
        tools = [each for each in check.verdicts if each.name == "tool" and each.surface == name]
        if tools and not any(each.holds for each in tools):
            yield "fail", "; ".join(each.reason for each in tools)


def _face(name: str, face: FaceResult, check: Check, spec: Spec) -> Iterator[Fact]:
    sphere, cutter = face.best_fit_sphere, face.cutter
    radius = sphere.radius_mm if sphere.radius_mm < FLAT_MM else "plane"
    yield from _ball(name, face, check)
    reached = f"of the face, by a ball of {quantity(cutter.radius_mm, 'mm')} radius"
    yield Fact.share(f"{name}_reached", "Ball reaches", cutter.reachable_fraction, reached)
    concave = face.curvature.smallest_concave_radius_mm
    yield Fact(f"{name}_concave", "Smallest hollow", "none" if concave is None else concave, "mm", note="radius")
    yield Fact(
        f"{name}_tilt",
        "Largest tilt",
        face.largest_tilt_deg,
        "°",
        limit=Bound("<=", spec.manufacture.max_tilt_deg),
        state=_state(check.verdicts, "tilt", name),
        note="of a tool that is held normal to the face",
    )
    least = spec.lens.faces[name].draft_deg
    yield Fact(
        f"{name}_draft",
        f"Draft, {name} face",
        face.draft_deg.min,
        "°",
        limit=None if least is None else Bound(">=", least),
        state="" if least is None else _state(check.verdicts, "draft", name),
    )
    yield Fact(f"{name}_sphere", "Best-fit sphere", radius, "mm", note="radius", digits=5)
    yield Fact(f"{name}_departure", "Departure from it", 1e3 * sphere.pv_mm, "µm", note="peak to valley")
    yield Fact(f"{name}_departure_rms", "Departure, rms", 1e3 * sphere.rms_mm, "µm")
    yield Fact(f"{name}_area", "Area", face.area_mm2, "mm²")


def _ball(name: str, face: FaceResult, check: Check) -> Iterator[Fact]:
    """The largest ball that reaches the whole face, against the shop's ball."""
    cutter = face.cutter
    largest = cutter.largest_radius_mm
    note = f"largest radius that reaches all of it{check.relief.beyond_shop(largest, cutter.radius_mm, name)}"
    yield Fact(
        f"{name}_ball",
        f"Ball mill, {name} face",
        "any" if largest is None else largest,
        "mm",
        limit=Bound(">=", cutter.radius_mm, "the shop's"),
        state=_state(check.verdicts, "cutter", name),
        note=note,
        digits=3,
    )


def _wall(check: Check, spec: Spec) -> Iterator[Fact]:
    limits = spec.constraints
    yield Fact(
        "thinnest",
        "Thinnest wall",
        check.min_wall_mm,
        "mm",
        limit=Bound(">=", limits.min_thickness_mm),
        state=kept(check.criteria, "thinnest wall").get("state", ""),
        note="along the normal",
    )
    yield Fact(
        "thickest",
        "Thickest wall",
        check.walls.thickest.thickness_mm,
        "mm",
        limit=None if limits.max_wall_mm is None else Bound("<=", limits.max_wall_mm),
        state=state_of(check.criteria, "largest radial wall"),
        note="seen from the LED",
    )


def _edge(edge: Edge, check: Check, spec: Spec) -> Fact:
    """The sharpest place of an edge."""
    least = spec.constraints.min_edge_angle_deg
    one, other = edge.faces
    of = "the mould’s core" if SIDES[one][0] == CAVITY and SIDES[one] != OPENING else "the lens"
    note = f"the sharpest of {of}, where these faces meet"
    return Fact(
        f"edge_{other if SIDES[one] == OPENING else one}",
        f"{one.capitalize()} and {other}",
        edge.angle_deg,
        "°",
        limit=None if least is None else Bound(">=", least),
        state=kept(check.criteria, edge.criterion).get("state", ""),
        note=note,
    )


def _finding(finding: Finding) -> Fact:
    """A finding: its answer, the reason as its note, and what to change in the spec."""
    return Fact(
        finding.name,
        _SUBJECTS[finding.name],
        "yes" if finding.holds else "no",
        state="pass" if finding.holds else "fail",
        note=finding.reason,
        remedy=finding.remedy,
    )


def _state(findings: Sequence[Finding], name: str, surface: str) -> FactState:
    """State of the findings called ``name`` on ``surface``; "" where there is none."""
    held = [each.holds for each in findings if each.name == name and each.surface == surface]
    return ("pass" if all(held) else "fail") if held else ""
