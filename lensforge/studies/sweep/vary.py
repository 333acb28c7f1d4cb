"""Which designs a sweep makes: a spec with one field set to each value, and others scaled in proportion to it."""

from dataclasses import dataclass
from typing import Any

from lensforge.errors import InputError
from lensforge.spec import Spec, parse_spec

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

    Fields are dotted paths as in the spec, ``constraints.max_radius_mm``.
    """

    field: str
    values: tuple[float, ...]
    scaled: tuple[str, ...] = ()

    def variants(self, base: Spec) -> list[Variant]:
        """The designs, smallest value first. Raises :class:`InputError` for what a spec cannot have."""
        return [self._variant(base, value) for value in self.values]

    def _variant(self, base: Spec, value: float) -> Variant:
        content = base.model_dump(mode="json")
        origin = f"{base.name} with {self.field} = {value:g}"
        changes = {self.field: value}
        if self.scaled:
            before = _number(content, self.field)
            changes |= {field: _number(content, field) * value / before for field in self.scaled}
        for field, changed in changes.items():
            table, key = _table(content, field)
            table[key] = changed
        content["name"] = variant_name(base.name, value)
        return Variant(value, changes, parse_spec(content, origin))


def parse_variation(text: str, scaled: tuple[str, ...] = ()) -> Variation:
    """``section.field=v1,v2,...`` as the command line takes it; values are sorted, each kept once."""
    field, _, listed = text.partition("=")
    try:
        values = tuple(sorted({float(part) for part in listed.split(",")}))
    except ValueError:
        raise InputError(f"--vary {text}: give section.field=value,value,... with numbers as values") from None
    if not (2 <= len(values) <= MOST_VALUES and all(abs(value) < float("inf") for value in values)):
        raise InputError(f"--vary {text}: {len(values)} values; give 2 to {MOST_VALUES} finite numbers")
    if field in scaled:
        raise InputError(f"--scale {field}: this is the field that varies; name others")
    return Variation(field, values, scaled)


def variant_name(name: str, value: float) -> str:
    """Of the design and of its folder: the spec's name and the value, in characters that a spec's name may have."""
    shown = f"{value:g}".replace(".", "_").replace("+", "")
    return f"{name[: 63 - len(shown)]}-{shown}"


def _table(content: dict[str, Any], field: str) -> tuple[dict[str, Any], str]:
    """The table that holds ``field``, and its key there."""
    *sections, key = field.split(".")
    table: Any = content
    for section in sections:
        table = table.get(section) if isinstance(table, dict) else None
    if not isinstance(table, dict) or key not in table:
        known = ", ".join(sorted(table if isinstance(table, dict) else content))
        raise InputError(f"{field}: no such field in this spec; there are: {known}")
    return table, key


def _number(content: dict[str, Any], field: str) -> float:
    table, key = _table(content, field)
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or value == 0.0:
        raise InputError(f"{field} = {value!r} in the spec: only a number other than 0 can be scaled")
    return float(value)
