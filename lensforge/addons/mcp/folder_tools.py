"""Tools that list, read and write the texts of the folder: a client writes specs, and reads what commands leave."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lensforge.addons.mcp.command_tools import PATH, object_schema, require_inside
from lensforge.errors import InputError
from lensforge.results.files import MIB, read_file, write_file

_MOST_READ_BYTES = MIB // 4  # what a client can take at once
_MOST_WRITTEN_BYTES = MIB
_WRITTEN = (".toml", ".csv")  # specs, and the tables that they name: results are written by commands alone
_MOST_LISTED = 500


@dataclass(frozen=True)
class FolderTool:
    """A tool by its ``name``.

    ``answer``: of the tool, by its arguments and the folder. ``properties``: of the schema, all texts and required.
    """

    name: str
    description: str
    answer: Callable[[Mapping[str, Any], Path], str]
    properties: Mapping[str, Any]

    @property
    def schema(self) -> dict[str, Any]:
        """JSON schema of its arguments."""
        return object_schema(self.properties, [*self.properties])


def _listed(_: Mapping[str, Any], folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    lines = [f"{path.relative_to(folder).as_posix()}  {path.stat().st_size} bytes" for path in files[:_MOST_LISTED]]
    if len(files) > _MOST_LISTED:
        lines.append(f"and {len(files) - _MOST_LISTED} more")
    return "\n".join(lines) or "no file yet"


def _text(given: Mapping[str, Any], folder: Path) -> str:
    path = require_inside(given["path"], folder)
    content = read_file(path, missing="list_files names those that are there", most_bytes=_MOST_READ_BYTES)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{given['path']}: it is no text in UTF-8") from None


def _written(given: Mapping[str, Any], folder: Path) -> str:
    path = require_inside(given["path"], folder)
    content = given["text"].encode()
    if path.suffix not in _WRITTEN:
        raise InputError(f"{given['path']}: its suffix must be one of {', '.join(_WRITTEN)}; commands write all else")
    if len(content) > _MOST_WRITTEN_BYTES:
        raise InputError(f"{given['path']}: {len(content)} bytes, must be at most {_MOST_WRITTEN_BYTES}")
    if not path.parent.is_dir():
        raise InputError(f"{given['path']}: no such folder; give a name without one")
    write_file(path, content)
    return f"{given['path']}: {len(content)} bytes"


FOLDER_TOOLS = {
    tool.name: tool
    for tool in (
        FolderTool("list_files", "List the files of the folder, with their sizes.", _listed, {}),
        FolderTool("read_text", "Read a text file of the folder, such as a spec or a record.", _text, {"path": PATH}),
        FolderTool(
            "write_text",
            "Write a spec (.toml) or a table that it names (.csv) into the folder; one that is there is replaced.",
            _written,
            {"path": PATH, "text": {"type": "string", "description": "the whole file"}},
        ),
    )
}
