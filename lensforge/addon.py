"""Add-ons: what one trade needs, in a package of its own that the core does not import and does well without.

A package of ``lensforge/addons`` is one, and so is a package of anybody's that is installed with an entry point of the
group ``lensforge.addons``. Each has an ``ADDON``, which says what it adds. A room of the core takes from there what is
of its own kind, when it needs it: to find an add-on loads none of its modules.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from lensforge.errors import InputError, refused

if TYPE_CHECKING:
    import click

GROUP = "lensforge.addons"
# Tables of specs and records by the shipped add-ons that fill them: empty without these.
TABLES = {"offices": "office", "roads": "road", "routes": "escape", "sports": "sports"}


@dataclass(frozen=True)
class Addon:
    """Declaration of an add-on: what it adds, each function called when its room is loaded.

    ``name``: of its package, and of the extra that installs its libraries. ``names``: public names of the library, and
    what they name. ``commands``: of the command line. ``heading``: that of these in the help; empty for none.
    ``records``: loads the classes of results that its stages leave in a folder, and their facts. ``pages``: loads what
    a report shows of them. ``applications``: classes of entries of its tables in a spec. ``light``: by these, what
    judges the light of each.
    """

    name: str
    names: Callable[[], Mapping[str, object]] = dict
    commands: Callable[[], Sequence["click.Command"]] = tuple
    heading: str = ""
    records: Callable[[], object] = tuple
    pages: Callable[[], object] = tuple
    applications: Callable[[], Sequence[type]] = tuple
    light: Callable[[], Mapping[type, type]] = dict


@cache
def addons() -> tuple[Addon, ...]:
    """All add-ons that are there: those of the package by name, then installed ones.

    Raises :class:`InputError` for one that cannot be used.
    """
    return (*_shipped(), *map(_installed, entry_points(group=GROUP)))


@cache
def usable_addons() -> tuple[Addon, ...]:
    """All but those that cannot be used: of these spec and records have no fields, and who asks for more is refused."""
    addons = [*_shipped()]
    for point in entry_points(group=GROUP):
        with suppress(InputError):
            addons.append(_installed(point))
    return tuple(addons)


def absent_tables() -> dict[str, str]:
    """Tables of shipped add-ons that are not there, each with what they need: a file may still have an empty one."""
    there = {addon.name for addon in usable_addons()}
    return {table: f'needs pip install "{_extra(name)}"' for table, name in TABLES.items() if name not in there}


def _extra(name: str) -> str:
    return f"lensforge[{name}]"


def _shipped() -> tuple[Addon, ...]:
    folder = Path(__file__).with_name("addons")
    return tuple(import_module(f"{GROUP}.{module.name}").ADDON for module in iter_modules([str(folder)]))


def require_libraries(name: str, *libraries: str) -> None:
    """Raise :class:`InputError` where one of the ``libraries`` of the add-on ``name`` is not installed."""
    missing = ", ".join(library for library in libraries if find_spec(library) is None)
    if missing:
        raise InputError(f'{name}: needs {missing}; pip install "{_extra(name)}"')


def _installed(point: EntryPoint) -> Addon:
    with refused(f"add-on {point.name}", "cannot be loaded (…); install or remove it", ImportError, AttributeError):
        declared = point.load().ADDON
    if not isinstance(declared, Addon):
        raise InputError(f"add-on {point.name}: its ADDON is no lensforge.addon.Addon")
    return declared
