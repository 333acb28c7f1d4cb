"""Public names: a class or a verb of the library says that it is one where it is defined.

Help, pickles and pages then name ``lensforge.Spec`` rather than the module in which it is written, as they do with
NumPy's names, and show the types of a signature without modules and without the marks by which fields are validated.
"""

import inspect
import re
from collections.abc import Callable
from dataclasses import is_dataclass
from inspect import Parameter, Signature
from typing import Any, TypeVar, get_type_hints

_Named = TypeVar("_Named")
_Function = TypeVar("_Function", bound=Callable[..., Any])


class ShownType(str):
    """A type as ``help`` shows it in a signature: without the modules of the package in which its classes stand."""

    __slots__ = ()
    __repr__ = str.__str__

    @staticmethod
    def of(annotation: object) -> "ShownType":
        """The text of an annotation; of one that is a text already, that."""
        text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
        return ShownType(re.sub(r"\blensforge\.(\w+\.)*(?=\w)", "", text))


def public(named: _Named) -> _Named:
    """Make a class or a verb a name of the library, found as ``lensforge.NAME``; ``_written_in`` keeps its module."""
    vars_of: Any = named
    vars_of._written_in = vars_of.__module__
    vars_of.__module__ = "lensforge"
    if inspect.isfunction(named):
        with_shown_types(named)
    elif is_dataclass(named):
        with_shown_types(vars(named)["__init__"])
    return named


def with_shown_types(function: _Function) -> _Function:
    """Give a function the signature that ``help`` shows."""
    signature = inspect.signature(function)
    types = _types_of(function)
    parameters = [
        parameter.replace(annotation=types.get(parameter.name, Parameter.empty))
        for parameter in signature.parameters.values()
    ]
    vars(function)["__signature__"] = Signature(parameters, return_annotation=types.get("return", Signature.empty))
    return function


def _types_of(function: Callable[..., Any]) -> dict[str, ShownType]:
    """Shown types by the names of arguments; one that is written as a text, as of a class above, is shown as that."""
    annotations = inspect.get_annotations(function)
    written = {name: annotation for name, annotation in annotations.items() if isinstance(annotation, str)}
    evaluated = _WithAnnotations({name: hint for name, hint in annotations.items() if name not in written})
    types = get_type_hints(evaluated, globalns=getattr(inspect.unwrap(function), "__globals__", {}))
    return {name: ShownType.of((types | written)[name]) for name in annotations}


class _WithAnnotations:
    """What :func:`typing.get_type_hints` takes in the place of a function."""

    def __init__(self, annotations: dict[str, object]) -> None:
        self.__annotations__ = annotations
