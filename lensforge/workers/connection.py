"""Connection with a Dask cluster: with one that is there, by its address, or with processes of this machine."""

import asyncio
import logging
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

from lensforge.errors import InputError
from lensforge.workers.cluster import Cluster

if TYPE_CHECKING:
    from distributed import Client

_SECONDS = 5.0  # for a scheduler to answer
_LOST_WORKERS = 20  # of one task: a worker that is killed is no fault of the task
_MOST_WORKERS = 1024


@contextmanager
def connected(scheduler: str) -> Iterator[Cluster]:
    """The cluster of ``scheduler``: its address, such as ``tcp://10.0.0.5:8786``, or ``local:4`` for 4 processes here.

    Raises :class:`InputError` without Dask, for an address at which no scheduler answers, and for no address at all.
    """
    count = require_scheduler(scheduler)
    try:
        import dask.config
        from distributed import Client
    except ImportError as error:
        raise InputError(f'scheduler = {scheduler}: needs Dask ({error}); pip install "lensforge[dask]"') from None
    assert Client is not None
    settings = {
        "distributed.scheduler.allowed-failures": _LOST_WORKERS,
        "distributed.comm.timeouts.connect": _SECONDS,
        "distributed.admin.large-graph-warning-threshold": "10GB",  # of ray files, which travel with the first task
    }
    with dask.config.set(settings), _quiet(), _local(count) if count else _remote(scheduler) as client:
        yield Cluster(client, scheduler)


def require_scheduler(scheduler: object) -> int:
    """Number of processes of ``local:N``, 0 for an address. Raises :class:`InputError` for anything else."""
    found = re.fullmatch(r"local:(\d{1,4})", scheduler) if isinstance(scheduler, str) else None
    if found is not None and 1 <= int(found[1]) <= _MOST_WORKERS:
        return int(found[1])
    if isinstance(scheduler, str) and re.fullmatch(r"(tcp|tls|ws|wss)://\S+:\d{1,5}", scheduler):
        return 0
    raise InputError(
        f"scheduler = {str(scheduler)[:60]!r}: address of a Dask scheduler, such as tcp://10.0.0.5:8786, or "
        f"local:N for N processes of this machine, 1 to {_MOST_WORKERS}"
    )


@contextmanager
def _remote(address: str) -> Iterator["Client"]:
    """A client of a cluster that is there."""
    from distributed import Client

    try:
        with ThreadPoolExecutor(1) as pool:  # a loop of its own: a notebook has one running in this thread
            kind = pool.submit(asyncio.run, asyncio.wait_for(_kind(address), _SECONDS)).result()
        if kind != "Scheduler":
            raise OSError(f"it is a {kind}")
        client = Client(address, timeout=_SECONDS, set_as_default=False)
    except Exception as error:  # of sockets, of TLS, of whatever else speaks at that port
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"scheduler = {address}: no Dask scheduler answers ({words[:120]}); `dask scheduler` starts one"
        ) from None
    with client:
        yield client


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
def _local(count: int) -> Iterator["Client"]:
    """A client of ``count`` processes, which end with it; other users of this machine cannot talk to them."""
    from distributed import Client, LocalCluster

    cluster = LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        memory_limit=0,
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # of its page on health; without: 8787, for all to see
        security=True,
        silence_logs=logging.CRITICAL,
    )
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client


@contextmanager
def _quiet() -> Iterator[None]:
    """Only critical messages in Dask's logs: a worker that is lost is replaced, and all else raises an error."""
    logs = [logging.getLogger(name) for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)
