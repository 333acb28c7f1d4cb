"""Array shapes and dtypes in signatures, checked by every test in the first calls that it makes of each function.

jaxtyping binds and checks the arguments of each call twice, and prepares each function, also those that are defined
within another, whenever it is defined: a fifth of the time of all tests. A test that calls a function a thousand times
learns nothing from the last of them that it has not from the first; by night all are checked. Functions whose
signature names no array are left to mypy, which knows types such as ``Self`` that cannot be checked outside a class.
"""

import dataclasses
import functools
import inspect
import sys
from collections.abc import Callable, Sequence
from typing import Any

import jaxtyping
from nightly import NIGHTLY

CALLS = sys.maxsize if NIGHTLY else 3  # of each function in each test
_jaxtyped = jaxtyping.jaxtyped
_calls: dict[tuple[str, str, int], list[int]] = {}
_begun: list[list[int]] = []


def install(modules: Sequence[str]) -> None:
    """Check what is imported of these ``modules`` from now on."""
    installed = jaxtyping.install_import_hook(modules, "beartype.beartype")
    # Its own compares every module that is imported, of any library, with each of these.
    installed.hook.should_instrument = frozenset(modules).__contains__
    jaxtyping.jaxtyped = checked  # which the hook writes above every function and class


def begin_test() -> None:
    """Check the first calls again."""
    for count in _begun:
        count[0] = 0
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
    if not any("jaxtyping" in repr(annotation) for annotation in function.__annotations__.values()):
        return function
    name = function.__module__, function.__qualname__, function.__code__.co_firstlineno
    count = _calls.setdefault(name, [0])
    prepared: list[Callable[..., Any]] = []  # at the first call: most functions are not called by a process

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        if count[0] >= CALLS:
            return function(*args, **kwargs)
        if count[0] == 0:
            _begun.append(count)
        count[0] += 1
        if not prepared:
            prepared.append(_jaxtyped(function, typechecker=typechecker))
        return prepared[0](*args, **kwargs)

    return call
