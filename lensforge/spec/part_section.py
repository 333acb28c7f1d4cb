"""The part and the shop: ``[base]``, which holds the lens below z = 0, ``[manufacture]``, and ``[drawing]``."""

from math import acos, asin, atan2, ceil, cos, degrees, hypot, pi, radians, sin, tan, tau
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from lensforge.errors import InputError
from lensforge.public import public
from lensforge.spec.derived_values import three_digits
from lensforge.spec.processes import LEVEL_DEG, MOST_TILT_DEG, PROCESSES, MakingProcess, Process
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_files import NamedFrom, read_toml
from lensforge.spec.spec_section import (
    CalendarDate,
    DraftOrNone,
    FilePath,
    Label,
    Millimetres,
    MillimetresOrZero,
    Section,
    check,
    rounded_up,
    section_of,
)

Fields = dict[str, Any]
_MOST_FEET = 32
_BALL_MM = 0.5
_SMALL_BALL = 0.2  # radius of a ball, of the largest radius of a lens for which the usual one is too large
_HEIGHT_MM = 2.0
_WHOLE_MM = 0.5  # heights are multiples of it
_SPARE_MM = 0.02  # of a step, whose depth is rounded up
_USUAL_WIDTH_TO_MM = 24.0  # largest radius of a lens whose cavity the usual width holds with room to spare
_WIDTH_OF_LARGE = 1.8  # of the largest radius
_HEIGHT_OF_LARGE = 0.125
_WIDE = f"left out, {_WIDTH_OF_LARGE:g} × max_radius_mm under a lens of more than {_USUAL_WIDTH_TO_MM:g} mm"
_MOST_SHRINKAGE = 0.1  # several times that of any optical plastic: PMMA, PC and PS shrink by 0.002 to 0.008


@public
class FeetSection(Section):
    """Round feet below a base, all alike, evenly on a circle about the axis: the part stands on them."""

    number: Annotated[int, Field(ge=1, le=_MOST_FEET)] = Field(default=3, description="Number of feet.")
    diameter_mm: Millimetres = Field(description="Diameter of a foot.")
    height_mm: Millimetres = Field(description="Height of a foot, below the base.")
    circle_diameter_mm: Millimetres = Field(description="Diameter of the circle on which their axes stand.")
    first_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = Field(
        default=0.0, description="Azimuth of the first, from +x towards +y."
    )

    @property
    def places_mm(self) -> tuple[tuple[float, float], ...]:
        """Places (x, y) of their axes."""
        radius = self.circle_diameter_mm / 2.0
        first = radians(self.first_deg)
        turns = [first + tau * k / self.number for k in range(self.number)]
        return tuple((radius * cos(turn), radius * sin(turn)) for turn in turns)

    @check
    def _stand_apart(self) -> None:
        if self.number > 1 and self.circle_diameter_mm * sin(pi / self.number) <= self.diameter_mm:
            raise ValueError(
                f"number = {self.number} feet of diameter_mm = {self.diameter_mm:g} overlap on a circle of "
                f"circle_diameter_mm = {self.circle_diameter_mm:g}: must be above "
                f"{rounded_up(self.diameter_mm / sin(pi / self.number))}"
            )


@public
class BaseSection(Section):
    """Clamping base: the paper's one-inch cylinder, a square, your own STEP file, or none.

    The three lengths of relief and bore, left out, are what the cutter needs at a face that is designed for it,
    and 0 elsewhere. A STEP file has all lengths itself.
    """

    kind: Literal["cylinder", "square", "step", "none"] = Field(
        default="cylinder", description='Shape of the base; "step": the body in `file`. With `[plate]` no base is made.'
    )
    file: FilePath | None = Field(
        default=None, description="STEP file of one solid in the lens's coordinates, its top in z = 0."
    )
    diameter_mm: Millimetres = Field(default=25.4, description=f"Diameter of a cylinder; {_WIDE}.")
    side_mm: Millimetres = Field(default=25.4, description=f"Side of a square; {_WIDE}.")
    height_mm: Millimetres = Field(
        default=_HEIGHT_MM,
        description="Total height; left out, more where a ball mill needs a step and a wall below it.",
    )
    relief_step_mm: MillimetresOrZero | None = Field(
        default=None, description="Depth of the base's top below the rim, so that a cutter reaches the rim."
    )
    relief_setback_mm: MillimetresOrZero | None = Field(
        default=None,
        description="Least distance of the step's wall, a circle, inside the rim; with 0 the wall follows the rim "
        "straight down.",
    )
    bore_setback_mm: MillimetresOrZero | None = Field(
        default=None,
        description="Least distance of the bore, a circle, outside the cavity's rim; with 0 it follows the rim "
        "straight down.",
    )
    flat_mm: Millimetres | None = Field(
        default=None, description="Distance of a clocking flat, across +x, from the axis."
    )
    pocket_diameter_mm: Millimetres | None = Field(
        default=None, description="Diameter of a wider bore from below, for the LED."
    )
    pocket_depth_mm: Millimetres = Field(default=1.0, description="Depth of that bore.")
    flange_diameter_mm: Millimetres | None = Field(default=None, description="Diameter of a wider ring at the bottom.")
    flange_height_mm: Millimetres = Field(default=0.5, description="Height of that ring.")
    feet: FeetSection | None = Field(default=None, description="Feet below its bottom; by default there are none.")
    draft_deg: DraftOrNone = Field(
        default=None,
        description="Draft of its sides, bore and feet; left out, 1 where the part is moulded, else 0. All are as "
        "wide as stated at their tops, and narrower below but for bore, pocket, and a side on a "
        "flange.",
    )

    @check
    def _feet_stand_below(self) -> None:
        if self.feet is None:
            return
        if self.kind not in ("cylinder", "square"):
            raise ValueError(f'feet go with kind = "cylinder" or "square", not "{self.kind}"; leave them out')
        wide = self.side_mm if self.kind == "square" else self.diameter_mm
        room = self.flange_diameter_mm or min(wide, 2.0 * (self.flat_mm or wide))
        reach = self.feet.circle_diameter_mm + self.feet.diameter_mm
        if reach >= room:
            raise ValueError(
                f"feet.circle_diameter_mm = {self.feet.circle_diameter_mm:g}: with diameter_mm = "
                f"{self.feet.diameter_mm:g} they reach {reach:g} mm across, and must stand within {room:g}"
            )

    @check
    def _file_is_the_whole_base(self) -> None:
        if (self.kind == "step") != (self.file is not None):
            raise ValueError('kind = "step" and file go together: give both, or neither')
        room = ("relief_step_mm", "relief_setback_mm", "bore_setback_mm")
        shapes = (*room, "flat_mm", "pocket_diameter_mm", "flange_diameter_mm")
        given = [name for name in shapes if getattr(self, name)] + self._given("diameter_mm", "side_mm", "height_mm")
        if self.kind == "step" and given:
            stated = f"{given[0]} = {getattr(self, given[0]):g}"
            raise ValueError(f"{stated} does not go with kind = 'step': the file holds the whole base; leave it out")

    @check
    def _no_length_goes_with_nothing(self) -> None:
        """A length that is not the default has something to be the length of; a stored spec states defaults too."""
        for width, length in (("pocket_diameter_mm", "pocket_depth_mm"), ("flange_diameter_mm", "flange_height_mm")):
            if getattr(self, width) is None and self._given(length):
                raise ValueError(f"{length} = {getattr(self, length):g} goes with {width}; give both, or neither")
        for kind, other_kind, width in (("cylinder", "square", "side_mm"), ("square", "cylinder", "diameter_mm")):
            if self.kind == kind and self._given(width):
                stated = f"{width} = {getattr(self, width):g}"
                raise ValueError(f'{stated} goes with kind = "{other_kind}", not "{kind}"; leave it out')

    def _given(self, *names: str) -> list[str]:
        return [name for name in names if getattr(self, name) != type(self).model_fields[name].default]

    @check
    def _heights_fit(self) -> None:
        flange = 0.0 if self.flange_diameter_mm is None else self.flange_height_mm
        pocket = 0.0 if self.pocket_diameter_mm is None else self.pocket_depth_mm
        if self.kind in ("none", "step"):
            return
        if self.relief_setback_mm and not self.step_mm:
            raise ValueError(
                f"relief_setback_mm = {self.relief_setback_mm:g} needs a relief_step_mm above 0, not {self.step_mm:g}"
            )
        if self.step_mm + flange >= self.height_mm:
            stated = f"relief_step_mm = {self.step_mm:g} and the flange's height, {flange:g}"
            raise ValueError(f"{stated}, must together be below height_mm = {self.height_mm:g}")
        if pocket >= self.height_mm:
            raise ValueError(f"pocket_depth_mm = {pocket:g} must be below height_mm = {self.height_mm:g}")
        if self.flat_mm is not None and not (self.kind == "cylinder" and self.flat_mm < self.diameter_mm / 2.0):
            raise ValueError(f"flat_mm = {self.flat_mm:g}: a flat is cut from a cylinder, below diameter_mm / 2")
        if self.flange_diameter_mm is not None and self.flange_diameter_mm <= self.widest_mm:
            stated = f"flange_diameter_mm = {self.flange_diameter_mm:g}"
            raise ValueError(f"{stated}: must exceed the width of the base, {self.widest_mm:g}")

    @property
    def slope(self) -> float:
        """Tangent of the draft."""
        return tan(radians(self.draft_deg or 0.0))

    @property
    def foot_radii_mm(self) -> tuple[float, float]:
        """Radii of a foot at its root and at its end."""
        assert self.feet is not None
        return self.feet.diameter_mm / 2.0, self.feet.diameter_mm / 2.0 - self.slope * self.feet.height_mm

    @property
    def step_mm(self) -> float:
        """``relief_step_mm``, 0 where it is left out."""
        return self.relief_step_mm or 0.0

    @property
    def seat_mm(self) -> float:
        """Depth below z = 0 of the bottom or the feet, on which the part sits; 0 without a base, and of a file."""
        feet_mm = 0.0 if self.feet is None else self.feet.height_mm
        return self.height_mm + feet_mm if self.kind in ("cylinder", "square") else 0.0

    @property
    def widest_mm(self) -> float:
        """Diameter of the smallest cylinder about the axis that holds the base without its flange."""
        return self.side_mm * 2.0**0.5 if self.kind == "square" else self.diameter_mm


def usual_ball_mm(limits: ConstraintsSection) -> float:
    """Radius of the ball cutter for a lens within ``limits``, where none is stated."""
    return min(_BALL_MM, three_digits(_SMALL_BALL * limits.max_radius_mm))


def usual_base(base: BaseSection, shop: "ManufactureSection", limits: ConstraintsSection, hidden: bool) -> Fields:
    """Fields of a ``base`` that are left out; under a lens that is cut it has a step as deep as the tool needs.

    ``hidden``: it would lie under a face that widens above it, which neither a tool nor a mould then reaches: without
    any field there is none.
    """
    if hidden and shop.required and shop.making.comes_from_below and not base.model_fields_set:
        return {"kind": "none"}
    if base.kind in ("none", "step"):
        return {}
    fields = _below_large_lens(base, limits.max_radius_mm)
    if not (shop.required and shop.cuts == "lens"):
        return fields
    flange_mm = 0.0 if base.flange_diameter_mm is None else base.flange_height_mm
    needed_mm = shop.tool_radius_mm + flange_mm + limits.min_thickness_mm + _SPARE_MM
    least_mm = max(_HEIGHT_MM, _WHOLE_MM * ceil(needed_mm / _WHOLE_MM))
    return {**fields, "height_mm": max(least_mm, fields.get("height_mm", 0.0))}


def _below_large_lens(base: BaseSection, radius_mm: float) -> dict[str, float]:
    """Width and height of a base whose usual width does not hold the cavity of so large a lens; else empty."""
    if radius_mm <= _USUAL_WIDTH_TO_MM:
        return {}
    width = "side_mm" if base.kind == "square" else "diameter_mm"
    return {width: _WIDTH_OF_LARGE * radius_mm, "height_mm": _HEIGHT_OF_LARGE * radius_mm}


def mouth_room_deg(mouth_mm: float, above_mm: float, radius_mm: float) -> float:
    """Largest tilt (degrees) of a shank of ``radius_mm`` that leaves a mouth of ``mouth_mm`` radius.

    It begins on the axis, ``above_mm`` above the lower end of the mouth, where it then touches the edge.
    """
    slant_mm = hypot(mouth_mm, above_mm)
    if slant_mm <= radius_mm:
        return 0.0
    return max(degrees(atan2(mouth_mm, above_mm) - asin(radius_mm / slant_mm)), 0.0)


def undercut_room_deg(base: BaseSection, shop: "ManufactureSection", limits: ConstraintsSection) -> float:
    """Farthest (degrees) that the outer face may be undercut at its rim before the ball meets the ``base``.

    The ball, of radius R, then reaches R (1 + sin u) below the rim, as deep as the step at most, and R (1 - cos u)
    inwards, as far as its wall is set back. Where that is not stated none is: what the bore leaves of the wall beside
    the step is known after the search alone. A base from a file leaves no such room.
    """
    if base.kind == "none":
        return LEVEL_DEG
    if base.kind == "step":
        return 0.0
    flange_mm = 0.0 if base.flange_diameter_mm is None else base.flange_height_mm
    depth_mm = base.relief_step_mm
    if depth_mm is None:
        depth_mm = base.height_mm - flange_mm - limits.min_thickness_mm - _SPARE_MM
    by_depth = asin(min(max(depth_mm / shop.cutter_radius_mm - 1.0, 0.0), 1.0))
    by_setback = acos(max(1.0 - (base.relief_setback_mm or 0.0) / shop.cutter_radius_mm, 0.0))
    return degrees(min(by_depth, by_setback))


_FLAT = 0.95  # of the radius of a base: a flat as wide as 0.31 of its diameter


def usual_flat_mm(base: BaseSection) -> float:
    """Distance from the axis of a flat that marks the azimuth of a cylinder."""
    return round(_FLAT * base.diameter_mm / 2.0, 2)


@public
class Tool(Section):
    """A ball-end mill: ball, a cylindrical shank of ``length_mm`` from the ball's centre, then the holder's cone."""

    name: Annotated[Label, Field(min_length=1)] = Field(description="Name of the tool in verdicts.")
    radius_mm: Millimetres = Field(description="Radius of the ball.")
    shank_radius_mm: Millimetres = Field(description="Radius of the shank.")
    length_mm: Millimetres = Field(description="Length of the shank, from the ball's centre.")
    holder_half_angle_deg: Annotated[float, Field(ge=0.0, lt=90.0)] = Field(
        default=45.0, description="Half angle of the holder's cone."
    )


@public
class ManufactureSection(Section):
    """Process by which the lens is made, and the equipment of the shop: a ball cutter, further mills with shank and
    holder, and a turning tool.
    """

    cutter_radius_mm: Millimetres = Field(
        default=_BALL_MM,
        description="Radius of the ball cutter; left out, of a small lens a fifth of its largest radius.",
    )
    tools: Annotated[tuple[Tool, ...], Field(max_length=100)] = Field(default=(), description="Further ball-end mills.")
    process: Process | None = Field(
        default=None,
        description="Process by which the lens is made, whose limits the search keeps: milled or turned itself, "
        'moulded between inserts that are, extruded through a die, or printed; "none": a study of light, of which '
        "nothing is made or judged. By default a lens whose faces are all of revolution is turned, a linear lens is "
        "extruded, a `[plate]` and a lens whose edges no ball reaches are moulded, any other lens is milled.",
    )
    shrinkage: Annotated[float, Field(ge=0.0, le=_MOST_SHRINKAGE)] = Field(
        default=0.0,
        description="Shrinkage of the moulded lens, as a share; the insert's faces are the lens's times 1 + shrinkage.",
    )
    nose_radius_mm: Millimetres = Field(
        default=0.02, description="Radius of the nose of the turning tool, the smallest that there is."
    )
    included_angle_deg: Annotated[float, Field(ge=0.0, le=150.0)] = Field(
        default=35.0, description="Angle between the two flanks of the turning tool."
    )
    clearance_deg: Annotated[float, Field(ge=0.0, le=60.0)] = Field(
        default=2.0, description="Least angle between a flank of the turning tool and the face that it cuts."
    )
    shank_width_mm: Millimetres = Field(
        default=1.5,
        description="Width of the turning tool in a bore, from its nose across: there its shank runs along the axis.",
    )
    wire_radius_mm: Millimetres = Field(
        default=0.15,
        description="Radius of the wire that cuts the die of an extrusion, the least convex radius of a profile.",
    )
    most_wall_ratio: Annotated[float, Field(ge=1.0, le=1e3)] | None = Field(
        default=None,
        description="Largest ratio of the thickest to the thinnest wall of an extrusion; left out, it is not judged.",
    )
    layer_um: Annotated[float, Field(ge=1e-3, le=1e4)] | None = Field(
        default=None, description="Height of the layers of a print, along the axis."
    )
    form_tolerance_um: Annotated[float, Field(ge=1e-3, le=1e4)] | None = Field(
        default=None,
        description="Full width of the zone, half of it on each side of the face along its normal, in which every "
        "point of an optical face must lie.",
    )
    form_nm: Annotated[float, Field(ge=0.1, le=1e4)] | None = Field(
        default=None, description="Largest form error of the optical faces in the STEP file; 50 where it is left out."
    )
    normal_mrad: Annotated[float, Field(ge=1e-3, le=10.0)] | None = Field(
        default=None,
        description="Largest error of their normals; left out, 0.2 or less, so that light moves by no more than a "
        "twentieth of the LED's image.",
    )
    required: bool = Field(
        default=True,
        description="The search keeps the limits of the process, and a part that cannot be made is a failure of the "
        "run; left out, false where there is no process.",
    )
    max_tilt_deg: Annotated[float, Field(ge=0.0, le=MOST_TILT_DEG)] = Field(
        default=LEVEL_DEG,
        description="Largest angle between a tool's axis and the lens axis; a face may be undercut as far, as a ball "
        "cuts up to its equator.",
    )
    author: Label = Field(default="", description="Author of the files for the shop.")
    organisation: Label = Field(default="", description="Organisation in the files for the shop.")
    date: CalendarDate | None = Field(
        default=None, description="Date of the files for the shop, which never take one from the clock."
    )

    @check
    def _fields_go_with_the_process(self) -> None:
        if self.process is None:  # before it is derived
            return
        for process in PROCESSES.values():
            for name in process.fields if process.name != self.process else ():
                if value := getattr(self, name):
                    raise ValueError(
                        f'{name} = {value:g} goes with process = "{process.name}", not "{self.process}"; leave it out'
                    )

    @check
    def _only_a_part_is_required(self) -> None:
        if self.required and self.process == "none" and "required" in self.model_fields_set:
            raise ValueError('required = true goes with a part, not with process = "none"; leave it out')

    @check
    def _flanks_leave_a_nose(self) -> None:
        if self.shank_width_mm < 2.0 * self.nose_radius_mm:
            raise ValueError(
                f"shank_width_mm = {self.shank_width_mm:g}: must be at least twice nose_radius_mm, "
                f"{2.0 * self.nose_radius_mm:g}"
            )
        if self.steepest_deg <= 0.0:
            raise ValueError(
                f"included_angle_deg = {self.included_angle_deg:g} and clearance_deg = {self.clearance_deg:g}: the "
                "clearance and half the angle must together be below 90"
            )

    def draft_deg(self, stated: float | None) -> float:
        """Draft of a side: as ``stated``, else what the process needs."""
        return self.making.side_draft_deg if stated is None else stated

    @property
    def making(self) -> MakingProcess:
        """The process, with what it asks and its words."""
        assert self.process is not None  # it is derived
        return PROCESSES[self.process]

    @property
    def steepest_deg(self) -> float:
        """Largest angle between the axis of the turning tool and the normal of a face that its flanks clear."""
        return 90.0 - self.included_angle_deg / 2.0 - self.clearance_deg

    @property
    def tool_radius_mm(self) -> float:
        """Radius of the tool that cuts the lens itself: of the ball, or of the nose where the lens is turned."""
        return self.nose_radius_mm if self.process == "turned" else self.cutter_radius_mm

    @property
    def cuts(self) -> Literal["lens", "inserts"] | None:
        """Body that tools cut: the lens itself, or the inserts of its mould; None if none does."""
        return self.making.cuts

    @property
    def scale(self) -> float:
        """Factor from the faces of the lens to those that are cut: 1 + shrinkage for an insert, 1 for the lens."""
        return 1.0 + self.shrinkage


@public
class DrawingSection(Section):
    """Title block and notes of the drawing that ``lensforge handover`` makes; author and date are of [manufacture].

    What is left out is "not stated" on the drawing: nothing is made up.
    """

    part_name: Label = Field(default="", description="Name of the part; left out, the name of the design.")
    part_number: Label = Field(default="", description="Number of the part or of the drawing.")
    revision: Label = Field(default="", description="Revision of the drawing.")
    checked_by: Label = Field(default="", description="Name of who has checked the drawing.")
    sheet: Literal["A3", "A4"] | None = Field(default=None, description="Size of the sheet; left out, A3.")
    general_tolerances: Label = Field(
        default="", description='Tolerances of dimensions without one of their own, such as "ISO 2768-m".'
    )
    material_grade: Label = Field(
        default="", description='Grade of the material that is ordered, such as "PMMA, moulding compound 8N".'
    )
    edge_break_mm: Annotated[float, Field(ge=1e-3, le=10.0)] | None = Field(
        default=None, description="Largest break of the edges outside the optical faces, a radius or a chamfer."
    )
    optical_edge_mm: Annotated[float, Field(ge=1e-3, le=10.0)] | None = Field(
        default=None, description="Largest radius of the rims and creases of the optical faces."
    )
    finish: Label = Field(default="", description='Surface class of all other faces, such as "VDI 3400, class 18".')
    roughness_nm: Annotated[float, Field(ge=1e-3, le=1e5)] | None = Field(
        default=None, description="Largest roughness of the optical faces, rms of height (Rq)."
    )
    imperfections: Label = Field(
        default="", description='Imperfections allowed on the optical faces, such as "5 x 0.16": number and grade.'
    )


def read_drawing(path: Path) -> DrawingSection:
    """The ``[drawing]`` of a TOML file, such as a spec. Raises :class:`InputError` where it has none."""
    content = read_toml(path, "give a TOML file with [drawing]").get("drawing")
    if not isinstance(content, dict):
        raise InputError(f"{path}: has no [drawing]; add one, or give another file")
    return section_of(DrawingSection, content, f"{path}: drawing", NamedFrom(path.parent, there=True))
