"""Work in chunks: every number once, whatever the threads, and an error of one is raised when the others have ended."""

import ast
import threading
from pathlib import Path

import numpy as np
import pytest
import torch

from lensforge.kernels import parallel
from lensforge.kernels.face_records import RingShifts
from lensforge.kernels.parallel import (
    CHUNKS,
    in_chunks,
    in_parallel,
    in_parallel_map,
    in_pieces,
    kernel_threads,
    thread_count,
)
from lensforge.kernels.traced_body import RaysIn
from lensforge.results.arguments import threads_of_torch


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_ray_is_in_one_chunk(threads: int) -> None:
    for count in (0, 1, 7, CHUNKS, 1001):
        seen = [0] * count
        chunks = []

        def work(chunk: int, rays: slice, seen: list[int] = seen, chunks: list[int] = chunks) -> None:
            chunks.append(chunk)
            for ray in range(rays.start, rays.stop):
                seen[ray] += 1

        with threads_of_torch(threads):
            in_chunks(work, count)
        assert seen == [1] * count and sorted(chunks) == list(range(CHUNKS))


@pytest.mark.parametrize(("threads", "count", "pieces"), [
    (1, 10**6, 1), (2, 0, 1), (2, 99, 1), (2, 100, 2), (2, 149, 2), (2, 150, 3), (2, 10**6, CHUNKS), (9, 10**6, CHUNKS),
])  # fmt: skip
def test_every_ray_is_in_one_piece_of_at_least_half_of_what_is_worth_sharing(
    threads: int, count: int, pieces: int
) -> None:
    parts: list[slice] = []
    with kernel_threads(threads):
        in_pieces(parts.append, count, worth=100)
    parts.sort(key=lambda part: part.start)
    assert len(parts) == pieces and [part.stop for part in parts[:-1]] == [part.start for part in parts[1:]]
    assert parts[0].start == 0 and parts[-1].stop == count
    assert pieces == 1 or min(part.stop - part.start for part in parts) >= 50


def test_a_part_of_the_rays_has_their_rows_of_all_that_each_ray_has_of_its_own() -> None:
    """What is common to all rays stays: one index for all, and the tables of faces that scatter by rings."""
    rng = np.random.default_rng(2)
    by_ray = {
        name: rng.random((9, width))
        for name, width in {"origins": 3, "directions": 3, "noise": 4, "fields": 12}.items()
    } | {name: rng.random(9) for name in ("emitted", "indices", "film_rows")}
    by_ray["keys"] = np.arange(9, dtype=np.uint64)
    tables = rng.random((2, 5)), rng.random((2, 4)), rng.random((2, 5, 4)), np.array([1.0, 0.0])
    shifts = RingShifts(rng.random((9, 4)), np.array([[5, 4], [0, 0]]), *tables)
    rays = RaysIn(**by_ray, absorptions=np.array([0.25]), shifts=shifts)
    part = rays.part(slice(4, 7))
    for name, values in by_ray.items():
        np.testing.assert_array_equal(getattr(part, name), values[4:7], err_msg=name)
    assert part.absorptions.tolist() == [0.25] and part.shifts is not None
    np.testing.assert_array_equal(part.shifts.numbers, shifts.numbers[4:7])
    assert all(one is other for one, other in zip(part.shifts[1:], shifts[1:], strict=True))
    assert {*by_ray, "absorptions", "shifts"} == set(RaysIn._fields), "a new field is one of them"


@pytest.mark.parametrize(("count", "names"), [(99, 1), (100, 2)])
def test_few_rays_are_left_to_this_thread(count: int, names: int) -> None:
    both = threading.Barrier(2, timeout=60.0)
    seen = set()

    def work(chunk: int, _: slice) -> None:
        seen.add(threading.current_thread().name)
        if names == 2 and chunk < 2:
            both.wait()  # so that each thread has one

    with kernel_threads(2):
        in_chunks(work, count, worth=100)
    assert len(seen) == names


def test_a_number_of_threads_that_changes_is_asked_for_each_time() -> None:
    free = [2]
    with kernel_threads(lambda: free[0]):
        assert thread_count() == 2
        free[0] = 1
        assert thread_count() == 1
        with kernel_threads(None):
            assert thread_count() == 1


def test_this_thread_works_too() -> None:
    names = []
    with threads_of_torch(1):
        in_parallel(lambda _: names.append(threading.current_thread()), 3)
    assert names == [threading.current_thread()] * 3


@pytest.mark.parametrize("threads", [1, 3])
def test_items_are_mapped_in_their_order_on_no_more_threads_than_the_kernels_may_use(threads: int) -> None:
    names = set()

    def work(item: str) -> str:
        names.add(threading.current_thread().name)
        return 2 * item

    with kernel_threads(threads):
        assert in_parallel_map(work, "crooked") == ["cc", "rr", "oo", "oo", "kk", "ee", "dd"]
        assert in_parallel_map(work, []) == []
    assert len(names) <= threads


def test_no_pool_of_threads_is_as_large_as_the_machine() -> None:
    """Each has one thread, or as many as it is given: ``--threads`` holds for all of them."""
    package = Path(parallel.__file__).parents[1]
    pools = {
        f"{path.relative_to(package)}: {ast.unparse(node)}"
        for path in package.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "ThreadPoolExecutor"
    }
    assert pools and {pool for pool in pools if not pool.endswith(("(1)", "(threads)"))} == set()


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
    here = threading.current_thread()
    both = threading.Barrier(2, timeout=60.0)

    def work(number: int) -> None:
        both.wait()  # so that each thread has one
        if threading.current_thread() is not here:
            raise ZeroDivisionError(number)

    with threads_of_torch(2), pytest.raises(ZeroDivisionError):
        in_parallel(work, 2)
