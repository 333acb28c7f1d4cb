"""Whole numbers of the command line: ``1000000``, ``1_000_000`` or ``1e6``, within a range."""

from decimal import Decimal, InvalidOperation
from typing import Any

import click

_MOST_DIGITS = 18  # of a number that any option takes; a larger exponent is not written out


class WholeNumber(click.IntRange):
    """A whole number from ``min`` to ``max``, written with or without an exponent."""

    name = "whole number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read ``value``, and refuse it where it is no whole number, or not in the range."""
        if isinstance(value, str):
            try:
                number = Decimal(value)
            except InvalidOperation:
                self.fail(f"{value!r} is no number; write 1000000 or 1e6", param, ctx)
            if not number.is_finite() or number.adjusted() > _MOST_DIGITS or number != number.to_integral_value():
                self.fail(f"{value!r} is not a whole number {self._describe_range()}", param, ctx)
            value = int(number)
        found: int = super().convert(value, param, ctx)
        return found

    def _describe_range(self) -> str:
        """The range in words, for help and errors."""
        return f"from {self.min:,} to {self.max:,}"
