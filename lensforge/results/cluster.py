"""Workers of this machine, or of a Dask cluster on many, and a function mapped over many items by them.

What a task returns depends on its item and on what all items share alone, never on the worker or the order: the results
have the same bits on one worker and on many, and after a worker was lost, whose tasks another one repeats.
"""

import asyncio
import logging
import platform
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, runtime_checkable

from lensforge.errors import InputError, LensforgeError, refused
from lensforge.results.child_pool import IN_TURN, child_pool
from lensforge.version import made_by

if TYPE_CHECKING:
    from distributed import Client, Future


_Shared = TypeVar("_Shared")
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_GOES_ON = "what was computed is kept where the command keeps it; the same command goes on from there"


@runtime_checkable
class WorkerPool(Protocol):
    """Child processes or a cluster that map a function over items."""

    def map(
        self, function: Callable[[_Shared, _Item], _Result], shared: _Shared, items: Sequence[_Item]
    ) -> Iterator[tuple[int, _Result]]:
        """``function(shared, item)`` for every item, in order of completion: number of the item, and result."""
        ...


class Cluster:
    """Workers of a Dask client; ``address``: of their scheduler, for messages."""

    def __init__(self, client: "Client", address: str) -> None:
        self._client = client
        self._address = address
        self._sent: tuple[object, Future[Any]] | None = None

    def map(
        self, function: Callable[[_Shared, _Item], _Result], shared: _Shared, items: Sequence[_Item]
    ) -> Iterator[tuple[int, _Result]]:
        """``function(shared, item)`` for every item, in order of completion: number of the item, and result.

        ``function`` is one of a module; ``shared`` travels once, and from worker to worker. Raises :class:`InputError`
        if the scheduler is lost, or a worker has other versions than this process.
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
        """``shared`` as the result of a task: the scheduler can recreate it if the worker that held it is lost."""
        if self._sent is None or self._sent[0] is not shared:
            self._sent = shared, self._client.submit(_held_by_worker, shared, pure=False)
        return self._sent[1]

    def _result(self, future: "Future[Any]") -> Any:
        """Result of a finished task; errors of the cluster as one line."""
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
    """Versions in this process that determine the bits of a result."""
    return {"python": platform.python_version().rpartition(".")[0], **made_by()}


def _held_by_worker(shared: object) -> object:
    """``shared``, which Dask thereby holds in a worker's memory."""
    return shared


def _task(item: _Item, function: Callable[[_Shared, _Item], _Result], shared: _Shared, ours: dict[str, str]) -> _Result:
    """One item, in a worker: on a single thread, as there are other workers beside it."""
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


_SECONDS = 5.0  # for a scheduler to answer
_LOST_WORKERS = 20  # of one task: a worker that is killed is no fault of the task
_MOST_WORKERS = 1024


@contextmanager
def connected(scheduler: str | None) -> Iterator[WorkerPool]:
    """The workers of ``scheduler``: its address, such as ``tcp://10.0.0.5:8786``, or ``local:4`` for 4 processes here.

    None: this process alone. Raises :class:`InputError` if the processes do not start, if an address is given without
    Dask, if no scheduler answers there, and for a malformed address.
    """
    if scheduler is None:
        yield IN_TURN
        return
    count = require_scheduler(scheduler)
    if count == 0:
        with _connected_by_dask(scheduler) as cluster:
            yield cluster
        return
    with child_pool(count) as pool:
        if not pool.runs:
            raise InputError(f"scheduler = {scheduler}: its processes do not start; try again, or with fewer")
        yield pool


def require_scheduler(scheduler: object) -> int:
    """Number of processes of ``local:N``, 0 for an address. Raises :class:`InputError` for anything else."""
    local = re.fullmatch(r"local:(\d{1,4})", scheduler) if isinstance(scheduler, str) else None
    if local is not None and 1 <= int(local[1]) <= _MOST_WORKERS:
        return int(local[1])
    if isinstance(scheduler, str) and re.fullmatch(r"(tcp|tls|ws|wss)://\S+:\d{1,5}", scheduler):
        return 0
    raise InputError(
        f"scheduler = {str(scheduler)[:60]!r}: address of a Dask scheduler, such as tcp://10.0.0.5:8786, or "
        f"local:N for N processes of this machine, 1 to {_MOST_WORKERS}"
    )


@contextmanager
def _connected_by_dask(address: str) -> Iterator[Cluster]:
    with refused(f"scheduler = {address}", 'needs Dask (…); pip install "lensforge[dask]"', ImportError):
        import dask.config
        from distributed import Client
    settings = {
        "distributed.scheduler.allowed-failures": _LOST_WORKERS,
        "distributed.comm.timeouts.connect": _SECONDS,
        "distributed.admin.large-graph-warning-threshold": "10GB",  # of ray files, which travel with the first task
    }
    with dask.config.set(settings), _quiet():
        try:
            with ThreadPoolExecutor(1) as pool:  # a loop of its own: a notebook has one running in this thread
                kind = pool.submit(asyncio.run, asyncio.wait_for(_kind(address), _SECONDS)).result()
            if kind != "Scheduler":
                raise OSError(f"it is a {kind}")
            client = Client(address, timeout=_SECONDS, set_as_default=False)
        except Exception as error:  # of sockets, of TLS, of whatever else speaks at that port
            first = (str(error).splitlines() or [type(error).__name__])[0][:120]
            fault = f"no Dask scheduler answers ({first}); `dask scheduler` starts one"
            raise InputError(f"scheduler = {address}: {fault}") from None
        with client:
            yield Cluster(client, address)


async def _kind(address: str) -> str:
    """Kind of server at ``address``; a client would wait without end for one that keeps silent."""
    from distributed import Security
    from distributed.comm.core import connect

    comm = await connect(address, timeout=_SECONDS, **Security().get_connection_args("client"))
    try:
        await comm.write({"op": "identity", "reply": True})
        return str((await comm.read())["type"])
    finally:
        comm.abort()


@contextmanager
def _quiet() -> Iterator[None]:
    """Only critical messages in Dask's logs: a lost worker is replaced, and all else raises an error."""
    logs = [logging.getLogger(name) for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)
