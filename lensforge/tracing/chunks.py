"""Work on rays in parallel with the same bits on any number of threads.

Rays are cut into a fixed number of chunks, whatever the number of threads, and callers add partial sums in the
order of the chunks.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
import torch

CHUNKS = 8


def in_chunks(work: Callable[[int, slice], Any], count: int) -> None:
    """Run ``work(chunk number, slice of rays)`` for every chunk on as many threads as torch may use."""
    edges = np.linspace(0, count, CHUNKS + 1).astype(int)
    list(_pool(torch.get_num_threads()).map(lambda i: work(i, slice(edges[i], edges[i + 1])), range(CHUNKS)))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Kept from call to call: a search makes some ten calls in every step."""
    return ThreadPoolExecutor(threads)
