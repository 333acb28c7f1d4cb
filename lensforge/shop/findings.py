"""Findings of the check: one statement for the shop on each measurement, its reason, and the changes that mend it.

All follow from the measurements of the check and the spec alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import ceil, floor
from typing import TYPE_CHECKING, Annotated, Literal

from lensforge.cad.part_limits import ANGLE_TOLERANCE_DEG, FIT_TOLERANCE
from lensforge.results import Fact, Sense
from lensforge.results.fact import Change, StoredAs
from lensforge.results.numerals import percent, quantity
from lensforge.results.verdict import within
from lensforge.shop.check_measures import (
    AnyClearance,
    BallClearance,
    BoreClearance,
    CustomBaseClearance,
    Cutter,
    FaceResult,
    Mould,
    MouldedFace,
    StepClearance,
    ToolReach,
    ToolResult,
)
from lensforge.spec import BaseSection, Spec
from lensforge.spec.processes import GOOD_DRAFT_DEG, MOST_TILT_DEG

if TYPE_CHECKING:
    from lensforge.cad.plate_layout import PlateWall

OfMill = Literal["cutter", "relief", "tilt", "tool", "gap"]
OfLathe = Literal["nose", "slope", "turning", "corner"]
OfDie = Literal["wire", "even"]
FindingName = OfMill | OfLathe | OfDie | Literal["layer", "wall", "draft", "undercut", "plate"]
BODY = "body"  # the place of a finding on none of the faces
# Question, sense and unit of each finding.
FINDINGS: dict[str, tuple[str, Sense, str]] = {
    "cutter": ("Ball reaches the face", "<=", "mm"),
    "nose": ("Nose fits the face", "<=", "mm"),
    "slope": ("Flanks clear the face", "<=", "deg"),
    "turning": ("Tool reaches the face", ">=", "of the face"),
    "corner": ("Fillets small enough", "<=", "of the face"),
    "wire": ("Wire cuts the die", "<=", "mm"),
    "even": ("Walls even enough", "<=", ""),
    "layer": ("Layers fine enough", "<=", "µm"),
    "relief": ("Base clears the ball", "<=", "mm"),
    "tilt": ("Tool tilt within limit", "<=", "deg"),
    "wall": ("Wall thick enough", ">=", "mm"),
    "draft": ("Draft large enough", ">=", "deg"),
    "undercut": ("Mould releases the face", "<=", "of the face"),
    "tool": ("Tool reaches the face", ">=", "of the face"),
    "gap": ("Ball fits between lenses", "<=", "mm"),
    "plate": ("Plate walls thick enough", ">=", "mm"),
}


def as_finding(fact: Fact) -> Fact:
    """The fact as a statement on what the shop can do with this lens, with the reason in its note.

    Its key is a :data:`FindingName`, its place a face or :data:`BODY`. A value of None: the ball reaches nothing; a
    limit of None: any ball reaches the face.
    """
    if fact.key not in FINDINGS:
        raise ValueError(f"name: must be one of {', '.join(FINDINGS)}")
    question, _, _ = FINDINGS[fact.key]
    return replace(fact, label=question).judged()


_NAMES = {name: name for name in ("value", "sense", "limit", "unit", "tolerance")}
_STORED = StoredAs(
    _NAMES | {"name": "key", "surface": "place", "reason": "note", "remedy": "remedy", "holds": "holds"}, as_finding
)
Findings = tuple[Annotated[Fact, _STORED], ...]

SHARE_TOLERANCE = 1e-9  # of the whole face: areas of its cells add up to rounding
_LEAST_WALL_MM = 1e-3  # a thinner one is none
_ABOVE_STEP_MM = 0.1  # of the base that a relief leaves, at least


def check_findings(
    spec: Spec,
    faces: Mapping[str, FaceResult],
    wall_mm: float,
    relief: BallClearance,
    tools: tuple[ToolResult, ...],
    mould: Mould | None = None,
) -> tuple[Fact, ...]:
    """Findings on a lens of ``spec`` from the measurements of its check, except those on turning and printing.

    ``wall_mm``: the thinnest wall. ``mould``: of a part that is moulded: its faces are judged from both halves, and by
    no tilt of a tool.
    """
    moulded = {} if mould is None else mould.faces
    milled = {name: face for name, face in faces.items() if spec.cutting(name) == "milled"}
    return (
        *(
            cutter_finding(name, face.cutter, relief, spec)
            for name, face in milled.items()
            if face.cutter is not None  # else of a record that is not of this spec
        ),
        *clearance_findings(relief, spec.base),
        *(tilt_finding(name, face, spec) for name, face in milled.items() if name not in moulded),
        wall_finding(wall_mm, spec),
        *(undercut_finding(name, face, spec) for name, face in moulded.items()),
        *(
            draft_finding(name, face, spec, moulded.get(name))
            for name, face in faces.items()
            if spec.asked_draft_deg(name) is not None
        ),
        *(
            tool_finding(tool, name, tool.faces[name], None if face.cutter is None else face.cutter.largest_radius_mm)
            for tool in tools
            for name, face in milled.items()
        ),
    )


def finding_on(
    name: FindingName,
    surface: str,
    value: float | None,
    limit: float | None,
    reason: str,
    changes: Sequence[str | Change | None] = (),
    tolerance: float = 0.0,
) -> Fact:
    """A finding with those ``changes`` of the spec that would help; None among them is dropped.

    A change of one field to a number stays a :class:`Change`, for a button that makes it.
    """
    _, sense, unit = FINDINGS[name]
    fact = Fact(name, "", value, unit, sense=sense, limit=limit, note=reason, tolerance=tolerance, place=surface)
    finding = as_finding(fact)
    if finding.holds:
        return finding
    of_a_field = tuple(change for change in changes if isinstance(change, Change))
    return replace(finding, remedy=", or ".join(map(str, filter(None, changes))), changes=of_a_field)


def cutter_finding(surface: str, cutter: Cutter, relief: BallClearance, spec: Spec) -> Fact:
    """Reach of the spec's ball cutter on a face."""
    largest = cutter.largest_radius_mm
    redesign = design_again("concave_radius_mm", cutter.radius_mm, spec, surface)
    changes = [redesign if spec.manufacture.cuts == "lens" else None]
    if largest is not None:
        changes.append(Change("manufacture.cutter_radius_mm", rounded_down_mm(largest)))
    ball = f"a ball of {quantity(cutter.radius_mm, 'mm')} radius"
    tolerance = 0.0 if largest is None else FIT_TOLERANCE * largest
    if within(cutter.radius_mm, "<=", largest, tolerance):
        most = "any" if largest is None else f"at most {quantity(largest, 'mm', digits=4)}"
        base = relief.beyond_shop(largest, cutter.radius_mm, surface)
        reason = f"{ball} reaches the whole {surface} face; usable radius: {most}{base}"
    else:
        reason = (
            f"{ball} reaches {percent(cutter.reachable_fraction)} of the {surface} face; "
            f"largest usable radius: {quantity(largest, 'mm', digits=4)}"
        )
    return finding_on("cutter", surface, cutter.radius_mm, largest, reason, changes, tolerance)


def clearance_findings(relief: BallClearance, base: BaseSection) -> list[Fact]:
    """Clearance of the ball at ``base``: one finding for each face that has a base below it."""
    return [_clearance_finding(surface, clearance, base) for surface, clearance in relief.faces.items()]


def _clearance_finding(surface: str, relief: AnyClearance, base: BaseSection) -> Fact:
    """Clearance at one face: the base must retreat by nothing; unknown for a face that the ball does not reach."""
    needed = relief.needed_mm
    changes = list[str | Change]()
    if needed is None:
        reason = f"the ball reaches no part of the {surface} face, with or without the base"
    elif within(needed, "<=", 0.0):
        reason = f"the base clears the ball at the {surface} face"
    else:
        reason = f"with this base the ball reaches {percent(relief.flush_fraction)} of the {surface} face"
        if isinstance(relief, StepClearance) and relief.step_clearance_mm:
            reason += "; its rim is undercut"
        changes = _room_at_base(relief, base)
    return finding_on("relief", surface, needed, 0.0, reason, changes)


def _room_at_base(relief: AnyClearance, base: BaseSection) -> list[str | Change]:
    """Changes of the base each of which clears the ball."""
    match relief:
        case CustomBaseClearance():
            cut = quantity(relief.retreat_mm, "mm", digits=4)
            return [f"cut the base in its file back by up to {cut} where the ball hits it"]
        case BoreClearance():
            needed = {"bore_setback_mm": relief.bore_clearance_mm, "pocket_diameter_mm": relief.pocket_diameter_mm}
            return [_together([Change(f"base.{name}", _up(value, 4)) for name, value in needed.items() if value])]
        case StepClearance():
            smaller = ["a smaller base.flange_diameter_mm in place of the height"] if relief.flange_clearance_mm else []
            return [_together(_room_at_step(relief, base)), *smaller]


def _together(changes: Sequence[Change]) -> str | Change:
    """Changes that clear the ball together; a single one is returned as it is, for a button that makes it."""
    return changes[0] if len(changes) == 1 else " and ".join(map(str, changes))


def _room_at_step(relief: StepClearance, base: BaseSection) -> list[Change]:
    """Fields that clear the ball while the flange stays at the bottom and some of the base remains above it."""
    fields = {"relief_step_mm": relief.smallest_step_mm, "relief_setback_mm": relief.step_clearance_mm}
    needed = [Change(f"base.{name}", _up(value, 4)) for name, value in fields.items() if value]
    flange_mm = 0.0 if base.flange_diameter_mm is None else base.flange_height_mm
    height_mm = base.height_mm + (relief.flange_clearance_mm or 0.0)
    least_mm = (relief.smallest_step_mm or 0.0) + flange_mm
    if relief.smallest_step_mm and least_mm >= height_mm:
        height_mm = least_mm + _ABOVE_STEP_MM
    if height_mm > base.height_mm:
        needed.append(Change("base.height_mm", _up(height_mm, 4)))
    return needed


def tilt_finding(surface: str, face: FaceResult, spec: Spec) -> Fact:
    """Tilt at which an axis reaches all of the face; remedies: a search for less, or a machine that tilts farther."""
    tilt_deg = face.largest_tilt_deg
    most_deg = spec.manufacture.max_tilt_deg
    is_machine = face.free_tilt_deg is None or face.free_tilt_deg >= most_deg
    changes = [design_again("draft_deg", 0.0, spec, surface)]
    if is_machine and tilt_deg <= MOST_TILT_DEG:
        changes.append(Change("manufacture.max_tilt_deg", _up(tilt_deg, 1)))
    reason = f"an upright axis reaches the {surface} face"
    if tilt_deg > 0.0:
        undercut = f"the {surface} face is undercut by up to {quantity(tilt_deg, 'deg', digits=4)}"
        limit = f"manufacture.max_tilt_deg = {most_deg:g}"
        if not is_machine:
            limit = f"the mouth of the cavity leaves {quantity(face.free_tilt_deg, 'deg', digits=4)}"
        reason = f"{undercut}, by which the axis must tilt; {limit}"
    return finding_on("tilt", surface, tilt_deg, face.free_tilt_deg, reason, changes, ANGLE_TOLERANCE_DEG)


def wall_finding(wall_mm: float, spec: Spec) -> Fact:
    """Thinnest wall; remedies: a search from faces farther apart, or a smaller limit in the spec."""
    required_mm = spec.constraints.min_thickness_mm
    tolerance = spec.constraints.tolerance_mm
    changes = list[str | Change]()
    holds = within(wall_mm, ">=", required_mm, tolerance)
    inwards = spec.lens.names[0]
    outwards = spec.lens.outward
    fixed = spec.lens.fixed
    if fixed[outwards] is None:
        changes.append(f"a larger lens.{outwards}.offset_mm and design again")
    elif fixed[inwards] is None:
        changes.append(f"a smaller lens.{inwards}.offset_mm and design again")
    if wall_mm >= _LEAST_WALL_MM:
        changes.append(Change("constraints.min_thickness_mm", rounded_down_mm(wall_mm), " where that is enough"))
    word = "at least" if holds else "less than"
    thinnest = quantity(wall_mm, "mm", digits=4)
    reason = f"the thinnest wall is {thinnest}, {word} constraints.min_thickness_mm = {required_mm:g}"
    return finding_on("wall", BODY, wall_mm, required_mm, reason, changes, tolerance)


def plate_findings(spec: Spec, gap_mm: float | None, wall: "PlateWall | None") -> Iterator[Fact]:
    """Gap for the ball between the lenses of a plate that is cut, and the thinnest wall of the plate."""
    shop = spec.manufacture
    required_mm = spec.constraints.min_thickness_mm
    tolerance = spec.constraints.tolerance_mm
    if gap_mm is not None and shop.cuts == "lens":
        wide = 2.0 * shop.cutter_radius_mm
        fits = "fits" if within(wide, "<=", gap_mm, tolerance) else "does not fit"
        reason = f"a ball of {quantity(wide, 'mm')} diameter {fits} between two lenses, {quantity(gap_mm, 'mm')} apart"
        smaller = Change("manufacture.cutter_radius_mm", rounded_down_mm(gap_mm / 2.0))
        yield finding_on("gap", BODY, wide, gap_mm, reason, [smaller, "a wider pitch of lamps"], tolerance)
    if wall is not None:
        thickness = quantity(wall.thickness_mm, "mm", digits=4)
        reason = (
            f"the plate's wall between {wall.between} is {thickness}; constraints.min_thickness_mm = {required_mm:g}"
        )
        changes = ["another place for one of the two"]
        yield finding_on("plate", BODY, wall.thickness_mm, required_mm, reason, changes, tolerance)


def undercut_finding(surface: str, face: MouldedFace, spec: Spec) -> Fact:
    """Share of a face that neither half of the mould releases."""
    share = face.undercut_fraction
    heights = face.undercut_heights_mm
    if heights is None:
        reason = (
            f"{drawn_by(face)} of the mould {'release' if 'both' in drawn_by(face) else 'releases'} the {surface} face"
        )
        return finding_on("undercut", surface, share, 0.0, reason)
    low, high = (quantity(round(height, 2) + 0.0, digits=4) for height in heights)
    reason = (
        f"{percent(share)} of the {surface} face is undercut, from z = {low} to {high} mm: neither half of the mould "
        "releases it, the part itself is in the way"
    )
    wanted_deg = spec.asked_draft_deg(surface) or GOOD_DRAFT_DEG
    slanted = within(face.draft_deg, ">=", wanted_deg)  # and hidden all the same
    changes: list[str | Change | None] = [] if slanted else [design_again("draft_deg", wanted_deg, spec, surface)]
    if spec.base_made.kind != "none":
        changes += ['base.kind = "none"', "a narrower base"]
    return finding_on("undercut", surface, share, 0.0, reason, changes)


def drawn_by(face: MouldedFace) -> str:
    """Phrase for the half of the mould that releases a face."""
    if min(face.upper_fraction, face.lower_fraction) > SHARE_TOLERANCE:
        return "both halves"
    return "the upper half" if face.upper_fraction > face.lower_fraction else "the lower half"


def draft_finding(surface: str, face: FaceResult, spec: Spec, moulded: MouldedFace | None = None) -> Fact:
    """Draft against the spec's limit, or else a mould's need; ``moulded``: the face as its mould halves release it."""
    least_deg = face.draft_deg.min
    undercut = face.undercut_fraction
    stated_deg = spec.lens.faces[surface].draft_deg
    wanted_deg = spec.asked_draft_deg(surface) or 0.0
    redesign = design_again("draft_deg", wanted_deg, spec, surface)
    if moulded is not None:
        if moulded.draft_deg is None:
            reason = f"neither half of the mould releases any of the {surface} face"
            return finding_on("draft", surface, None, wanted_deg, reason, [redesign])
        least_deg = moulded.draft_deg
        undercut = 0.0
    if undercut > 0.0:
        worst = quantity(least_deg, "deg", digits=3)
        reason = f"{percent(undercut)} of the {surface} face is undercut, down to a draft of {worst}"
    else:
        least_deg = max(least_deg, 0.0)  # form error of a vertical rim
        needed = f"{'a mould needs' if stated_deg is None else 'the spec requires'} {quantity(wanted_deg, 'deg')}"
        reason = f"the minimum draft of the {surface} face is {quantity(least_deg, 'deg', digits=3)}; {needed}"
    return finding_on("draft", surface, least_deg, wanted_deg, reason, [redesign], ANGLE_TOLERANCE_DEG)


def tool_finding(tool: ToolResult, surface: str, reach: ToolReach, largest_mm: float | None) -> Fact:
    """Reach of a tool on a face, and what limits it; ``largest_mm``: the largest ball that reaches the whole face."""
    ball = reach.ball_reachable_fraction
    whole = reach.reachable_fraction
    changes = []
    reason = f"{tool.name} reaches {percent(whole)} of the {surface} face"
    if not within(whole, ">=", ball, SHARE_TOLERANCE):
        reason += f"; its ball alone reaches {percent(ball)}: shank or holder collides, a longer tool may help"
    if not within(ball, ">=", 1.0, SHARE_TOLERANCE) and largest_mm is not None:
        reason += f"; largest usable ball radius: {quantity(largest_mm, 'mm', digits=4)}"
    if largest_mm is not None and largest_mm < tool.radius_mm:
        changes.append(f"a tool in manufacture.tools with radius_mm = {rounded_down_mm(largest_mm)} or less")
    if whole < ball:
        changes.append(f"a tool with length_mm above {tool.length_mm:g}")
    return finding_on("tool", surface, whole, 1.0, reason, changes, SHARE_TOLERANCE)


def design_again(field: str, value: float, spec: Spec, surface: str) -> Change | None:
    """A change of the search's limit; None for a face given by the spec, or if the search has met that limit.

    A face that follows another has no limits of its own: its draft is that of the other.
    """
    if followed := spec.lens.role(surface).follows:
        return design_again(field, value, spec, followed) if field == "draft_deg" else None
    limit: float | None = getattr(spec.face_limits(surface), field)
    if spec.lens.fixed[surface] is not None or (limit is not None and limit >= value):
        return None
    return Change(f"lens.{surface}.{field}", f"{value:g}", " and design again")


def _up(value: float, decimals: int) -> str:
    """A value for a spec, rounded up to be sufficient."""
    return f"{ceil(round(value * 10**decimals, 6)) / 10**decimals:g}"


def rounded_down_mm(length_mm: float) -> str:
    """A length that is rounded down to 1 um, so that the ball still fits."""
    return f"{floor(1e3 * length_mm) / 1e3:g}"
