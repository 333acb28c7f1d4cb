"""The user's cache of results that one command made and another may reuse, such as the pictures of a page.

An entry is JSON under a line with its SHA-256. One that is damaged, of another kind, too large or no regular file is
made anew; nothing in it is run. Others of the machine have no access to the folder.
"""

import hashlib
import os
import stat
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter

from lensforge.errors import InputError
from lensforge.results.files import MIB, read_file, write_file

_Made = TypeVar("_Made")
_homes: list[Path] = []  # of the user's cache; none for a script
_MOST_KEPT = 1000  # files: some 130 MB
_MOST_BYTES = 64 * MIB  # of one: the pictures of a page have 1 MB, a part to be turned at most ten
_DIGEST_CHARACTERS = 64
_OWN_ALONE = 0o700


def keep_what_is_made() -> None:
    """Let :func:`made_once` keep results in the user's cache, if there is one."""
    with suppress(RuntimeError):  # no home
        _homes.append(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lensforge" / "made")


def made_once(
    of: Sequence[object], make: Callable[[], _Made], kind: Any, lasting: Callable[[_Made], bool] = lambda _: True
) -> _Made:
    """Result of ``make``, or that of an earlier command of the same program with equal keys ``of``.

    ``kind``: the type of the result, of text, numbers and dataclasses. ``lasting``: whether it is to be kept.
    """
    if not _homes:
        return make()
    key = _key(of)
    adapter = TypeAdapter(kind)
    path = _homes[0] / f"{key}.json"
    with suppress(InputError, OSError, ValueError):  # none yet, or a damaged one
        cached: _Made = adapter.validate_json(_content(path, key))
        return cached
    made = make()
    with suppress(InputError, OSError):  # a full disk, or none to write on
        if lasting(made):
            _keep(path, key, adapter.dump_json(made))
        for oldest in sorted(path.parent.iterdir(), key=lambda file: file.lstat().st_mtime)[:-_MOST_KEPT]:
            oldest.unlink()
    return made


def _content(path: Path, key: str) -> bytes:
    """Content of an entry. Raises ``ValueError`` unless it was written under this ``key``."""
    if not stat.S_ISREG(path.lstat().st_mode):  # a link may lead anywhere
        raise ValueError("no regular file")
    whole = read_file(path, missing="it is made anew", most_bytes=_MOST_BYTES)
    digest = whole[:_DIGEST_CHARACTERS]
    content = whole[_DIGEST_CHARACTERS + 1 :]
    if digest != _digest(key, content):
        raise ValueError("damaged")
    return content


def _keep(path: Path, key: str, content: bytes) -> None:
    path.parent.mkdir(mode=_OWN_ALONE, parents=True, exist_ok=True)
    path.parent.chmod(_OWN_ALONE)
    write_file(path, _digest(key, content) + b"\n" + content)


def _digest(key: str, content: bytes) -> bytes:
    return hashlib.sha256(key.encode() + content).hexdigest().encode()


def _key(of: Sequence[object]) -> str:
    """Cache key of a result ``of`` these values by this program."""
    parts = [
        hashlib.sha256(ingredient).hexdigest() if isinstance(ingredient, bytes) else repr(ingredient)
        for ingredient in of
    ]
    return hashlib.sha256(repr((_sources(), parts)).encode()).hexdigest()


@cache
def _sources() -> list[tuple[str, int]]:
    """Names and times of the program's sources: a changed program may give other results."""
    return [(str(path), path.stat().st_mtime_ns) for path in sorted(Path(__file__).parents[1].rglob("*.py"))]
