"""Inverse of a cumulative distribution: a uniform number to a cell, and to a position within it."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int


def choose(
    cumulative: Float[np.ndarray, " k"], numbers: Float[np.ndarray, " n"]
) -> tuple[np.ndarray, Float[np.ndarray, " n"]]:
    """Invert a distribution of ``k`` cells, ``cumulative`` up to the end of each, for ``numbers`` in [0, 1).

    Returns the cell of each number and its position in that cell, in [0, 1].
    """
    wanted = numbers * cumulative[-1]
    index = np.minimum(np.searchsorted(cumulative, wanted, side="right"), len(cumulative) - 1)
    before = np.where(index > 0, cumulative[index - 1], 0.0)
    share = cumulative[index] - before
    position = np.divide(wanted - before, share, out=np.zeros_like(wanted), where=share > 0.0)
    return index, np.minimum(position, 1.0)


def choose_each(
    before: Callable[[Int[np.ndarray, " n"]], Float[np.ndarray, " n"]], cells: int, numbers: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Invert a separate distribution for each number, as :func:`choose` does.

    ``before``: cumulative share of each distribution before the cell of that index, from 0 to ``cells``.
    """
    first = np.zeros(len(numbers), dtype=np.int64)
    last = np.full(len(numbers), cells)
    wanted = numbers * before(last)
    while (last - first).max() > 1:  # bisection, all numbers at once
        middle = (first + last) // 2
        above = before(middle) > wanted
        first = np.where(above, first, middle)
        last = np.where(above, middle, last)
    low = before(first)
    share = before(first + 1) - low
    position = np.divide(wanted - low, share, out=np.zeros_like(wanted), where=share > 0.0)
    return first, np.minimum(position, 1.0)


def linear_inverse(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"], share: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Position in [0, 1] up to which a density linear from ``first`` to ``second`` has the given ``share``."""
    target = share * (first + second)
    denominator = first + np.sqrt(np.maximum(first**2 + (second - first) * target, 0.0))
    return np.asarray(
        np.minimum(np.divide(target, denominator, out=np.zeros_like(share), where=denominator > 0.0), 1.0)
    )
