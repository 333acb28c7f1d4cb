"""Kernels on every core.

Rays are cut into a fixed number of chunks, whatever the number of threads, and callers add partial sums in the order
of the chunks: the same bits on any number of threads.
"""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

CHUNKS = 8
_requested: list[Callable[[], int]] = []  # by the blocks of ``kernel_threads`` that are open


@contextmanager
def kernel_threads(threads: int | Callable[[], int] | None) -> Iterator[None]:
    """Let the kernels use ``threads`` threads inside the block; None leaves the number unchanged.

    A function is evaluated at each call of :func:`in_parallel`: another process may need a core for some of the time.
    """
    if threads is None:
        yield
        return
    _requested.append(threads if callable(threads) else lambda: threads)
    try:
        yield
    finally:
        _requested.pop()


def thread_count() -> int:
    """Threads of the kernels: as requested, else those of torch if it is loaded, else one for each core."""
    if _requested:
        return _requested[-1]()
    torch = sys.modules.get("torch")
    if torch is not None and hasattr(torch, "get_num_threads"):  # not while it loads
        return int(torch.get_num_threads())
    openmp = os.environ.get("OMP_NUM_THREADS", "")  # as torch obeys it
    if openmp.isdecimal() and int(openmp) > 0:
        return int(openmp)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1  # not on Windows


def in_chunks(work: Callable[[int, slice], Any], count: int, *, worth: int = 1) -> None:
    """Run ``work(chunk number, slice of rays)`` for every chunk on as many threads as the kernels may use.

    Of fewer than ``worth`` rays this thread does all.
    """
    edges = [count * i // CHUNKS for i in range(CHUNKS + 1)]
    in_parallel(lambda i: work(i, slice(edges[i], edges[i + 1])), CHUNKS, shared=count >= worth)


def in_pieces(work: Callable[[slice], Any], count: int, *, worth: int) -> None:
    """Run ``work(slice of rays)`` where rays are independent of the others in their slice.

    A piece has at least half as many as are ``worth`` two threads: to hand the interpreter's lock from thread to thread
    between two calls takes longer than most calls on a thousand rays.
    """
    pieces = max(1, min(CHUNKS, 2 * count // worth)) if thread_count() > 1 else 1
    in_parallel(lambda i: work(slice(count * i // pieces, count * (i + 1) // pieces)), pieces)


def part_of(values: Float[np.ndarray, " k"], part: slice) -> Float[np.ndarray, " i"]:
    """Values of a part of the rays if there is one for each; else the common one, or none."""
    return values if len(values) <= 1 else values[part]


def in_parallel(work: Callable[[int], Any], count: int, *, shared: bool = True) -> None:
    """Run ``work(0)`` to ``work(count - 1)``, on as many threads as the kernels may use, of which this is one.

    What is not ``shared`` this thread does alone.
    """
    threads = thread_count() if shared else 1
    numbers = iter(range(count))

    def take_turns() -> None:
        for number in numbers:  # each is given to one thread
            work(number)

    futures = [_pool(threads).submit(take_turns) for _ in range(min(threads, count) - 1)]
    try:
        take_turns()
    finally:
        for future in futures:
            if not future.cancel():  # it has begun
                future.result()


def in_parallel_map(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """``work`` of every item, in order, on as many threads as the kernels may use."""
    results = dict[int, _Result]()

    def do(number: int) -> None:
        results[number] = work(items[number])

    in_parallel(do, len(items))
    return [results[number] for number in range(len(items))]


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Pool kept from call to call: a search makes some ten calls in every step."""
    return ThreadPoolExecutor(threads)
