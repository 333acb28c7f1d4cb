"""A tool of each command: a JSON schema made of its options, and the command line of a call."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import click

from lensforge.addons.mcp import light_picture
from lensforge.cli.cli import all_commands
from lensforge.errors import InputError

# Commands with a window or a server of their own, and what concerns a terminal, a desktop or other machines.
_NO_TOOLS = ("compile", "mcp", "studio")
_HIDDEN = ("as_json", "quiet", "shown", "scheduler", "device", "threads")


PATH = {"type": "string", "description": "path in the folder"}  # schema of a file or a folder


def object_schema(properties: Mapping[str, Any], required: Sequence[str]) -> dict[str, Any]:
    """JSON schema of the arguments of a tool, which takes no others."""
    return {"type": "object", "properties": properties, "required": [*required], "additionalProperties": False}


@dataclass(frozen=True)
class CommandTool:
    """A ``command`` as a tool of the same name."""

    command: click.Command

    @property
    def name(self) -> str:
        """Name of the tool."""
        return self.command.name or ""

    @property
    def description(self) -> str:
        """The help of the command."""
        return (self.command.help or "").replace("\b\n", "").strip()

    @cached_property
    def schema(self) -> dict[str, Any]:
        """JSON schema of its arguments."""
        properties = {_key(parameter): _property(parameter) for parameter in self._parameters}
        return object_schema(properties, [_key(parameter) for parameter in self._parameters if parameter.required])

    def module_line(self, given: Mapping[str, Any], folder: Path) -> list[str]:
        """The module of the command line with command and options, for arguments ``given`` by the schema.

        Raises :class:`InputError` for a file outside of the ``folder``.
        """
        options: list[str] = []
        positional: list[str] = []
        for parameter in self._parameters:
            value = given.get(_key(parameter))
            if value is None:
                continue
            if isinstance(parameter.type, click.Path):
                for path in _texts(value):
                    require_inside(path, folder)
            if isinstance(parameter, click.Argument):
                positional += _texts(value)
            elif isinstance(parameter, click.Option):
                options += _option(parameter, value)
        as_json = ["--json"] if any(parameter.name == "as_json" for parameter in self.command.params) else []
        # after -- nothing is taken for an option
        return ["lensforge", self.name, *options, *as_json, "--", *positional]

    @property
    def _parameters(self) -> Iterator[click.Parameter]:
        return (parameter for parameter in self.command.params if parameter.name not in _HIDDEN)


class PictureTool:
    """A picture of the light of a lens."""

    name = "picture"
    description = "Draw the light of the lens in a result folder: its map on the receiver, beside a scale."
    schema = object_schema({"directory": PATH}, ["directory"])

    def module_line(self, given: Mapping[str, Any], folder: Path) -> list[str]:
        """The module that draws it, with the result folder. Raises :class:`InputError` for one outside."""
        return [light_picture.__name__, str(require_inside(given["directory"], folder))]


def command_tools() -> dict[str, CommandTool]:
    """The tools by their names."""
    return {name: CommandTool(command) for name, command in all_commands().items() if name not in _NO_TOOLS}


def require_inside(path: str, folder: Path) -> Path:
    """The whole path of a file. Raises :class:`InputError` where it lies outside of the ``folder``."""
    try:
        full = Path(folder, path).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path!r}: no file can have this name ({error})") from None
    if not full.is_relative_to(folder):
        raise InputError(f"{path}: outside of the folder of this server; give a path from there, such as lens.toml")
    return full


def _key(parameter: click.Parameter) -> str:
    """Name of an option without its dashes; of an argument its own."""
    return parameter.opts[0].lstrip("-").replace("-", "_")


def _property(parameter: click.Parameter) -> dict[str, Any]:
    value = _value(parameter)
    if parameter.nargs > 1:
        value = {"type": "array", "items": value, "minItems": parameter.nargs, "maxItems": parameter.nargs}
    elif parameter.nargs < 0 or parameter.multiple:
        value = {"type": "array", "items": value, "minItems": 1 if parameter.required else 0}
    text = parameter.help if isinstance(parameter, click.Option) else PATH["description"]
    return {**value, **({"description": text} if text else {})}


def _value(parameter: click.Parameter) -> dict[str, Any]:
    kind = parameter.type
    if isinstance(parameter, click.Option) and parameter.is_flag:
        return {"type": "boolean"}
    if isinstance(kind, click.Choice):
        return {"type": "string", "enum": list(kind.choices)}
    if isinstance(kind, click.IntRange | click.FloatRange):
        number = "integer" if isinstance(kind, click.IntRange) else "number"
        least = "exclusiveMinimum" if kind.min_open else "minimum"
        most = "exclusiveMaximum" if kind.max_open else "maximum"
        bounds = {least: kind.min, most: kind.max}
        return {"type": number} | {name: bound for name, bound in bounds.items() if bound is not None}
    return {"type": "string"}


def _option(option: click.Option, value: Any) -> list[str]:
    name = option.opts[0]
    if option.is_flag:
        return [name] if value else option.secondary_opts[:1]
    if option.nargs > 1:
        return [name, *_texts(value)]
    return [f"{name}={text}" for text in _texts(value)]


def _texts(value: Any) -> Sequence[str]:
    return [str(entry) for entry in (value if isinstance(value, list) else [value])]
