"""A function mapped over many items by the workers of a Dask cluster.

What a task returns depends on its item and on what all items share alone, never on the worker or the order: the results
have the same bits on one worker and on many, and after a worker was lost, whose tasks another one repeats.
"""

import platform
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

from lensforge.errors import InputError, LensforgeError
from lensforge.optimisation.checkpoint import made_by

if TYPE_CHECKING:
    from distributed import Client, Future

_Shared = TypeVar("_Shared")
_Item = TypeVar("_Item")
_Found = TypeVar("_Found")

_GOES_ON = "what was computed is kept where the command keeps it; the same command goes on from there"


class Cluster:
    """Workers that a client reaches; ``address``: of their scheduler, for messages."""

    def __init__(self, client: "Client", address: str) -> None:
        self._client, self._address = client, address
        self._sent: tuple[object, Future[Any]] | None = None

    def map(
        self, function: Callable[[_Shared, _Item], _Found], shared: _Shared, items: Sequence[_Item]
    ) -> Iterator[tuple[int, _Found]]:
        """``function(shared, item)`` of every item, as they are done: the number of the item, and what was returned.

        ``function`` is one of a module; ``shared`` travels once, and from worker to worker. Raises :class:`InputError`
        where the scheduler is lost, or a worker has other versions than this process.
        """
        from distributed import as_completed

        client = self._client
        futures = client.map(_task, items, function=function, shared=self._at_workers(shared), ours=versions())
        numbers = {future.key: number for number, future in enumerate(futures)}
        try:
            for future in as_completed(futures, loop=client.loop):
                yield numbers[future.key], self._result(future)
        finally:
            if client.status == "running":
                client.cancel([future for future in futures if not future.done()])

    def _at_workers(self, shared: object) -> "Future[Any]":
        """``shared`` as the result of a task: the scheduler can make it anew where the worker that held it is lost."""
        if self._sent is None or self._sent[0] is not shared:
            self._sent = shared, self._client.submit(_kept, shared, pure=False)
        return self._sent[1]

    def _result(self, future: "Future[Any]") -> Any:
        """Result of a task that has ended; errors of the cluster as one line."""
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        try:
            return future.result()
        except LensforgeError:
            raise
        except KilledWorker as error:
            raise InputError(
                f"scheduler = {self._address}: a task ended {len(error.args)} workers, out of memory?; {_GOES_ON}"
            ) from None
        except CancelledError:
            raise InputError(f"scheduler = {self._address}: has ended or is out of reach; {_GOES_ON}") from None
        except (ImportError, AttributeError) as error:  # unless it is a bug, our own module is not there
            raise InputError(
                f"scheduler = {self._address}: a worker cannot run lensforge {versions()['lensforge']} ({error}); "
                "install the same version there"
            ) from error


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions in this process of all that decides the bits of a result."""
    return {"python": platform.python_version().rpartition(".")[0], **made_by()}


def _kept(shared: object) -> object:
    """Keep what all items share in the memory of a worker."""
    return shared


def _task(item: _Item, function: Callable[[_Shared, _Item], _Found], shared: _Shared, ours: dict[str, str]) -> _Found:
    """One item, in a worker: a thread of its own and no more, as there are others beside it."""
    import torch
    from distributed import get_worker

    for name, version in versions().items():
        if ours.get(name) != version:
            raise InputError(
                f"worker {get_worker().address}: {name} {version}, here is {ours.get(name)}, which may round "
                "differently; install the same version there"
            )
    torch.set_num_threads(1)
    return function(shared, item)
