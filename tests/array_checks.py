"""Array shapes and dtypes in signatures, checked by every test in the first calls that it makes of each function.

jaxtyping binds and checks the arguments of each call twice, a fifth of the time of all tests. A test that calls a
function a thousand times learns nothing from the last of them that it has not from the first, nor from arguments and
a result of the types, dtypes and shapes that have passed before. Functions whose signature names no array are left to
mypy. By night all calls of all functions are checked.
"""

import dataclasses
import functools
import inspect
import sys
import types
from collections.abc import Callable, Sequence
from typing import Any

import jaxtyping
import numpy as np
from nightly import NIGHTLY

CALLS = 3  # of each function in each test
_SMALL = 16  # sizes up to here may be those of an annotation
_jaxtyped = jaxtyping.jaxtyped
_begun: list["_Checks"] = []


@dataclasses.dataclass
class _Checks:
    """Of the functions made by one ``def``: calls in this test, and what has passed."""

    calls: int = 0
    passed: set[Any] = dataclasses.field(default_factory=set)


_checks: dict[tuple[str, str, int], _Checks] = {}


def install(packages: Sequence[str]) -> None:
    """Check what is imported from ``packages`` from now on."""
    jaxtyping.install_import_hook(packages, "beartype.beartype")
    if not NIGHTLY:
        jaxtyping.jaxtyped = checked  # which the hook writes above every function and class


def begin_test() -> None:
    """Check the first calls again."""
    for checks in _begun:
        checks.calls = 0
    _begun.clear()


def checked(subject: Any = None, *, typechecker: Callable[..., Any]) -> Any:
    """Decorate as ``jaxtyping.jaxtyped`` does, for as many calls."""
    if subject is None:
        return functools.partial(checked, typechecker=typechecker)
    if inspect.isclass(subject):
        if dataclasses.is_dataclass(subject) and inspect.isfunction(vars(subject).get("__init__")):
            subject.__init__ = _in_first_calls(subject.__init__, typechecker)
        return subject
    if inspect.isfunction(subject):
        return _in_first_calls(subject, typechecker)
    return _jaxtyped(subject, typechecker=typechecker)


def _in_first_calls(function: Callable[..., Any], typechecker: Callable[..., Any]) -> Callable[..., Any]:
    if not any("jaxtyping" in repr(each) for each in function.__annotations__.values()):
        return function
    name = function.__module__, function.__qualname__, function.__code__.co_firstlineno
    checks = _checks.setdefault(name, _Checks())

    found: list[Any] = []

    @functools.cache  # at the first call: most functions are not called by a process
    def prepared(run: bool) -> Callable[..., Any]:
        body = function if run else functools.wraps(function)(lambda *_, **__: found.pop())
        return _jaxtyped(body, typechecker=typechecker)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        if checks.calls >= CALLS:
            return function(*args, **kwargs)
        if checks.calls == 0:
            _begun.append(checks)
        checks.calls += 1
        sizes: dict[int, int] = {}
        given = _form((*args, *kwargs.values()), sizes), tuple(kwargs)
        known = given in checks.passed
        result = (function if known else prepared(True))(*args, **kwargs)
        both = given, _form(result, sizes)
        if known and both not in checks.passed:
            found.append(result)
            prepared(False)(*args, **kwargs)
        checks.passed |= {given, both}
        return result

    return call


def _form(value: Any, sizes: dict[int, int]) -> Any:
    """All of it that annotations speak of: large sizes are numbered by their first appearance in ``sizes``."""
    kind = type(value)
    if kind in (float, int, bool, types.NoneType):
        return kind
    if isinstance(value, np.ndarray) or kind is getattr(sys.modules.get("torch"), "Tensor", None):
        return (
            kind,
            value.dtype,
            tuple(size if size <= _SMALL else -sizes.setdefault(size, len(sizes) + 1) for size in value.shape),
        )
    if kind in (tuple, list):
        return kind, tuple(_form(each, sizes) for each in value[:_SMALL])
    if kind is str:
        return value
    return kind
