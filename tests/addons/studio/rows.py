"""Rows of the studio in tables of the suite."""

from pathlib import Path
from unittest.mock import patch

from click.testing import CliRunner

from lensforge.cli.cli import cli


def of_studio(flag: str, _here: Path) -> bool:
    """The verb hears of the port, and of the browser."""
    arguments, changed = {
        "--port": (["--port", "8123"], {"port": 8123}),
        "--browser": (["--no-browser"], {"browser": False}),
    }[flag]
    with patch("lensforge.addons.studio.command.open_studio") as opened:
        CliRunner().invoke(cli, ["studio", "lens.toml", *arguments])
    return bool(opened.call_args.kwargs == {"port": 0, "browser": True} | changed)


SHOWN = {"studio": (of_studio, ("--port", "--browser"))}  # options of which something is seen
OF_TEXT = {"studio": "a page"}  # commands that print no record, and what they give
