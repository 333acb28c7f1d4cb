"""One process that reads case after case, limited in memory; what it is at stands in a file that its parent watches."""

import json
import os
import re
import resource
import shutil
import struct
import tempfile
import time
from pathlib import Path

from fuzzing.kind import Files, Kind
from fuzzing.outcome import Outcome, outcome_of

MOST_MIB = 2048  # that one case may take
MOST_SECONDS = 10.0  # of processor time for one case; wall time also counts what else the machine does
_SPARE_MIB = 1024  # above the limit, before the system refuses memory: what takes more is told, not killed
STATE = struct.Struct("<qd")  # the seed, and when its case began (s, system-wide)
_MIB = 2**20
_PEAK = re.compile(r"VmHWM:\s+(\d+) kB")


def work(kind: Kind, first: int, count: int, state: Path, samples: Path | None) -> None:
    """Read ``count`` cases from the seed ``first``; a line of JSON on stdout for each failure, and one at the end."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    with tempfile.TemporaryFile() as printed, tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        os.dup2(printed.fileno(), 1)
        os.dup2(printed.fileno(), 2)
        batch = Batch(kind, Path(scratch), samples, printed.fileno())
        batch.read(kind.original()[0], -1)  # loads all that a case needs, and compiles
        _limit_memory()
        began = _cpu_s()
        with state.open("r+b", buffering=0) as file:
            for seed in range(first, first + count):
                os.pwrite(file.fileno(), STATE.pack(seed, time.time()), 0)
                found = batch.read(kind.case(seed), seed)
                if found.state == "failed":
                    line = {"seed": seed, "message": found.message, "place": found.place}
                    print(json.dumps(line), file=out, flush=True)
                if batch.full:
                    break  # the process goes on with more memory than it began with: another one continues
        print(json.dumps({**batch.summary(), "cpu_s": _cpu_s() - began}), file=out, flush=True)
    out.flush()
    os._exit(0)  # whatever a case has left behind must not delay the next batch


class Batch:
    """Counts, and the slowest and largest case."""

    def __init__(self, kind: Kind, scratch: Path, samples: Path | None, printed: int) -> None:
        self.kind, self.printed = kind, printed
        self.folder, self.samples = scratch / "case", scratch / "samples"
        if kind.in_folder and samples is not None:
            shutil.copytree(samples, self.samples)  # links to these may be made, whatever the disk of the samples
        self.counts = {"accepted": 0, "refused": 0, "failed": 0}
        self.slowest, self.largest = (0.0, -1), (0.0, -1)
        self.first_mib = self.peak_mib = own_peak_mib()
        self.child_mib = children_peak_mib()
        self.full = False

    def read(self, files: Files, seed: int) -> Outcome:
        """Outcome of one case, with what it printed, the time and the memory it took."""
        folder = self._folder(files)
        before = own_peak_mib()  # the making of the case counted: one of 600 MiB takes 2 GiB to write
        started, output = _cpu_s(), os.fstat(self.printed).st_size
        found = outcome_of(self.kind.read, folder)
        seconds, self.peak_mib, child_mib = _cpu_s() - started, own_peak_mib(), children_peak_mib()
        grown = max(self.peak_mib - before, child_mib if child_mib > self.child_mib else 0.0)
        self.child_mib = max(child_mib, self.child_mib)
        if seed < 0:
            self.first_mib = self.peak_mib
            return found
        self.slowest = max(self.slowest, (seconds, seed))
        self.largest = max(self.largest, (grown, seed))
        self.full = self.peak_mib - self.first_mib > MOST_MIB / 2
        if os.fstat(self.printed).st_size > output:
            found = Outcome("failed", f"printed: {self._text(output)!r}", "stdout or stderr")
        if seconds > MOST_SECONDS:
            found = Outcome("failed", f"took {seconds:.0f} s: {found.message[:200]}", "time")
        if grown > MOST_MIB:
            found = Outcome("failed", f"took {grown:.0f} MiB: {found.message[:200]}", "memory")
        self.counts[found.state] += 1
        return found

    def _text(self, start: int) -> str:
        return os.pread(self.printed, 200, start).decode("utf-8", "replace")

    def _folder(self, files: Files) -> Path:
        """A folder with the files of the case alone; of a result folder also all others, as links to the samples."""
        if self.folder.exists():
            _remove(self.folder)
        self.folder.mkdir()
        if self.samples.exists():
            for sample in self.samples.iterdir():
                if sample.name not in files and sample.is_file():
                    os.link(sample, self.folder / sample.name)
        for name, content in files.items():
            (self.folder / name).write_bytes(content)
        return self.folder

    def summary(self) -> dict[str, object]:
        return {**self.counts, "slowest": self.slowest, "largest": self.largest}


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        for inner in path.iterdir():
            _remove(inner)
        path.rmdir()
    else:
        path.unlink()


def own_peak_mib() -> float:
    """Largest resident memory of this process so far.

    Not that of ``getrusage``, which begins with the peak of the process that started this one.
    """
    return float(_PEAK.search(Path("/proc/self/status").read_text()).group(1)) / 1024.0  # type: ignore[union-attr]


def children_peak_mib() -> float:
    """Largest resident memory of a child process that has ended."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0


def _cpu_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _limit_memory() -> None:
    """Refuse memory (data, not mapped files) far beyond the limit, so that a failure does not take the machine."""
    now = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    most = now + (MOST_MIB + _SPARE_MIB) * _MIB
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
