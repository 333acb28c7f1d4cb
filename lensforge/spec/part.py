"""The part and the shop: ``[base]``, which holds the lens below z = 0, and ``[manufacture]``."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lensforge.spec.section import CalendarDate, FilePath, Label, Millimetres, MillimetresOrZero, Section

_MOST_SHRINKAGE = 0.1  # several times that of any optical plastic: PMMA, PC and PS shrink by 0.002 to 0.008


class BaseSection(Section):
    """The clamping base: the paper's one-inch cylinder, a square, a STEP ``file`` of one's own, or none.

    ``height_mm``: total height. ``relief_step_mm``: depth of the base's top below the rim, so that a cutter reaches the
    rim; with ``relief_setback_mm`` the step's wall is a circle at least that far inside the rim, with 0 the wall
    follows the rim straight down. ``bore_setback_mm``: the bore below the cavity is a circle at least that far outside
    the cavity's rim, with 0 it follows the rim straight down. Left out, these three are what the cutter needs at a face
    that is designed for it (:meth:`Spec.is_cut`), and 0 elsewhere. ``flat_mm``: distance of a clocking flat, across +x,
    from the axis. ``pocket_*``: a wider bore from below for the LED. ``flange_*``: a wider ring at the bottom. A STEP
    file has all of these itself: one solid in the lens's coordinates, its top in z = 0.
    """

    kind: Literal["cylinder", "square", "step", "none"] = "cylinder"
    file: FilePath | None = None
    diameter_mm: Millimetres = 25.4
    side_mm: Millimetres = 25.4
    height_mm: Millimetres = 2.0
    relief_step_mm: MillimetresOrZero | None = None
    relief_setback_mm: MillimetresOrZero | None = None
    bore_setback_mm: MillimetresOrZero | None = None
    flat_mm: Millimetres | None = None
    pocket_diameter_mm: Millimetres | None = None
    pocket_depth_mm: Millimetres = 1.0
    flange_diameter_mm: Millimetres | None = None
    flange_height_mm: Millimetres = 0.5

    @model_validator(mode="after")
    def _file_is_the_whole_base(self) -> "BaseSection":
        if (self.kind == "step") != (self.file is not None):
            raise ValueError('kind = "step" and file go together: give both, or neither')
        room = ("relief_step_mm", "relief_setback_mm", "bore_setback_mm")
        shapes = (*room, "flat_mm", "pocket_diameter_mm", "flange_diameter_mm")
        given = [name for name in shapes if getattr(self, name)] + self._given("diameter_mm", "side_mm", "height_mm")
        if self.kind == "step" and given:
            stated = f"{given[0]} = {getattr(self, given[0]):g}"
            raise ValueError(f"{stated} does not go with kind = 'step': the file holds the whole base; leave it out")
        return self

    @model_validator(mode="after")
    def _no_length_goes_with_nothing(self) -> "BaseSection":
        """A length that is not the default has something to be the length of; a stored spec states defaults too."""
        for width, length in (("pocket_diameter_mm", "pocket_depth_mm"), ("flange_diameter_mm", "flange_height_mm")):
            if getattr(self, width) is None and self._given(length):
                raise ValueError(f"{length} = {getattr(self, length):g} goes with {width}; give both, or neither")
        for kind, other, width in (("cylinder", "square", "side_mm"), ("square", "cylinder", "diameter_mm")):
            if self.kind == kind and self._given(width):
                stated = f"{width} = {getattr(self, width):g}"
                raise ValueError(f'{stated} goes with kind = "{other}", not "{kind}"; leave it out')
        return self

    def _given(self, *names: str) -> list[str]:
        """Names of the fields that are not as when left out."""
        return [name for name in names if getattr(self, name) != type(self).model_fields[name].default]

    @model_validator(mode="after")
    def _heights_fit(self) -> "BaseSection":
        flange = 0.0 if self.flange_diameter_mm is None else self.flange_height_mm
        pocket = 0.0 if self.pocket_diameter_mm is None else self.pocket_depth_mm
        if self.kind in ("none", "step"):
            return self
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
        return self

    @property
    def step_mm(self) -> float:
        """``relief_step_mm``, 0 where it is left out."""
        return self.relief_step_mm or 0.0

    @property
    def seat_mm(self) -> float:
        """Depth of the bottom, on which the part sits, below z = 0; 0 without a base, and of a file: it is not read."""
        return self.height_mm if self.kind in ("cylinder", "square") else 0.0

    @property
    def widest_mm(self) -> float:
        """Diameter of the smallest cylinder about the axis that holds the base without its flange."""
        return self.side_mm * 2.0**0.5 if self.kind == "square" else self.diameter_mm


class Tool(Section):
    """A ball-end mill: ball, a cylindrical shank of ``length_mm`` from the ball's centre, then the holder's cone."""

    name: Annotated[Label, Field(min_length=1)]
    radius_mm: Millimetres
    shank_radius_mm: Millimetres
    length_mm: Millimetres
    holder_half_angle_deg: Annotated[float, Field(ge=0.0, lt=90.0)] = 45.0


class ManufactureSection(Section):
    """Equipment of the shop: the paper's ball cutter by default, and any further ``tools`` with shank and holder.

    ``make``: the lens itself, or the mould inserts that are cut to its shape. ``shrinkage``: of the moulded lens; the
    insert's faces are the lens's times 1 + shrinkage. ``form_tolerance_um``: full width of the zone, half of it on
    each side of the face along its normal, in which every point of an optical face must lie. ``max_tilt_deg``: largest
    angle between a tool's axis and the lens axis. ``stepover_mm``: between passes. ``slope_limit_mrad``: of the cusps
    they leave. ``required``: a part that cannot be cut counts as a failure of the run. ``author``, ``organisation``,
    ``date``: of the files for the shop, which never take a date from the clock.
    """

    cutter_radius_mm: Millimetres = 1.0
    tools: Annotated[tuple[Tool, ...], Field(max_length=100)] = ()
    make: Literal["part", "insert"] = "part"
    shrinkage: Annotated[float, Field(ge=0.0, le=_MOST_SHRINKAGE)] = 0.0
    form_tolerance_um: Annotated[float, Field(ge=1e-3, le=1e4)] | None = None
    required: bool = False
    max_tilt_deg: Annotated[float, Field(ge=0.0, le=120.0)] = 90.0
    stepover_mm: Millimetres = 0.02
    slope_limit_mrad: Annotated[float, Field(gt=0.0, le=500.0)] = 1.0
    author: Label = ""
    organisation: Label = ""
    date: CalendarDate | None = None

    @model_validator(mode="after")
    def _only_a_mould_shrinks(self) -> "ManufactureSection":
        if self.shrinkage > 0.0 and self.make != "insert":
            raise ValueError(f'shrinkage = {self.shrinkage:g} goes with make = "insert"; a lens that is cut has none')
        return self

    @property
    def scale(self) -> float:
        """Factor from the faces of the lens to those that are cut: 1 + shrinkage for an insert, 1 for the lens."""
        return 1.0 + self.shrinkage
