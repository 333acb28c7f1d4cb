"""The line of a refusal, and records changed under a right checksum."""

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import lensforge as lf
from lensforge.results.stage_result import with_checksum

MOST_BYTES = 200 * 2**20  # of memory while a record is refused


def one_line(caught: pytest.ExceptionInfo[lf.InputError]) -> str:
    """The line of an error that was expected."""
    line = str(caught.value)
    assert line.isprintable() and len(line) < 1000, line
    return line


def refusal(read: Callable[[], object]) -> str:
    """The line with which ``read`` refuses."""
    with pytest.raises(lf.InputError) as caught:
        read()
    return one_line(caught)


def refusal_in_little_memory(read: Callable[[], object]) -> str:
    """The same; ``read`` takes no more than a fraction of what the file asks for."""
    tracemalloc.start()
    try:
        message = refusal(read)
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()
    return message


def content_of(path: Path) -> Any:
    content = json.loads(path.read_text(encoding="utf-8"))
    content.pop("content_sha256")
    return content


def changed(path: Path, where: str, value: object) -> None:
    """Give the entry at the dotted place ``where`` another value; the file's hash is that of its new content."""
    content = content_of(path)
    *way, last = (int(part) if part.isdigit() else part for part in where.split("."))
    holder = content
    for part in way:
        holder = holder[part]
    holder[last] = value
    path.write_text(json.dumps(with_checksum(content)), encoding="utf-8")
