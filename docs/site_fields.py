"""Help of the public names for Sphinx: its lists of arguments, fields and properties."""

import inspect
import re
import types
from functools import cached_property
from typing import Any

from pydantic import BaseModel

import lensforge
from lensforge.results.field_help import short_type


def property_lines(model: type) -> list[str]:
    """Entries for the public properties of a class, each with the first paragraph of its docstring."""
    lines = []
    for name in dir(model):
        member = inspect.getattr_static(model, name)
        getter = member.fget if isinstance(member, property) else getattr(member, "func", None)
        if isinstance(member, property | cached_property) and not name.startswith("_"):
            words = " ".join((getter.__doc__ or "").split("\n\n")[0].split())
            lines.append(f"    {name} ({short_type(getter.__annotations__.get('return', ''))}): {words}")
    return lines


def as_sections(_app: Any, kind: str, _name: str, documented: Any, _options: Any, lines: list[str]) -> None:
    """Make a field of "Returns: words", which napoleon knows only below a heading, and give a class its properties."""
    headed = []
    for line in lines:
        begun = re.fullmatch(r"(Returns|Raises): (.*)", line)
        headed.append(f"\n:{begun[1]}: {begun[2]}" if begun else line.replace("Example:", "\nExample:"))
    lines[:] = [re.sub(r"(?<!`)`([^`]+)`(?![`_])", r"``\1``", line) if ":`" not in line else line for line in headed]
    if kind == "class" and (shown := property_lines(documented)):
        lines += ["", "Properties:", *shown]
    lines[:] = "\n".join([*lines, ""]).split("\n")


def short_signature(
    _app: Any, kind: str, _name: str, documented: Any, _options: Any, arguments: str | None, result: str | None
) -> tuple[str | None, str | None] | None:
    """No signature for classes whose fields stand below; that of a verb as ``help`` has it."""
    if kind == "class" and arguments:
        return "", ""
    if "__signature__" not in vars(documented):
        return None
    shown = re.sub(r"\b(pathlib|collections\.abc|datetime)\.", "", str(inspect.signature(documented)))
    shown = shown.replace("*<class 'SearchOptions'>", "Unpack[SearchOptions]")
    taken, _, given = shown.rpartition(" -> ")
    return taken, given


def skip_member(_app: Any, _kind: str, name: str, member: Any, _skip: bool, _options: Any) -> bool | None:
    """True for all but methods of our own: fields and properties are in the lists of the class."""
    foreign = name.startswith("_") or hasattr(BaseModel, name)
    return True if foreign or not isinstance(member, types.FunctionType | types.MethodType) else None


def written_in(_app: Any, module: str, name: str) -> str | None:
    """Module in which a public name is written: its source is shown."""
    first = getattr(lensforge, name.split(".")[0], None) if module == "lensforge" else None
    return getattr(first, "_written_in", None)


def show_help(app: Any) -> None:
    """Connect all of this with Sphinx, before napoleon reads the docstrings."""
    app.connect("autodoc-process-docstring", as_sections, priority=400)
    app.connect("autodoc-process-signature", short_signature)
    app.connect("autodoc-skip-member", skip_member)
    app.connect("viewcode-follow-imported", written_in)
