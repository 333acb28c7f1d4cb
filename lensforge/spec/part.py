"""The part: the starting lens, what bounds it, its base, and the shop that makes it."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lensforge.spec.section import Millimetres, Section

Symmetry = Literal["none", "mirror_x", "mirror_y", "rectangle", "square"]


class LensSection(Section):
    """The starting lens: two hemispheres of the given radii, and the SRBFs that will shape both.

    ``absorption_per_mm`` (Beer-Lambert) counts in the stray-light pass of ``verify``; the design leaves it out.
    """

    refractive_index: Annotated[float, Field(ge=1.0, le=4.0)] = 1.4936
    material: str = "PMMA at 564 nm"
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    levels: tuple[Annotated[int, Field(ge=1, le=100_000)], ...] = (9, 25, 81, 289)
    sigma_c: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.75
    inner_offset_mm: Millimetres
    outer_offset_mm: Millimetres
    symmetry: Symmetry = "none"

    @model_validator(mode="after")
    def _outer_outside_inner(self) -> "LensSection":
        if self.outer_offset_mm <= self.inner_offset_mm:
            raise ValueError(f"outer_offset_mm = {self.outer_offset_mm} must exceed inner_offset_mm")
        if not self.levels:
            raise ValueError("levels is empty: give at least one count")
        return self


class ConstraintsSection(Section):
    """Feasible lenses, Eqs. (10) to (14): a paraboloid of height r_a and radius r_b stays inside the cavity."""

    cavity_height_mm: Millimetres
    cavity_radius_mm: Millimetres
    min_thickness_mm: Annotated[float, Field(ge=0.0)]
    max_radius_mm: Millimetres


class BaseSection(Section):
    """The clamping base below z = 0: the paper's one-inch cylinder, a square, or none; ``height_mm`` is all of it.

    ``relief_step_mm``: how far the base's top lies below the rim, so that a cutter reaches the rim. ``flat_mm``:
    distance of a clocking flat, across +x, from the axis. ``pocket_*``: a wider bore from below for the LED.
    ``flange_*``: a wider ring at the bottom.
    """

    kind: Literal["cylinder", "square", "none"] = "cylinder"
    diameter_mm: Millimetres = 25.4
    side_mm: Millimetres = 25.4
    height_mm: Millimetres = 2.0
    relief_step_mm: Annotated[float, Field(ge=0.0)] = 0.0
    flat_mm: Millimetres | None = None
    pocket_diameter_mm: Millimetres | None = None
    pocket_depth_mm: Millimetres = 1.0
    flange_diameter_mm: Millimetres | None = None
    flange_height_mm: Millimetres = 0.5

    @model_validator(mode="after")
    def _heights_fit(self) -> "BaseSection":
        flange = 0.0 if self.flange_diameter_mm is None else self.flange_height_mm
        pocket = 0.0 if self.pocket_diameter_mm is None else self.pocket_depth_mm
        if self.kind == "none":
            return self
        if self.relief_step_mm + flange >= self.height_mm:
            raise ValueError(f"relief_step_mm and flange_height_mm must leave some of height_mm = {self.height_mm:g}")
        if pocket >= self.height_mm:
            raise ValueError(f"pocket_depth_mm = {pocket:g} must be below height_mm = {self.height_mm:g}")
        if self.flat_mm is not None and not (self.kind == "cylinder" and self.flat_mm < self.diameter_mm / 2.0):
            raise ValueError(f"flat_mm = {self.flat_mm:g}: a flat is cut from a cylinder, below diameter_mm / 2")
        if self.flange_diameter_mm is not None and self.flange_diameter_mm <= self.widest_mm:
            raise ValueError(f"flange_diameter_mm must exceed the width of the base, {self.widest_mm:g}")
        return self

    @property
    def widest_mm(self) -> float:
        """Diameter of the smallest cylinder about the axis that holds the base, its flange apart."""
        return self.side_mm * 2.0**0.5 if self.kind == "square" else self.diameter_mm


class Tool(Section):
    """A ball mill: ball, a cylindrical shank of ``length_mm`` from the ball's centre, then the holder's cone."""

    name: Annotated[str, Field(min_length=1)]
    radius_mm: Millimetres
    shank_radius_mm: Millimetres
    length_mm: Millimetres
    holder_half_angle_deg: Annotated[float, Field(ge=0.0, lt=90.0)] = 45.0


class ManufactureSection(Section):
    """What the shop has: the ball cutter of the paper by default, and any ``tools`` besides, shank and holder too.

    ``make``: the lens itself, or the mould inserts that are cut to its shape. ``max_tilt_deg``: how far a tool's axis
    may lean from the lens axis. ``stepover_mm`` and ``slope_limit_mrad``: passes, and the slope of their cusps.
    """

    cutter_radius_mm: Millimetres = 1.0
    tools: tuple[Tool, ...] = ()
    make: Literal["part", "insert"] = "part"
    max_tilt_deg: Annotated[float, Field(ge=0.0, le=120.0)] = 90.0
    stepover_mm: Millimetres = 0.02
    slope_limit_mrad: Annotated[float, Field(gt=0.0, le=500.0)] = 1.0
