"""Variants of a spec: one field set to each of several values, others scaled in proportion to it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from lensforge.errors import InputError
from lensforge.spec import Spec
from lensforge.spec.section import Section

MOST_VALUES = 100


@dataclass(frozen=True)
class Variant:
    """One design of a sweep: the varied field's value, every field that was changed, the spec that results."""

    value: float
    changes: dict[str, float]
    spec: Spec


@dataclass(frozen=True)
class Variation:
    """``field`` takes each of ``values``, in order; every field of ``scaled`` keeps its ratio to it.

    Fields are dotted paths in the spec, such as ``constraints.max_radius_mm``.
    """

    field: str
    values: tuple[float, ...]
    scaled: tuple[str, ...] = ()

    def variants(self, base: Spec) -> list[Variant]:
        """The designs, smallest value first. Raises :class:`InputError` for values that a spec cannot have."""
        return [self._variant(base, value) for value in self.values]

    def _variant(self, base: Spec, value: float) -> Variant:
        for field in (self.field, *self.scaled):
            _value(base, field)
        changes = {self.field: value}
        if self.scaled:
            before = _number(base, self.field)
            changes |= {field: _number(base, field) * value / before for field in self.scaled}
        return Variant(value, changes, base.replace(changes, name=variant_name(base.name, value)))


def variation_of(field: str, values: Sequence[float], scaled: Sequence[str] = ()) -> Variation:
    """``field`` at each of ``values``, sorted, each kept once. Raises :class:`InputError` for an invalid variation."""
    if not isinstance(field, str) or isinstance(scaled, str) or not all(isinstance(name, str) for name in scaled):
        raise InputError(
            f"sweep: field = {field!r}, scale = {scaled!r}: a field's dotted name, and a list of such names"
        )
    try:
        kept = tuple(sorted({float(value) for value in values}))
    except (TypeError, ValueError):
        raise InputError(f"{field} = {str(values)[:60]}: give 2 to {MOST_VALUES} numbers") from None
    if not (2 <= len(kept) <= MOST_VALUES and all(map(isfinite, kept))):
        raise InputError(f"{field}: {len(kept)} values; give 2 to {MOST_VALUES} finite numbers")
    if field in scaled:
        raise InputError(f"{field}: this is the field that varies; name others to be scaled")
    return Variation(field, kept, tuple(scaled))


def parse_variation(text: str, scaled: Sequence[str] = ()) -> Variation:
    """Parse ``section.field=v1,v2,...``. Raises :class:`InputError` for anything else."""
    field, _, listed = text.partition("=")
    try:
        values = [float(part) for part in listed.split(",")]
    except ValueError:
        raise InputError(f"--vary {text}: give section.field=value,value,... with numbers as values") from None
    return variation_of(field, values, scaled)


def variant_name(name: str, value: float) -> str:
    """Name of a design and of its folder: the spec's name and the value, in characters that a spec's name may have."""
    shown = f"{value:g}".replace(".", "_").replace("+", "")
    return f"{name[: 63 - len(shown)]}-{shown}"


def _value(spec: Spec, field: str) -> object:
    """Value of ``field`` in ``spec``. Raises :class:`InputError` where there is no such field."""
    found: object = spec
    for part in field.split("."):
        known = type(found).model_fields if isinstance(found, Section) else {}
        if part not in known:
            there = ", ".join(sorted(known)) or "none within it"
            raise InputError(f"{field}: no such field in this spec; there are: {there}")
        found = getattr(found, part)
    return found


def _number(spec: Spec, field: str) -> float:
    value = _value(spec, field)
    if isinstance(value, bool) or not isinstance(value, int | float) or value == 0.0:
        raise InputError(f"{field} = {value!r} in the spec: only a number other than 0 can be scaled")
    return float(value)
