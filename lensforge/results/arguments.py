"""Arguments of a verb: validated with one-line errors, and converted."""

import inspect
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import isfinite
from operator import index
from pathlib import Path
from typing import SupportsFloat, SupportsIndex, TypeVar, cast

import numpy as np

from lensforge.errors import InputError
from lensforge.results.record import LARGEST_COUNT
from lensforge.results.validation import its_type

_Kind = TypeVar("_Kind")
_MAKES = {
    "Lens": "design(spec).lens or load(folder).lens",
    "Part": "build(lens)",
    "Light": "evaluate(lens)",
    "Results": "run(...) or load(...)",
    "TolerancesSection": 'TolerancesSection(preset="precision")',
}


class ShownType(str):
    """A type as ``help`` shows it in a signature: without the modules of the package in which its classes stand."""

    __slots__ = ()
    __repr__ = str.__str__

    @staticmethod
    def of(annotation: object) -> "ShownType":
        """The words of an annotation."""
        return ShownType(re.sub(r"\blensforge\.(\w+\.)*(?=\w)", "", inspect.formatannotation(annotation)))


def count_of(name: str, value: object, least: int = 1, most: int = LARGEST_COUNT) -> int | None:
    """``value`` as an int, from NumPy integers too; None stays None. Raises :class:`InputError` for anything else."""
    if value is None:
        return None
    try:
        count = index(cast(SupportsIndex, value))
    except TypeError:
        count = least - 1
    if isinstance(value, bool) or count < least:
        raise InputError(f"{name} = {value!r}: an integer, at least {least}")
    if count > most:
        raise InputError(f"{name} = {float(min(count, 10**300)):.7g}: an integer, at most {most}")
    return count


def number_of(name: str, value: object) -> float | None:
    """``value`` as a finite number; None stays None. Raises :class:`InputError` for anything else."""
    if value is None:
        return None
    if isinstance(value, bool | np.bool_ | str) or not isinstance(value, SupportsFloat) or not isfinite(float(value)):
        raise InputError(f"{name} = {value!r}: a finite number")
    return float(value)


def path_of(name: str, value: object) -> Path | None:
    """``value`` as a path; None stays None. Raises :class:`InputError` for anything else."""
    if value is None:
        return None
    if not isinstance(value, Path | str):
        raise InputError(f"{name} = {value!r}: give the path of a file")
    return Path(value)


def require_choice(name: str, value: object, allowed: Iterable[str]) -> str:
    """Return ``value`` of the argument ``name``. Raises :class:`InputError` unless it is one of those ``allowed``."""
    choices = tuple(allowed)
    if isinstance(value, str) and value in choices:
        return value
    raise InputError(f"{name} = {value!r}: must be one of {', '.join(choices)}")


def require(value: object, kind: type[_Kind], verb: str) -> _Kind:
    """Return ``value`` if it is a ``kind``; else raise an :class:`InputError` that says how to obtain one."""
    if isinstance(value, kind):
        return value
    remedy = _MAKES.get(kind.__name__, "one of the classes of lensforge")
    name = "Run" if kind.__name__ == "Results" else kind.__name__
    plain = isinstance(value, str | Path | int | float)
    given = f"{str(value)[:60]!r} is {its_type(value)}" if plain else f"{type(value).__name__} given"
    raise InputError(f"{verb}: {given}, must be a {name}: {remedy}")


@contextmanager
def threads_of_torch(threads: int | None) -> Iterator[None]:
    """Let torch and the tracer use ``threads`` threads inside the block; None leaves the number unchanged."""
    if threads is None:
        yield
        return
    wanted = count_of("threads", threads)
    assert wanted is not None
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(wanted)
    try:
        yield
    finally:
        torch.set_num_threads(before)
