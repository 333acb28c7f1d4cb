"""Blocks of a long series, and sums over them that do not depend on how it is read."""

from collections.abc import Iterator, Sequence

BLOCK_RAYS = 2**18  # rays handled at a time: bounds the memory whatever their number


def block_slices(count: int, start: int = 0) -> Iterator[slice]:
    """Yield consecutive parts of ``count`` numbers: halves of halves, where NumPy's own pairwise sum divides them."""
    if count <= BLOCK_RAYS:
        yield slice(start, start + count)
        return
    first = _first_half(count)
    yield from block_slices(first, start)
    yield from block_slices(count - first, start + first)


def total_of(count: int, sums: Sequence[float]) -> float:
    """Add up the sums over the :func:`block_slices` of ``count`` numbers: what ``np.sum`` has for all at once.

    One sum alone is that of all.
    """
    return sums[0] if len(sums) == 1 else _pairwise(count, iter(sums))


def _pairwise(count: int, sums: Iterator[float]) -> float:
    if count <= BLOCK_RAYS:
        return next(sums)
    first = _first_half(count)
    total = _pairwise(first, sums)
    return total + _pairwise(count - first, sums)


def _first_half(count: int) -> int:
    return count // 2 - count // 2 % 8
