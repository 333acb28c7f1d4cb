"""Kernels in single precision: the same sources, with each of their numbers in float32.

A vector register then holds twice as many rays. A number written in a kernel is float64 to numba, and one of them
makes all that is computed with it float64, so :func:`in_single` compiles a copy of a kernel, and of the kernels that it
calls, in which they are float32. Where arrays are float32, too, so is the rest. numba's own typing, by arguments, would
ask for each of the 687 numbers in 161 kernels as an argument; this takes 0.55 of the time of float64.
The number of a ray stays exact up to 2^24 of them in a chunk, as many as a search may have in all.
"""

import builtins
from dataclasses import dataclass
from functools import cache
from types import CodeType, FunctionType
from typing import Any, cast

import numpy as np
from numba.core.dispatcher import Dispatcher

from lensforge.kernels.compiled import Function, inline, kernel


class ByPrecision(float):
    """A constant of kernels that has another value, ``single``, in single precision."""

    single: float

    def __new__(cls, double: float, single: float) -> "ByPrecision":
        """The number ``double`` that is ``single`` in single precision."""
        number = super().__new__(cls, double)
        number.single = single
        return number


@cache
def in_single(function: Function) -> Function:
    """The kernel ``function`` in single precision."""
    plain = cast(Dispatcher, function).py_func
    code = _code_in_single(plain.__code__)
    name = f"{plain.__qualname__}_in_single"
    known = {**vars(builtins), "float": np.float32, **plain.__globals__}
    names = {name: _in_single(known[name]) for name in (*code.co_names, "__name__") if name in known}
    copy = FunctionType(code, names, name)
    copy.__qualname__ = name
    options = cast(Dispatcher, function).targetoptions
    return inline(copy) if options.get("forceinline") else kernel(copy, fastmath=options["fastmath"])


def _code_in_single(code: CodeType) -> CodeType:
    return code.replace(co_consts=tuple(_in_single(constant) for constant in code.co_consts))


def _in_single(value: Any) -> Any:
    """A constant, or what a name stands for, in single precision: numbers and kernels."""
    if isinstance(value, Dispatcher):
        return in_single(value)
    if isinstance(value, CodeType):
        return _code_in_single(value)
    if isinstance(value, float):
        return np.float32(value.single if isinstance(value, ByPrecision) else value)
    return tuple(map(_in_single, value)) if type(value) is tuple else value


@dataclass(frozen=True)
class Precision:
    """Kind of the numbers in packets of rays, in tables and in all that belongs to them."""

    kind: type[np.float32 | np.float64]

    def kernel(self, function: Function) -> Function:
        """The kernel ``function`` for such numbers."""
        return function if self.kind is np.float64 else in_single(function)

    def of(self, values: Any) -> Any:
        """Arrays of float64, numbers, and tuples of both, as the kernels take them; anything else unchanged."""
        if self.kind is np.float64:
            return values
        if isinstance(values, np.ndarray):
            return values.astype(self.kind) if values.dtype == np.float64 else values
        if isinstance(values, tuple):
            converted = map(self.of, values)
            return type(values)(*converted) if hasattr(values, "_fields") else tuple(converted)
        return self.kind(values) if isinstance(values, float) else values


DOUBLE_PRECISION = Precision(np.float64)
SINGLE_PRECISION = Precision(np.float32)
