"""The specification of a design, read from TOML: validated once, immutable, every length in mm.

A field that is wrong is reported in one line: its name, its value, what is allowed.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from lensforge.errors import InputError
from lensforge.spec.base import BaseSection
from lensforge.spec.part import ConstraintsSection, LensSection, ManufactureSection
from lensforge.spec.search import EvaluateSection, OptimiseSection
from lensforge.spec.section import Section
from lensforge.spec.source import Source
from lensforge.spec.target import Target


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

    @model_validator(mode="after")
    def _fixed_surfaces_fit(self) -> "Spec":
        limits, fixed_inner, fixed_outer = self.constraints, self.lens.fixed_inner, self.lens.fixed_outer
        if fixed_inner is not None:
            inside = fixed_inner.room_mm(limits.cavity_height_mm, limits.cavity_radius_mm)
            if inside < 0.0:
                raise ValueError(
                    f"lens.fixed_inner cuts {-inside:.3g} mm into the paraboloid of constraints.cavity_height_mm = "
                    f"{limits.cavity_height_mm:g} and cavity_radius_mm = {limits.cavity_radius_mm:g}"
                )
        if fixed_outer is not None and fixed_outer.largest_mm > limits.max_radius_mm:
            raise ValueError(
                f"lens.fixed_outer reaches {fixed_outer.largest_mm:.6g} mm from the origin, "
                f"constraints.max_radius_mm = {limits.max_radius_mm:g}"
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
    for section in ("source", "target", "base"):
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
    unions = ("source", "target", "intensity", "spectrum", "fixed_inner", "fixed_outer")
    return ".".join(
        str(part) for before, part in zip((None, *location), location, strict=False) if before not in unions
    )
