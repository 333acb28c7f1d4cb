"""``mcp``: the commands as tools of a program that speaks the Model Context Protocol."""

from pathlib import Path

import click

from lensforge.addon import require_libraries
from lensforge.errors import InputError


@click.command()
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
def mcp(directory: Path) -> None:
    """Serve the commands as tools of the Model Context Protocol, on stdin and stdout.

    A client, such as an assistant, writes specs, designs lenses and reads their figures and pictures. It reads and
    writes in DIR alone. A client is told, for example:

    \b
    {"mcpServers": {"lensforge": {"command": "lensforge", "args": ["mcp", "/home/me/lenses"]}}}
    """
    require_libraries("mcp", "mcp")
    if not directory.is_dir():
        raise InputError(f"{directory}: no such folder; make one for the lenses")
    import anyio

    from lensforge.addons.mcp.tool_server import serve

    anyio.run(serve, directory.resolve())
