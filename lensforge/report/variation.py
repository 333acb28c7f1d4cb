"""Variations of a sweep: values of a field of the spec, numbers or words, or LEDs; and the spec of every design."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import ClassVar, Literal

from lensforge.errors import InputError, refused, remedy
from lensforge.spec import Spec
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.part_section import ManufactureSection
from lensforge.spec.processes import PROCESSES
from lensforge.spec.source_list import read_sources, require_told_apart
from lensforge.spec.source_sections import NamedSource
from lensforge.spec.spec_files import joined_name
from lensforge.spec.spec_section import Section

MOST_VALUES = 100
_WORD = r"(?!(nan|inf)$)[A-Za-z][A-Za-z_]{0,30}"  # of a choice, and of a folder


@dataclass(frozen=True)
class Variant:
    """One design of a study: the varied field's value or the name of its LED, the changes, the spec that results."""

    value: float | str
    changes: dict[str, float]
    spec: Spec

    @property
    def folder(self) -> str:
        """Name of its folder, as it is where letter case does not count."""
        return self.spec.name.casefold()

    @property
    def text(self) -> str:
        """The value, as a text."""
        return self.value if isinstance(self.value, str) else f"{self.value:g}"


@dataclass(frozen=True)
class Variation:
    """``field`` (dotted path) takes each of ``values``, in order; those of ``scaled`` keep their ratio to it.

    The values are numbers, smallest first, or words of a choice.
    """

    field: str
    values: tuple[float | str, ...]
    scaled: tuple[str, ...] = ()

    @property
    def is_numeric(self) -> bool:
        """True for numbers, which have an order of their own."""
        return not any(isinstance(value, str) for value in self.values)

    def variants(self, base: Spec) -> list[Variant]:
        """The designs, in the order of the values.

        Raises :class:`InputError` for values that a spec cannot have, and for two whose designs would share a folder.
        """
        return _with_own_folders(self.field, [self._variant(base, value) for value in self.values])

    def _variant(self, base: Spec, value: float | str) -> Variant:
        for field in (self.field, *self.scaled):
            _value(base, field)
        if isinstance(value, str):
            return Variant(value, {}, base.replace({self.field: value}, name=joined_name(base.name, value)))
        changes = {self.field: value}
        if self.scaled:
            before = _number(base, self.field)
            changes |= {field: _number(base, field) * value / before for field in self.scaled}
        name = joined_name(base.name, f"{value:g}".replace("+", ""))  # of a folder, too
        return Variant(value, changes, base.replace(changes, name=name))


ToolAxis = Literal["tool", "process"]
_OF_RADIUS = (0.25, 0.5, 1.0, 2.0)  # of the tool that a spec states


def tool_study(spec: Spec, over: ToolAxis) -> tuple[Spec, Variation]:
    """A study of ``spec`` over radii of its tool, the ball where it has one; or over all processes.

    With the spec that is varied, which has no field of one process alone. Raises :class:`InputError` for the tool of a
    lens that none cuts.
    """
    if over == "process":
        defaults = ManufactureSection().model_dump()
        fields = {name: defaults[name] for process in PROCESSES.values() for name in process.fields}
        drawn = spec.lens.drawn_mm is not None
        processes = tuple(name for name, process in PROCESSES.items() if drawn or not process.is_drawn)
        return spec.replace(manufacture=fields), Variation("manufacture.process", processes)
    cuts = {spec.cutting(name) for name in spec.lens.names} - {None}
    if not cuts:
        process = spec.manufacture.process
        raise InputError(f'manufacture.process = "{process}": no tool cuts the lens; give another, or --over process')
    field = "cutter_radius_mm" if "milled" in cuts else "nose_radius_mm"
    radius_mm = getattr(spec.manufacture, field)
    return spec, Variation(f"manufacture.{field}", tuple(share * radius_mm for share in _OF_RADIUS))


ONE_FOR_ALL = "one_for_all"  # the design of a spec for all of its LEDs, beside one for each


@dataclass(frozen=True)
class SourceVariation:
    """A design for each of ``sources``; where the spec is for these, another one for all of them together."""

    sources: tuple[NamedSource, ...]
    field: ClassVar[str] = "source"
    is_numeric: ClassVar[bool] = False
    scaled: ClassVar[tuple[str, ...]] = ()

    def variants(self, base: Spec) -> list[Variant]:
        """The designs, in the order of the sources.

        Raises :class:`InputError` for a source the spec cannot have, and for one with the name of the design for all.
        """
        if base.states:
            raise InputError(f"{base.name}: has states with their LEDs; vary a field of one, such as states.0.weight")
        designs = []
        for led in self.sources:
            if led.name.casefold() == ONE_FOR_ALL:
                raise InputError(f"sources: {led.name} is the name of the design for all of them; rename the LED")
            with remedy(f"the LED is {led.name}"):
                changed = base.replace(source=led.source, sources=(), name=joined_name(base.name, led.name))
            designs.append(Variant(led.name, {}, changed))
        if {led.name for led in base.sources} == {led.name for led in self.sources}:
            designs.append(Variant(ONE_FOR_ALL, {}, base.replace(name=joined_name(base.name, ONE_FOR_ALL))))
        return _with_own_folders(self.field, designs)


def _with_own_folders(field: str, designs: list[Variant]) -> list[Variant]:
    known: dict[str, Variant] = {}
    for design in designs:
        before = known.setdefault(design.folder, design)
        if before is not design:
            raise InputError(
                f"{field} = {before.value} and {design.value}: both designs would go to the folder {design.spec.name}; "
                "give values that differ in six digits, or other names"
            )
    return designs


AnyVariation = Variation | SourceVariation


def sources_of(given: Sequence[NamedSource | EmitterSection | Path | str], base: Spec) -> SourceVariation:
    """The LEDs ``given`` as sources, with or without names, or as files.

    Raises :class:`InputError` for anything else, for a single one, and for two of one name.
    """
    if isinstance(given, str | Path) or not isinstance(given, Sequence):
        raise InputError(f"source = {str(given)[:60]!r}: a list of sources, named or not, and of files")
    sources: list[NamedSource] = []
    for number, led in enumerate(given, start=1):
        if isinstance(led, Path | str):
            sources.extend(read_sources([led], base.source))
        elif isinstance(led, NamedSource):
            sources.append(led)
        else:
            sources.append(NamedSource(name=f"source_{number}", source=led))
    return SourceVariation(require_told_apart(sources))


def variation_of(field: object, values: Sequence[float | str], scaled: Sequence[str] = ()) -> Variation:
    """``field`` at each of ``values``, numbers sorted, each kept once.

    Raises :class:`InputError` for an invalid variation.
    """
    if not isinstance(field, str) or isinstance(scaled, str) or not all(isinstance(name, str) for name in scaled):
        raise InputError(
            f"sweep: field = {field!r}, scale = {scaled!r}: a field's dotted name, and a list of such names"
        )
    if not isinstance(values, str) and isinstance(values, Sequence) and _are_words(values):
        return _of_words(field, tuple(dict.fromkeys(map(str, values))), scaled)
    with refused(f"{field} = {str(values)[:60]}", f"give 2 to {MOST_VALUES} numbers", TypeError, ValueError):
        kept = tuple(sorted({float(value) for value in values}))
    if not (2 <= len(kept) <= MOST_VALUES and all(map(isfinite, kept))):
        raise InputError(f"{field}: {len(kept)} values; give 2 to {MOST_VALUES} finite numbers")
    if field in scaled:
        raise InputError(f"{field}: this is the field that varies; name others to be scaled")
    return Variation(field, kept, tuple(scaled))


def _are_words(values: Sequence[float | str]) -> bool:
    return len(values) > 0 and all(isinstance(value, str) and re.fullmatch(_WORD, value) for value in values)


def _of_words(field: str, choices: tuple[str, ...], scaled: Sequence[str]) -> Variation:
    if not 2 <= len(choices) <= MOST_VALUES:
        raise InputError(f"{field}: {len(choices)} words; give 2 to {MOST_VALUES} different ones, such as none,milled")
    if scaled:
        raise InputError(f"{scaled[0]}: cannot keep its ratio to {field}, whose values are words; leave it out")
    return Variation(field, choices)


def parse_variation(text: str, scaled: Sequence[str] = ()) -> Variation:
    """Parse ``section.field=v1,v2,...``. Raises :class:`InputError` for anything else."""
    field, _, listed = text.partition("=")
    parts = [part.strip() for part in listed.split(",")]
    if _are_words(parts):
        return variation_of(field, parts, scaled)
    with refused(f"--vary {text}", "give section.field=value,value,... with numbers or words as values", ValueError):
        values = [float(part) for part in parts]
    return variation_of(field, values, scaled)


def _value(spec: Spec, field: str) -> object:
    value: object = spec
    for part in field.split("."):
        if isinstance(value, tuple) and part in map(str, range(len(value))):
            value = value[int(part)]
            continue
        known = type(value).model_fields if isinstance(value, Section) else {}
        if part not in known:
            there = ", ".join(sorted(known)) or "none within it"
            raise InputError(f"{field}: no such field in this spec; there are: {there}")
        value = getattr(value, part)
    return value


def _number(spec: Spec, field: str) -> float:
    value = _value(spec, field)
    if isinstance(value, bool) or not isinstance(value, int | float) or value == 0.0:
        raise InputError(f"{field} = {value!r} in the spec: only a number other than 0 can be scaled")
    return float(value)
