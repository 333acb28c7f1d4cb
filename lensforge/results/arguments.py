"""Arguments of a verb: validated with one-line errors, and converted."""

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from functools import wraps
from math import isfinite
from operator import index
from pathlib import Path
from typing import ParamSpec, SupportsFloat, SupportsIndex, TypeVar, cast

import numpy as np

from lensforge.errors import InputError
from lensforge.results.record import LARGEST_COUNT
from lensforge.results.validation import its_type

_Kind = TypeVar("_Kind")
_Given = ParamSpec("_Given")
_MAKES = {
    "Lens": "design(spec).lens or load(folder).lens",
    "Part": "build(lens)",
    "Light": "evaluate(lens)",
    "Results": "run(...) or load(...)",
    "TolerancesSection": 'TolerancesSection(preset="precision")',
}


class UnknownArgument(InputError, TypeError):
    """A keyword that a verb does not take."""


def with_known_names(verb: Callable[_Given, _Kind]) -> Callable[_Given, _Kind]:
    """``verb``, with :class:`UnknownArgument` for unknown keywords, which suggests the one that was meant."""
    return _knowing(verb, _keywords_of(verb))


def with_options_of(
    other: Callable[..., object],
) -> Callable[[Callable[_Given, _Kind]], Callable[_Given, _Kind]]:
    """:func:`with_known_names` of a verb whose ``**options`` are keywords of the verb ``other``."""
    return lambda verb: _knowing(verb, list(dict.fromkeys([*_keywords_of(verb), *_keywords_of(other)])))


def _knowing(verb: Callable[_Given, _Kind], known: list[str]) -> Callable[_Given, _Kind]:
    @wraps(verb)
    def called(*args: _Given.args, **kwargs: _Given.kwargs) -> _Kind:
        for name in kwargs:
            if name not in known:
                near = get_close_matches(name, known, n=1)
                advice = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
                raise UnknownArgument(f"{verb.__name__}: {name}: unknown; {advice}")
        return verb(*args, **kwargs)

    return called


def _keywords_of(verb: Callable[..., object]) -> list[str]:
    return [
        parameter.name
        for parameter in inspect.signature(verb).parameters.values()
        if parameter.kind is not parameter.VAR_KEYWORD
    ]


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
    """Set torch and the tracer to ``threads`` threads inside the block; None leaves the number unchanged."""
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
