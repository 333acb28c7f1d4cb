"""A client's calls, answered by commands in processes of their own: figures, pictures, refusals, and an end."""

import asyncio
import base64
import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.client.stdio import StdioServerParameters, stdio_client
from mcp.types import CallToolResult, ImageContent, TextContent

from lensforge.addons.mcp.folder_tools import FOLDER_TOOLS
from lensforge.addons.mcp.tool_server import ToolServer

SPEC = """
name = "small"
[source]
kind = "square"
side_mm = 0.5
{source}
[lens]
refractive_index = 1.49
levels = [9]
[optimise]
steps_per_level = [3]
rays = 256
[evaluate]
rays = 4096
[constraints]
max_radius_mm = 4.0
[target]
kind = "disc"
diameter_mm = 60.0
distance_mm = 60.0
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "lenses"
    place.mkdir()
    (tmp_path / "outside.csv").write_text("1,2\n3,4\n", encoding="utf-8")
    return place


def answers(folder: Path, *calls: tuple[str, dict[str, Any]]) -> list[CallToolResult]:
    """What a client gets for its calls, one after the other."""

    async def client() -> list[CallToolResult]:
        async with Client(ToolServer(folder).protocol()) as asking:
            return [await asking.call_tool(name, arguments) for name, arguments in calls]

    return asyncio.run(client())


def text_of(answer: CallToolResult) -> str:
    return "\n".join(content.text for content in answer.content if isinstance(content, TextContent))


def test_a_lens_is_previewed_from_a_text_with_its_figures_and_its_picture(folder: Path) -> None:
    written, seen, drawn, listed = answers(
        folder,
        ("write_text", {"path": "small.toml", "text": SPEC.format(source="flux_w = 2.0")}),
        ("preview", {"spec": "small.toml", "seed": 3}),
        ("picture", {"directory": "cad_out/small_preview"}),
        ("list_files", {}),
    )
    assert not written.is_error and not seen.is_error, text_of(seen)
    assert set(seen.structured_content) == {"folder", "verdict", "facts"}
    facts = {fact["key"]: fact for groups in seen.structured_content["facts"].values() for fact in _facts(groups)}
    assert 0.0 < facts["efficiency"]["value"] <= 93.0 and "" not in facts["efficiency"].values()
    assert len(text_of(seen)) < 20_000, "a client reads it whole"
    for answer in (seen, drawn):
        (picture,) = (content for content in answer.content if isinstance(content, ImageContent))
        assert base64.b64decode(picture.data).startswith(b"\x89PNG")
    assert "cad_out/small_preview/light.png" in text_of(listed)


def _facts(groups: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for group in groups:
        yield from group.get("facts", [])


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [
        ("melt", {}, "melt: no such tool; there are "),
        ("design", {"spec": "a.toml"}, "design.spec: no such argument; there are specs, "),
        ("check", {}, "check.directory: not given; path in the folder"),
        ("read_text", {"path": 3}, "read_text.path: 3, must be a text"),
        ("read_text", {"path": "../outside.csv"}, "../outside.csv: outside of the folder of this server"),
        ("write_text", {"path": "lens.json", "text": "{}"}, "lens.json: its suffix must be one of .toml, .csv"),
        ("design", {"specs": ["none.toml"]}, "none.toml: no such file"),
        ("design", {"specs": ["small.toml"], "seed": -1}, "-1 is not in the range"),
        ("picture", {"directory": "."}, "lens.json"),
    ],
)
def test_what_is_refused_is_one_line_that_a_client_reads(
    name: str, arguments: dict[str, Any], says: str, folder: Path
) -> None:
    (answer,) = answers(folder, (name, arguments))
    assert answer.is_error and says in text_of(answer)
    assert "Traceback" not in text_of(answer)


def test_a_spec_reads_no_file_outside_of_the_folder(folder: Path) -> None:
    (folder / "inside.csv").write_text("1,2\n3,4\n", encoding="utf-8")
    target = SPEC.format(source="").replace('kind = "disc"\ndiameter_mm = 60.0', 'kind = "image"\nfile = "{file}"')
    for name, file in (("out.toml", "../outside.csv"), ("in.toml", "inside.csv")):
        text = target.replace("{file}", file).replace("distance_mm", "width_mm = 60.0\ndistance_mm")
        (folder / name).write_text(text, encoding="utf-8")
    refused, read = answers(folder, ("preview", {"spec": "out.toml"}), ("preview", {"spec": "in.toml"}))
    assert refused.is_error and "outside of the folders in LENSFORGE_REACH" in text_of(refused)
    assert "LENSFORGE_REACH" not in text_of(read)


def running_in(folder: Path) -> list[str]:
    """Command lines of the processes that work in ``folder``."""
    lines = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if folder == (process / "cwd").readlink():
                lines.append((process / "cmdline").read_text())
    return lines


def until_design_runs(folder: Path) -> None:
    end = time.monotonic() + 60.0
    while not any("long.toml" in line for line in running_in(folder)):
        assert time.monotonic() < end
        time.sleep(0.1)


def until_nothing_runs(folder: Path) -> None:
    end = time.monotonic() + 20.0
    while running_in(folder):
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.mark.skipif(sys.platform != "linux", reason="processes by /proc")
def test_a_call_that_is_cancelled_ends_its_processes(folder: Path) -> None:
    (folder / "long.toml").write_text(SPEC.format(source="").replace("[3]", "[100000]"), encoding="utf-8")

    async def client() -> None:
        async with Client(ToolServer(folder).protocol()) as asking:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(asking.call_tool, "design", {"specs": ["long.toml"]})
                await anyio.to_thread.run_sync(until_design_runs, folder)
                tasks.cancel_scope.cancel()
            await anyio.to_thread.run_sync(until_nothing_runs, folder)

    asyncio.run(client())


@pytest.mark.skipif(sys.platform != "linux", reason="processes by /proc")
def test_a_command_ends_with_a_server_that_is_killed(folder: Path) -> None:
    (folder / "long.toml").write_text(SPEC.format(source="").replace("[3]", "[100000]"), encoding="utf-8")
    script = (
        "import anyio, pathlib, sys\n"
        "from lensforge.addons.mcp.command_call import call\n"
        "async def silent(line): pass\n"
        "anyio.run(call, ['lensforge', 'design', 'long.toml'], pathlib.Path(sys.argv[1]), silent)\n"
    )
    server = subprocess.Popen([sys.executable, "-c", script, str(folder)])
    until_design_runs(folder)
    server.kill()
    server.wait()
    until_nothing_runs(folder)


def test_the_command_serves_on_its_streams(folder: Path) -> None:
    """As a client starts it, from another folder."""
    started = StdioServerParameters(command=sys.executable, args=["-m", "lensforge", "mcp", str(folder)])

    async def client() -> None:
        async with Client(stdio_client(started)) as asking:
            tools = (await asking.list_tools()).tools
            assert {"new", "design", "check", "picture", "write_text"} <= {tool.name for tool in tools}
            answer = await asking.call_tool(
                "new", {"spec": "a.toml", "source": "disc:1", "target": "disc:200@300", "max_radius": 9}
            )
            assert not answer.is_error, text_of(answer)

    asyncio.run(client())
    assert (folder / "a.toml").is_file()


def test_a_list_of_many_files_says_how_many_it_leaves_out(tmp_path: Path) -> None:
    """Links and folders are no files, and the first 500 by name are listed."""
    for number in range(503):
        (tmp_path / f"{number:03d}.csv").write_bytes(bytes(number % 7))
    (tmp_path / "a link.csv").symlink_to(tmp_path / "000.csv")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "z.csv").write_bytes(b"12345")
    lines = FOLDER_TOOLS["list_files"].answer({}, tmp_path).splitlines()
    assert lines[:3] == ["000.csv  0 bytes", "001.csv  1 bytes", "002.csv  2 bytes"]
    assert (len(lines), lines[499], lines[500]) == (501, f"499.csv  {499 % 7} bytes", "and 4 more")
    for number in range(3, 503):
        (tmp_path / f"{number:03d}.csv").unlink()
    listed = FOLDER_TOOLS["list_files"].answer({}, tmp_path)
    assert listed == "000.csv  0 bytes\n001.csv  1 bytes\n002.csv  2 bytes\nfolder/z.csv  5 bytes"
