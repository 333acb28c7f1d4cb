"""Parts measured by real processes of a Dask cluster: the same bits on one, on four, and after one was killed."""

import multiprocessing
import os
import re
import signal
import socket
import sys
import time
from multiprocessing import forkserver

import pytest
from parts import lens_with
from presets import FEW_STEPS
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.results.cluster import connected, require_scheduler, versions

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster():
    """One process at first; a test may ask for more.

    Workers are forked from a process that has loaded the modules they need: loading takes seconds.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["distributed", "lensforge.made.measured_parts", "lensforge.search.searches"])
    forkserver.ensure_running()
    with (
        dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as workers,
    ):
        yield workers


@pytest.fixture
def short(monkeypatch):
    """Tasks of one part."""
    monkeypatch.setattr("lensforge.made.measured_parts._CHUNK", 1)


def study(**others):
    result = lf.tolerance(lens_with(), parts=40, rays=2**10, budget=False, **others)
    return result.model_copy(update={"seconds": 0.0})


def one_killed(cluster):
    """A function for ``progress`` that kills a worker when the first part is there."""
    killed = []

    def progress(done, expected):
        if not killed:
            assert done < expected
            with distributed.Client(cluster) as client:
                killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    return progress, killed


@pytest.mark.nightly("workers that are killed")
def test_one_worker_four_and_one_killed_give_the_bits_of_this_process(cluster, short):
    here = study()
    address = cluster.scheduler_address
    assert study(scheduler=address) == here
    cluster.scale(4)
    cluster.wait_for_workers(4)
    assert study(scheduler=address) == here
    progress, killed = one_killed(cluster)
    assert study(scheduler=address, progress=progress) == here
    assert len(killed) == 1


def test_searches_from_several_starts_have_the_bits_of_this_process(cluster):
    spec = small_spec(optimise__steps_per_level=[1, 1])
    here = lf.best_design(spec, starts=2, accuracy=FEW_STEPS)
    there = lf.best_design(spec, starts=2, accuracy=FEW_STEPS, scheduler=cluster.scheduler_address)
    assert there.lens == here.lens
    assert [(start.nmse, start.missed) for start in there.starts] == [
        (start.nmse, start.missed) for start in here.starts
    ]


def test_a_worker_with_other_versions_is_named_in_one_line(cluster, short, monkeypatch):
    other = {**versions(), "numba": "0.1"}
    monkeypatch.setattr("lensforge.results.cluster.versions", lambda: other)
    with pytest.raises(InputError, match=r"worker tcp://.*: numba .*, here is 0\.1, which may round differently"):
        study(scheduler=cluster.scheduler_address)


@pytest.mark.nightly("a scheduler that is killed")
def test_parts_that_were_measured_outlive_a_lost_scheduler(short, tmp_path, monkeypatch):
    monkeypatch.setattr("lensforge.made.measured_parts._SAVE_SECONDS", 0.0)
    kept = tmp_path / "parts.npz"
    lost = distributed.LocalCluster(
        n_workers=1, processes=False, protocol="tcp", dashboard_address=":0", silence_logs=50
    )

    def progress(done, expected):
        if lost.status.name == "running":
            lost.close()

    with pytest.raises(InputError, match=r"has ended or is out of reach; .* the same command goes on"):
        study(scheduler=lost.scheduler_address, checkpoint=kept, progress=progress)
    assert kept.exists()
    again: list[int] = []
    assert study(checkpoint=kept, progress=lambda done, _: again.append(done)) == study()
    assert again[0] > 1


def answering_otherwise():
    """A server that is no scheduler."""
    server = socket.create_server(("127.0.0.1", 0))
    return server, f"tcp://127.0.0.1:{server.getsockname()[1]}"


def test_what_does_not_answer_as_a_scheduler_is_refused_within_seconds(monkeypatch):
    monkeypatch.setattr("lensforge.results.cluster._SECONDS", 1.0)
    server, address = answering_otherwise()
    with server:
        started = time.monotonic()
        with (
            pytest.raises(InputError, match=f"scheduler = {re.escape(address)}: no Dask scheduler"),
            connected(address),
        ):
            pass
    with pytest.raises(InputError, match="no Dask scheduler") as error, connected(address):
        pass
    assert time.monotonic() - started < 15.0
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("given", ["", "here", "local:0", "local:", "http://a:1", "tcp://a", "local:99999", 4])
def test_what_is_no_address_is_refused_at_once(given):
    with pytest.raises(InputError, match="address of a Dask scheduler"):
        require_scheduler(given)


def test_without_dask_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r'needs Dask .*; pip install "lensforge\[dask\]"'),
        connected("tcp://10.0.0.5:8786"),
    ):
        pass
