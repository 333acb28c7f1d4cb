"""How does a program that speaks the Model Context Protocol design a lens? By the commands, as its tools.

- ``mcp_command``: the command
- ``tool_server``: answers to a client
- ``command_tools``: a tool of each command: its schema, and the command line of a call
- ``tool_process``: first code of the process of a tool
- ``command_call``: a command in a process of its own that reads and writes in one folder
- ``light_picture``: a picture of the light of a lens
- ``folder_tools``: tools that list, read and write the texts of the folder
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lensforge.addon import Addon

if TYPE_CHECKING:
    import click


def _commands() -> "Sequence[click.Command]":
    from lensforge.addons.mcp.mcp_command import mcp

    return (mcp,)


ADDON = Addon("mcp", commands=_commands, heading="Design")
