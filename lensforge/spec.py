"""The specification of a design, read from TOML: validated once, immutable, every length in mm.

A field that is wrong is reported in one line: its name, its value, what is allowed.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveInt, ValidationError, model_validator

from lensforge.errors import InputError
from lensforge.section import Section
from lensforge.source_spec import Source

Symmetry = Literal["none", "mirror_x", "mirror_y", "rectangle", "square"]
Accuracy = Literal["draft", "standard", "reference"]
# From a nanometre to a kilometre, with room: squares and ratios of lengths stay within floating point.
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9)]


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


class _Target(Section):
    distance_mm: Millimetres
    receiver_mm: Millimetres
    uniform_mm: Millimetres | None = None

    @model_validator(mode="after")
    def _mask_inside(self) -> "_Target":
        if self.uniform_mm is not None and self.uniform_mm > self.receiver_mm:
            raise ValueError(f"uniform_mm = {self.uniform_mm} must not exceed receiver_mm = {self.receiver_mm}")
        return self


class FlatTopTarget(_Target):
    """A square super-Gaussian, ``exp(-|x/a|^p - |y/a|^p)``."""

    kind: Literal["flat_top"]
    half_width_mm: Millimetres
    exponent: Annotated[float, Field(ge=2.0, le=200.0)] = 18.0


class _SoftTarget(_Target):
    edge_mm: Annotated[float, Field(ge=0.0)] = 0.0

    @model_validator(mode="after")
    def _edge_fits(self) -> "_SoftTarget":
        if self.edge_mm > self.receiver_mm:
            raise ValueError(f"edge_mm = {self.edge_mm} must not exceed receiver_mm = {self.receiver_mm}")
        return self


class CrossTarget(_SoftTarget):
    """An upright cross of equal arms, ``length_mm`` from end to end, edges softened by a Gaussian of ``edge_mm``."""

    kind: Literal["cross"]
    length_mm: Millimetres
    stroke_mm: Millimetres


class TextTarget(_SoftTarget):
    """Glyphs, ``width_mm`` wide, uniform on a dark ground, edges softened by a Gaussian of ``edge_mm``."""

    kind: Literal["text"]
    text: Annotated[str, Field(min_length=1, max_length=40)]
    width_mm: Millimetres


class ImageTarget(_SoftTarget):
    """An image file, ``width_mm`` wide, its luminance taken as irradiance."""

    kind: Literal["image"]
    file: Path
    width_mm: Millimetres


class OptimiseSection(Section):
    """How the design is searched for; what is left out comes from the accuracy preset."""

    steps_per_level: tuple[PositiveInt, ...] | None = None
    rays: Annotated[int, Field(ge=64, le=2**24)] | None = None
    pixels: Annotated[int, Field(ge=4, le=1024)] = 64
    learning_rate: Annotated[float, Field(gt=0.0, le=1.0)] = 0.004
    uniformity_steps: Annotated[int, Field(ge=0)] = 0


class EvaluateSection(Section):
    """How the finished lens is judged. ``window_mm``: side of the square in which flux counts as detected."""

    rays: Annotated[int, Field(ge=1, le=2**28)] | None = None
    pixels: Annotated[int, Field(ge=1, le=2048)] = 128
    window_mm: Millimetres | None = None
    filter_variance: Annotated[float, Field(ge=0.0)] = 1.0


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


Target = Annotated[FlatTopTarget | CrossTarget | TextTarget | ImageTarget, Field(discriminator="kind")]


class Spec(Section):
    """One design: what goes in, what is wanted, what is allowed."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    source: Source
    lens: LensSection
    constraints: ConstraintsSection
    target: Target
    optimise: OptimiseSection = OptimiseSection()
    evaluate: EvaluateSection = EvaluateSection()
    base: BaseSection = BaseSection()
    manufacture: ManufactureSection = ManufactureSection()

    @model_validator(mode="after")
    def _stages_match_levels(self) -> "Spec":
        steps = self.optimise.steps_per_level
        if steps is not None and len(steps) != len(self.lens.levels):
            raise ValueError(f"optimise.steps_per_level has {len(steps)} numbers, lens.levels {len(self.lens.levels)}")
        if self.target.distance_mm <= self.constraints.max_radius_mm:
            raise ValueError(
                f"target.distance_mm = {self.target.distance_mm} is inside the lens: "
                f"it must exceed constraints.max_radius_mm = {self.constraints.max_radius_mm}"
            )
        return self


def load_spec(path: Path) -> Spec:
    """Read ``path``; file names inside it are taken relative to its folder. Raises :class:`InputError`."""
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; the shipped specs are in examples/") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: not readable as TOML ({error})") from None
    content.setdefault("name", path.stem)
    for section in ("source", "target"):
        _resolve_files(content.get(section), path.parent)
    return parse_spec(content, str(path))


def _resolve_files(table: Any, folder: Path) -> None:
    """Make every ``file`` in ``table``, however deep, relative to ``folder``."""
    if isinstance(table, list):
        for entry in table:
            _resolve_files(entry, folder)
    elif isinstance(table, dict):
        for key, value in table.items():
            if key == "file" and isinstance(value, str):
                table[key] = str((folder / value).resolve())
            else:
                _resolve_files(value, folder)


def parse_spec(content: dict[str, Any], origin: str) -> Spec:
    """Validate ``content``; ``origin`` names it in the error, which is one line for the first wrong field."""
    try:
        return Spec.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = _field(first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        value = "" if isinstance(first["input"], dict) else f" = {first['input']!r}"
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise InputError(f"{origin}: {field}{value}: {message}{more}".replace(": : ", ": ")) from None


def _field(location: tuple[int | str, ...]) -> str:
    """The path to a field as the user wrote it: without the ``kind`` that chose the form of a section."""
    unions = ("source", "target", "intensity")
    return ".".join(
        str(part) for before, part in zip((None, *location), location, strict=False) if before not in unions
    )
