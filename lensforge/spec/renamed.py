"""Old names of spec fields, read for one version: each with the name that took its place, and what it implied.

A spec with an old name is read, and a :class:`~lensforge.errors.RenamedWarning` says the new one, or that none
took its place.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lensforge.errors import RenamedWarning


@dataclass(frozen=True)
class NewName:
    """Name of a field now, "" where it has gone, and the fields that its old name implied."""

    name: str
    implied: Mapping[str, str] = field(default_factory=dict)


# By the class of the section, then by the old name.
RENAMED: dict[str, dict[str, NewName]] = {
    "LimitSection": {
        f"{bound}_{unit}": NewName(bound, {"unit": unit})
        for bound in ("at_least", "at_most")
        for unit in ("w_per_m2", "lx", "w_per_sr", "cd", "relative")
    },
    "ManufactureSection": {"stepover_mm": NewName(""), "slope_limit_mrad": NewName("")},
}


def with_new_names(section: str, content: Any) -> Any:
    """The table ``content`` of a section by the names of its fields now; anything else as it is.

    Raises ``ValueError`` where an old name and a field beside it say two things.
    """
    old_names = RENAMED[section]
    if not isinstance(content, Mapping) or not any(name in old_names for name in content):
        return content
    table = {name: value for name, value in content.items() if name not in old_names}
    for old, value in content.items():
        if old not in old_names or value is None:
            continue
        new = old_names[old]
        if not new.name:
            warnings.warn(f"{old} is read no more, and goes with the next version", RenamedWarning, stacklevel=2)
            continue
        for name, implied in {new.name: value, **new.implied}.items():
            if table.setdefault(name, implied) != implied:
                raise ValueError(f"{old} = {value} does not go with {name} = {table[name]}; give one of them")
        words = ", ".join([f"{new.name} = {value}", *(f'{name} = "{given}"' for name, given in new.implied.items())])
        warnings.warn(f"{old} is an old name, read in this version only: write {words}", RenamedWarning, stacklevel=2)
    return table
