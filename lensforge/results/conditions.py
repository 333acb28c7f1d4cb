"""Conditions of a simulation that differ from the lens's own, as a label and as part of a file's name."""

import re
from collections.abc import Callable, Iterator
from typing import Annotated, Any

from pydantic import Field

from lensforge.errors import InputError
from lensforge.public import public
from lensforge.results.record import Count, Number, Positive, Record, Sha256, Text

_ALLOWED = r"^\w[\w.-]{0,119}$"  # part of a file's name, on every system
_LONGEST_SOURCE = 80  # characters of a source in a name: the rest of the name must fit, too

Name = Annotated[str, Field(strict=True, pattern=_ALLOWED)]


@public
class Conditions(Record):
    """Conditions that differ from the nominal; None for each that does not.

    ``name``: ends the name of the record's files. ``source``: title of the other source. ``source_sha256``: hash of its
    fields and files. ``warnings``: on that source, or on the temperature. ``accuracy``: preset. ``rays``: number of
    rays. ``pixels``: across the receiver. ``seed``: of the rays. ``lumens``: flux of the source. ``temperature_c``: of
    the lens and the air around it. ``tolerances``: name of a preset or of a file. ``tolerances_sha256``: hash of their
    fields. ``process``: by which the part is made.
    """

    name: Name
    source: Text | None = None
    source_sha256: Sha256 | None = None
    warnings: tuple[Text, ...] = ()
    accuracy: Text | None = None
    rays: Count | None = None
    pixels: Count | None = None
    seed: Count | None = None
    lumens: Positive | None = None
    temperature_c: Number | None = None
    tolerances: Text | None = None
    tolerances_sha256: Sha256 | None = None
    process: Text | None = None

    @classmethod
    def of(cls, source_name: str = "", **differing: Any) -> "Conditions | None":
        """Conditions that differ from the lens's own, None if none does; ``source_name``: used in the name."""
        given = {key: value for key, value in differing.items() if value is not None}
        if not given:
            return None
        unnamed = cls(name="other", **given)
        source = [_in_a_name(source_name)] if unnamed.source is not None else []
        return unnamed.renamed("_".join([*source, *(text for _, text in unnamed._short())]))

    def renamed(self, name: str) -> "Conditions":
        """The conditions under another name. Raises :class:`InputError` if it cannot be part of a file's name."""
        if not re.fullmatch(_ALLOWED, name):
            raise InputError(
                f"name = {name!r}: must be letters, digits, '_', '-' and '.', at most 120, and begin with none of '-.'"
            )
        return self.changed(name=name)

    def same_as(self, other: "Conditions") -> bool:
        """True if ``other`` are the same conditions, whatever their name and warnings."""
        plain = {"name": "other", "warnings": ()}
        return self.changed(**plain) == other.changed(**plain)

    def __str__(self) -> str:
        labels = [] if self.source is None else [self.source]
        return ", ".join([*labels, *(text for text, _ in self._short())])

    def _short(self) -> Iterator[tuple[str, str]]:
        """Label of each condition but the source, and its part of a name."""
        for field, (label, short) in _IN_SHORT.items():
            if (value := getattr(self, field)) is not None:
                yield label.format(value), short(value)


def _in_a_name(source: str) -> str:
    """``source`` without the characters that a file's name must not have."""
    return re.sub(r"[^\w.-]+", "-", source).strip("-.")[:_LONGEST_SOURCE].rstrip("-._") or "source"


# Conditions but the source: in words, and as part of a file's name.
_IN_SHORT: dict[str, tuple[str, Callable[[Any], str]]] = {
    "accuracy": ("accuracy {}", str),
    "rays": ("{} rays", "{}rays".format),
    "pixels": ("{0} x {0} pixels", "{}px".format),
    "seed": ("seed {}", "seed{}".format),
    "lumens": ("{:g} lm", lambda lumens: f"{lumens:g}lm".replace("+", "")),
    "temperature_c": ("{:g} °C", lambda celsius: f"{celsius:g}C".replace("-", "minus")),
    "tolerances": ("tolerances {}", _in_a_name),
    "process": ("{}", str),
}
