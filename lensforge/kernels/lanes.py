"""Eight numbers at once in one vector, for a kernel that asks eight boxes or triangles about the same ray.

The compiler makes vector instructions of long loops (``ray_packet``), but unrolls a loop of eight. A test of
:func:`bits_of_lanes` is evaluated with vectors when the kernel is compiled, so that its operations become instructions.
"""

from collections.abc import Callable, Sequence
from typing import Any, cast

import numba.extending

from lensforge.kernels.compiled import Function

LANES = 8


class Lanes:
    """A vector of eight numbers, or of eight truths, in the code of a kernel; numbers stand for eight equal ones."""

    def __init__(self, builder: Any, value: Any) -> None:
        self._builder = builder
        self._value = value

    @property
    def value(self) -> Any:
        """The value in the compiler's terms."""
        return self._value

    def __add__(self, other: "Lanes | float") -> "Lanes":
        return self._made("fadd", other)

    def __sub__(self, other: "Lanes | float") -> "Lanes":
        return self._made("fsub", other)

    def __mul__(self, other: "Lanes | float") -> "Lanes":
        return self._made("fmul", other)

    def __lt__(self, other: "Lanes | float") -> "Lanes":
        return self._compared("<", other)

    def __le__(self, other: "Lanes | float") -> "Lanes":
        return self._compared("<=", other)

    def __ge__(self, other: "Lanes | float") -> "Lanes":
        return self._compared(">=", other)

    def __gt__(self, other: "Lanes | float") -> "Lanes":
        return self._compared(">", other)

    def __and__(self, other: "Lanes") -> "Lanes":
        return Lanes(self._builder, self._builder.and_(self._value, other.value))

    def or_less(self, other: "Lanes | float") -> "Lanes":
        """The lesser of two."""
        return self._chosen(self < other, other)

    def or_more(self, other: "Lanes | float") -> "Lanes":
        """The greater of two."""
        return self._chosen(self > other, other)

    def _like(self, other: "Lanes | float") -> Any:
        from llvmlite import ir

        return other.value if isinstance(other, Lanes) else ir.Constant(self._value.type, [float(other)] * LANES)

    def _made(self, name: str, other: "Lanes | float") -> "Lanes":
        made = getattr(self._builder, name)(self._value, self._like(other), flags=("contract",))
        return Lanes(self._builder, made)

    def _compared(self, sign: str, other: "Lanes | float") -> "Lanes":
        return Lanes(self._builder, self._builder.fcmp_ordered(sign, self._value, self._like(other)))

    def _chosen(self, first: "Lanes", other: "Lanes | float") -> "Lanes":
        return Lanes(self._builder, self._builder.select(first.value, self._value, self._like(other)))


def bits_of_lanes(test: Callable[[Sequence[Lanes], Sequence[Lanes]], Lanes]) -> Function:
    """A function of kernels: a number whose bit k is the ``test`` of lane k.

    It is called with a table (n, rows, eight), the number of a block of it, a tuple of the rows to take there, and a
    tuple of numbers that all lanes share; ``test`` has the rows and the numbers.
    """

    def typed(_: Any, table: Any, block: Any, rows: Any, shared: Any) -> Any:
        from numba.core import types

        return types.int64(table, block, rows, shared), code

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _code(test, context, builder, signature, arguments)

    return cast(Function, numba.extending.intrinsic(typed))


def _code(test: Any, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    from llvmlite import ir

    whole = ir.IntType(64)
    eight = ir.VectorType(ir.DoubleType(), LANES)
    table, block, rows, shared = arguments
    array = context.make_array(signature.args[0])(context, builder, table)
    first = builder.mul(block, builder.extract_value(array.shape, 1))

    def row_of(number: Any) -> Lanes:
        place = builder.gep(array.data, [builder.mul(builder.add(first, number), ir.Constant(whole, LANES))])
        return Lanes(builder, builder.load(builder.bitcast(place, eight.as_pointer()), align=8))

    def spread(number: Any) -> Lanes:
        none = ir.Constant(eight, ir.Undefined)
        start = builder.insert_element(none, number, ir.Constant(ir.IntType(32), 0))
        first_lane = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
        return Lanes(builder, builder.shuffle_vector(start, none, first_lane))

    passed = test(
        [row_of(builder.extract_value(rows, k)) for k in range(len(signature.args[2]))],
        [spread(builder.extract_value(shared, k)) for k in range(len(signature.args[3]))],
    )
    return builder.zext(builder.bitcast(passed.value, ir.IntType(LANES)), whole)


def _lowest_typed(_: Any, bits: Any) -> Any:
    from llvmlite import ir
    from numba.core import types

    def code(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), code


lowest_bit = cast(Function, numba.extending.intrinsic(_lowest_typed))  # its number, of a number that is not 0
