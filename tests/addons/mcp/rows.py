"""Rows of the tools of assistants in tables of the suite."""

from pathlib import Path


def of_mcp(_flag: str, _here: Path) -> bool:
    """The command has no option."""
    return False


SHOWN: dict[str, tuple[object, tuple[str, ...]]] = {"mcp": (of_mcp, ())}  # options of which something is seen
OF_TEXT = {"mcp": "a connection"}  # commands that print no record, and what they give
