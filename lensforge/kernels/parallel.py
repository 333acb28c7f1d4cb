"""Kernels on every core.

Rays are cut into a fixed number of chunks, whatever the number of threads, and callers add partial sums in the order
of the chunks: the same bits on any number of threads.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import torch

CHUNKS = 8


def in_chunks(work: Callable[[int, slice], Any], count: int) -> None:
    """Run ``work(chunk number, slice of rays)`` for every chunk on as many threads as torch may use."""
    edges = [count * i // CHUNKS for i in range(CHUNKS + 1)]
    in_parallel(lambda i: work(i, slice(edges[i], edges[i + 1])), CHUNKS)


def in_parallel(work: Callable[[int], Any], count: int) -> None:
    """Run ``work(0)`` to ``work(count - 1)``, on as many threads as torch may use, of which this is one."""
    threads, numbers = torch.get_num_threads(), iter(range(count))

    def take_turns() -> None:
        for number in numbers:  # each is given to one thread
            work(number)

    others = [_pool(threads).submit(take_turns) for _ in range(min(threads, count) - 1)]
    try:
        take_turns()
    finally:
        for other in others:
            if not other.cancel():  # it has begun
                other.result()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Pool kept from call to call: a search makes some ten calls in every step."""
    return ThreadPoolExecutor(threads)
