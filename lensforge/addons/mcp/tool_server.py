"""Answers to a client: which tools there are, and what a call of one gives.

One command runs at a time, as each uses all cores. A refusal is an answer that the client reads, not a failure of the
connection: one line that says what to try.
"""

import json
from base64 import b64encode
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import anyio
from mcp.server import Server, ServerRequestContext
from mcp.server.stdio import stdio_server
from mcp.types import (
    CallToolRequestParams,
    CallToolResult,
    ImageContent,
    ListToolsResult,
    PaginatedRequestParams,
    TextContent,
    Tool,
)

from lensforge.addons.mcp.command_call import CommandAnswer, call
from lensforge.addons.mcp.command_tools import CommandTool, PictureTool, command_tools
from lensforge.addons.mcp.folder_tools import FOLDER_TOOLS, FolderTool
from lensforge.errors import InputError, LensforgeError
from lensforge.version import __version__

AnyTool = CommandTool | PictureTool | FolderTool
_BAD_INPUT = InputError.exit_code
_INSTRUCTIONS = """Designs lenses for LEDs that a shop can make. Lengths in mm, angles in degrees, flux in lm or W.
Begin with `new` (an LED and the wanted light make a commented spec) or `examples` (specs to copy); `write_text` changes
one. `preview` draws a first look; `design` makes the lens, its files and its verdict, soonest at
`accuracy = "draft"`. Results lie in cad_out/NAME; the other tools take that folder. `schema` has all fields
of a spec. Every figure is a simulation, with its standard error."""


class ToolServer:
    """Tools that work in one ``folder``."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._tools: dict[str, AnyTool] = {**command_tools(), PictureTool.name: PictureTool(), **FOLDER_TOOLS}
        self._running = anyio.Lock()

    def protocol(self) -> Server[Any]:
        """The server of the protocol, to be run on the streams of a client."""
        return Server(
            "lensforge",
            version=__version__,
            instructions=_INSTRUCTIONS,
            on_list_tools=self._list,
            on_call_tool=self._call,
        )

    async def _list(self, _: ServerRequestContext[Any], __: PaginatedRequestParams | None) -> ListToolsResult:
        tools = (
            Tool(name=tool.name, description=tool.description, input_schema=tool.schema)
            for tool in self._tools.values()
        )
        return ListToolsResult(tools=list(tools))

    async def _call(self, context: ServerRequestContext[Any], asked: CallToolRequestParams) -> CallToolResult:
        try:
            tool = self._tool(asked.name)
            arguments = asked.arguments or {}
            _require_names(tool, arguments)
            if isinstance(tool, FolderTool):
                return _answer(tool.answer(arguments, self._folder))
            module_line = tool.module_line(arguments, self._folder)
        except LensforgeError as error:
            return _answer(str(error), is_error=True)
        lines = 0

        async def report(line: str) -> None:
            nonlocal lines
            lines += 1
            await context.session.report_progress(lines, message=line)

        async with self._running:
            return _answer_of(await call(module_line, self._folder, report))

    def _tool(self, name: str) -> AnyTool:
        if name not in self._tools:
            raise InputError(f"{name}: no such tool; there are {', '.join(self._tools)}")
        return self._tools[name]


def _require_names(tool: AnyTool, arguments: Mapping[str, Any]) -> None:
    """Raise :class:`InputError` for unknown or missing arguments; values are checked by the command."""
    known = tool.schema["properties"]
    for name in arguments:
        if name not in known:
            raise InputError(f"{tool.name}.{name}: no such argument; there are {', '.join(known)}")
    for name in tool.schema["required"]:
        if name not in arguments:
            raise InputError(f"{tool.name}.{name}: not given; {known[name].get('description', 'give it')}")
    if isinstance(tool, FolderTool):
        for name, value in arguments.items():
            if not isinstance(value, str):
                raise InputError(f"{tool.name}.{name}: {value!r}, must be a text")


def _answer_of(answer: CommandAnswer) -> CallToolResult:
    """The document of a command, what it has noted besides, and the pictures it has drawn."""
    if answer.code == _BAD_INPUT:
        return _answer(answer.notes or answer.out, is_error=True)
    text = answer.out.strip()
    document = None
    with suppress(ValueError):  # of a command that prints a text
        document = _essentials(json.loads(text))
        text = json.dumps(document, ensure_ascii=False)
    texts = "\n\n".join(filter(None, (text, answer.notes)))
    pictures = (
        ImageContent(data=b64encode(path.read_bytes()).decode(), mime_type="image/png") for path in answer.pictures
    )
    return CallToolResult(
        content=[TextContent(text=texts), *pictures],
        structured_content=document,
        is_error=answer.code not in (0, 1),
    )


def _essentials(document: dict[str, Any]) -> dict[str, Any]:
    """Folder, verdict and facts of a result, which are a tenth of it: its records lie in the folder, to be read."""
    if "facts" not in document:
        return document
    return {name: _filled(document[name]) for name in ("folder", "verdict", "facts") if name in document}


def _filled(value: Any) -> Any:
    """The value without fields that hold nothing."""
    if isinstance(value, dict):
        return {name: _filled(entry) for name, entry in value.items() if entry not in (None, "", [], {})}
    return [_filled(entry) for entry in value] if isinstance(value, list) else value


def _answer(text: str, *, is_error: bool = False) -> CallToolResult:
    return CallToolResult(content=[TextContent(text=text)], is_error=is_error)


async def serve(folder: Path) -> None:
    """Answer the client on stdin and stdout until it leaves."""
    server = ToolServer(folder).protocol()
    async with stdio_server() as (read, write):
        await server.run(read, write, server.create_initialization_options())
