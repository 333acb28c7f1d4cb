"""Work in chunks: every number once, whatever the threads, and an error of one is raised when the others have ended."""

import threading

import pytest
import torch

from lensforge.kernels.parallel import CHUNKS, in_chunks, in_parallel
from lensforge.results.arguments import threads_of_torch


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_ray_is_in_one_chunk(threads: int) -> None:
    for count in (0, 1, 7, CHUNKS, 1001):
        seen, chunks = [0] * count, []

        def work(chunk: int, rays: slice, seen: list[int] = seen, chunks: list[int] = chunks) -> None:
            chunks.append(chunk)
            for ray in range(rays.start, rays.stop):
                seen[ray] += 1

        with threads_of_torch(threads):
            in_chunks(work, count)
        assert seen == [1] * count and sorted(chunks) == list(range(CHUNKS))


def test_this_thread_works_too() -> None:
    names = []
    with threads_of_torch(1):
        in_parallel(lambda _: names.append(threading.current_thread()), 3)
    assert names == [threading.current_thread()] * 3


@pytest.mark.parametrize("wrong", [0, 3, 9])
def test_an_error_is_raised_when_all_work_has_ended(wrong: int) -> None:
    running = set()

    def work(number: int) -> None:
        running.add(number)
        try:
            if number == wrong:
                raise ZeroDivisionError(number)
        finally:
            running.remove(number)

    with threads_of_torch(2), pytest.raises(ZeroDivisionError):
        in_parallel(work, 10)
    assert not running and torch.get_num_threads() >= 1


def test_an_error_in_another_thread_is_raised_in_this_one() -> None:
    here, both = threading.current_thread(), threading.Barrier(2, timeout=60.0)

    def work(number: int) -> None:
        both.wait()  # so that each thread has one
        if threading.current_thread() is not here:
            raise ZeroDivisionError(number)

    with threads_of_torch(2), pytest.raises(ZeroDivisionError):
        in_parallel(work, 2)
