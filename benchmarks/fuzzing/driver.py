"""Batches of cases in worker processes, watched: a case that hangs is killed, one that ends its process is counted."""

import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from fuzzing.kind import Kind
from fuzzing.worker import MOST_SECONDS, STATE

_PATIENCE = 6.0  # times the limit in wall time, before a case counts as hanging: the machine has other work
_POLL_S = 0.2
_BATCH = 20_000  # cases of one process: its start takes seconds
_FOREIGN_BATCH = 500
_START_S = 600.0  # to import, and to compile, where the cache is empty


@dataclass
class Tally:
    """The outcomes of a kind so far."""

    kind: str
    accepted: int = 0
    refused: int = 0
    failures: list[dict[str, object]] = field(default_factory=list)
    slowest: tuple[float, int] = (0.0, -1)
    largest: tuple[float, int] = (0.0, -1)
    cpu_s: float = 0.0

    @property
    def cases(self) -> int:
        return self.accepted + self.refused + len(self.failures)

    def places(self) -> Counter[str]:
        """How many failures came up at each place."""
        return Counter(map(named, self.failures))

    def row(self) -> dict[str, object]:
        return {
            "kind": self.kind, "cases": self.cases, "accepted": self.accepted, "refused": self.refused,
            "failed": len(self.failures), "slowest_s": round(self.slowest[0], 2), "slowest_seed": self.slowest[1],
            "most_mib": round(self.largest[0]), "most_seed": self.largest[1],
            "cpu_ms_per_case": round(1e3 * self.cpu_s / max(self.cases, 1), 2),
        }  # fmt: skip


def named(failure: dict[str, object]) -> str:
    """Where a failure came up, and of which sort it is: failures of the same name have one cause."""
    return f"{failure['place']}: {str(failure['message']).partition(':')[0][:90]}"


def run(
    kinds: Sequence[Kind], counts: Sequence[int], first: int, workers: int, command: Sequence[str]
) -> Iterator[Tally]:
    """Run ``counts`` cases of each kind from the seed ``first`` on, and yield each kind as it ends.

    ``command`` starts a worker.
    """
    with ThreadPoolExecutor(workers) as pool:
        jobs = [pool.submit(_run_kind, kind, count, first, command) for kind, count in zip(kinds, counts, strict=True)]
        for job in as_completed(jobs):
            yield job.result()


def _run_kind(kind: Kind, count: int, first: int, command: Sequence[str]) -> Tally:
    tally, seed, end = Tally(kind.name), first, first + count
    batch = _FOREIGN_BATCH if kind.foreign else _BATCH
    while seed < end:
        seed = _run_batch(tally, seed, min(batch, end - seed), command)
    return tally


def _run_batch(tally: Tally, first: int, count: int, command: Sequence[str]) -> int:
    """Run one process; the seed from which the next one continues."""
    with tempfile.TemporaryDirectory(prefix="fuzz-state-") as folder:
        state, lines = Path(folder) / "state", Path(folder) / "lines"
        state.write_bytes(STATE.pack(first - 1, time.time() + _START_S))
        with lines.open("wb") as out:
            options = ["--worker", tally.kind, "--seed", str(first), "--cases", str(count), "--state", str(state)]
            process = subprocess.Popen([*command, *options], stdout=out)
            hung = _watch(process, state)
        seed, _ = STATE.unpack(state.read_bytes())
        found = [json.loads(line) for line in lines.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    tally.failures += [each for each in found if "seed" in each]
    summary = next((each for each in found if "accepted" in each), None)
    if summary is None:  # the process did not live to its end: the case at hand ended it
        if seed < first:
            reason = f"did not start ({process.returncode}), or did not read its unchanged file"
            tally.failures.append({"seed": first, "message": reason, "place": "process"})
            return first + count
        reason = f"hung for {MOST_SECONDS * _PATIENCE:.0f} s" if hung else f"ended the process ({process.returncode})"
        tally.failures.append({"seed": seed, "message": reason, "place": "process"})
        tally.refused += max(seed - first - sum("seed" in each for each in found), 0)  # not told apart any more
        return max(seed, first) + 1
    tally.accepted += summary["accepted"]
    tally.refused += summary["refused"]
    tally.cpu_s += summary["cpu_s"]
    tally.slowest = max(tally.slowest, tuple(summary["slowest"]))
    tally.largest = max(tally.largest, tuple(summary["largest"]))
    return int(seed) + 1


def _watch(process: subprocess.Popen[bytes], state: Path) -> bool:
    """Wait for the end of ``process``; kill it, and return True, where one case takes too long."""
    while process.poll() is None:
        time.sleep(_POLL_S)
        _, began = STATE.unpack(state.read_bytes())
        if time.time() - began > MOST_SECONDS * _PATIENCE:
            process.kill()
            process.wait()
            return True
    return False


def python_command(script: str) -> list[str]:
    """The command that runs ``script`` at the lowest priority."""
    return ["nice", "-n", "19", sys.executable, script]
