"""Kill commands at random moments, let the next one go on, and compare with commands that nobody killed.

    python benchmarks/kills.py --kills 100 --seed 0

A chain is a draft design of a small lens, and all commands on it (every third chain: a sweep). Each of
its commands is killed (SIGKILL; every fifth time SIGTERM or SIGINT) at a random moment, or as a random file appears or
changes in its folder, writes included; then it runs again, with ``--resume`` where there is something to resume. At the
end every file must have the bits of an uninterrupted chain; records apart from their computing times, pages and
checkpoints except where two uninterrupted chains differ from each other (times, and hashes of files that state them).
No file may be left over in the folders, and no process may run. The seed of each chain is printed:
``--chain SEED`` runs it again.
"""

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from lensforge import load_spec

SMALL = {  # a search of seconds: the kills are to come everywhere
    "lens.levels": [9, 25],
    "optimise": {"steps_per_level": [100, 100], "rays": 1024, "pixels": 16},
    "evaluate": {"rays": 4096, "pixels": 16},
}
DESIGN = (
    ("design", "lens.toml", "--accuracy", "draft", "--out", "made"),
    ("evaluate", "made", "--rays", "2048"),
    ("export", "made"),
    ("check", "made"),
    ("verify", "made", "--stray"),
    ("photometry", "made", "--rays", "65536"),
    ("sensitivity", "made", "--rays", "1024"),
    ("handover", "made"),
    ("report", "made"),
)
SWEEP = (
    ("sweep", "lens.toml", "--vary", "constraints.max_radius_mm=13.8,14", "--accuracy", "draft", "--out", "made"),
)  # fmt: skip
_EXAMPLE = Path(__file__).parents[1] / "examples" / "quickstart.toml"
_TIMES = ("seconds", "content_sha256")  # computing times, and the checksum that covers them
_WITH_TIMES = (".html", ".bin")  # pages and checkpoints; all other files but records have the same bits every time
# On a page, where two may be alike by chance: its minute, seconds, and what is said where seconds add up to more.
_MOMENT = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d UTC|\b\d+\.\d s\b( \(stages can run side by side\))?")
_LIMIT_SECONDS = 3600.0
_GRACE_SECONDS = 5.0  # within which the children of a killed process must have ended


def default_signals() -> None:
    """Signals as a shell gives them to a command in the foreground; for ``preexec_fn`` of a child process.

    What a shell starts in the background ignores Ctrl-C, with all its children.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@dataclass
class Chain:
    """One chain of commands in a folder of its own, and what was killed in it."""

    place: Path
    commands: tuple[tuple[str, ...], ...]
    kills: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.temporary.mkdir(parents=True)
        load_spec(_EXAMPLE).replace(SMALL).save(self.place / "lens.toml")

    @property
    def made(self) -> Path:
        return self.place / "made"

    @property
    def temporary(self) -> Path:
        return self.place / "tmp"

    def start(self, command: tuple[str, ...]) -> subprocess.Popen[str]:
        environment = {**os.environ, "TMPDIR": str(self.temporary)}
        return subprocess.Popen(
            [sys.executable, "-P", "-m", "lensforge", *command],
            cwd=self.place,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            preexec_fn=default_signals,
        )

    def finish(self, command: tuple[str, ...]) -> float:
        """Run a command to its end and return its seconds."""
        started = time.perf_counter()
        process = self.start(self.again(command))
        _, errors = process.communicate(timeout=_LIMIT_SECONDS)
        if process.returncode not in (0, 1):
            self.failures.append(f"{' '.join(command)}: exit {process.returncode}: {errors[-400:]}")
        return time.perf_counter() - started

    def again(self, command: tuple[str, ...]) -> tuple[str, ...]:
        """The command as a user gives it after a kill: with ``--resume`` where there is something to resume."""
        from lensforge.report import sweep_runs
        from lensforge.search.checkpoint import CHECKPOINT, is_checkpoint

        checks = {"design": lambda made: is_checkpoint(made / CHECKPOINT), "sweep": sweep_runs.resumable}
        check = checks.get(command[0])
        return (*command, "--resume") if check is not None and check(self.made) else command

    def kill(self, command: tuple[str, ...], seconds: float, draw: random.Random) -> None:
        """Start a command and kill it; one that has ended before counts as no kill."""
        number = draw.choice((signal.SIGKILL,) * 8 + (signal.SIGTERM, signal.SIGINT))
        moment, changes = draw.uniform(0.05, 1.0) * seconds, draw.choice((0, draw.randint(1, 25)))
        process = self.start(self.again(command))
        happened = self._wait(process, moment, changes)
        process.send_signal(number)
        _, errors = process.communicate(timeout=_LIMIT_SECONDS)
        if process.returncode in (0, 1):
            return
        if process.returncode not in (-number, 128 + number):
            self.failures.append(f"{' '.join(command)}: exit {process.returncode}: {errors[-400:]}")
        self.kills.append(f"{command[0]} {signal.Signals(number).name} {happened}")
        self._require_no_process()

    def _wait(self, process: subprocess.Popen[str], moment: float, changes: int) -> str:
        """Wait for the moment (s), or for that many changes of files; describe which it was."""
        started, seen, counted = time.perf_counter(), self._listing(), 0
        while process.poll() is None:
            passed = time.perf_counter() - started
            if changes and (now := self._listing()) != seen:
                counted, seen = counted + 1, now
                if counted == changes:
                    return f"at change {changes} of its files, {passed:.2f} s"
            elif not changes and passed > moment:
                return f"at {passed:.2f} s"
            time.sleep(0.0005 if changes else 0.005)
        return "too late"

    def _listing(self) -> set[tuple[str, int]]:
        found = set()
        for folder in (self.made, *self.made.glob("lens-*")):
            try:
                found |= {(entry.path, entry.inode()) for entry in os.scandir(folder)}
            except FileNotFoundError:
                continue
        return found

    def _require_no_process(self) -> None:
        end = time.monotonic() + _GRACE_SECONDS
        while self._processes() and time.monotonic() < end:
            time.sleep(0.05)
        for name in self._processes():
            self.failures.append(f"process left: {name}")

    def _processes(self) -> list[str]:
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                if str(self.temporary).encode() in (entry / "environ").read_bytes():
                    found.append((entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")[:200])
            except OSError:
                continue
        return found

    def files(self) -> dict[str, bytes]:
        """Content of every file of the chain by name, hidden ones, too; those in TMPDIR are the system's."""
        return {
            str(path.relative_to(self.place)): path.read_bytes()
            for path in self.place.rglob("*")
            if path.is_file() and not path.is_relative_to(self.temporary)
        }


def uninterrupted(place: Path, commands: tuple[tuple[str, ...], ...]) -> tuple[Chain, list[float]]:
    """A chain that nobody kills, and the seconds of its commands."""
    chain = Chain(place, commands)
    return chain, [chain.finish(command) for command in commands]


def killed(
    place: Path, seed: int, commands: tuple[tuple[str, ...], ...], seconds: list[float], most: int, of_one: int
) -> Chain:
    """A chain whose commands are killed, each at most ``of_one`` times and ``most`` times in all; then they end."""
    chain, draw = Chain(place, commands), random.Random(seed)
    for command, duration in zip(commands, seconds, strict=True):
        for _ in range(draw.randint(1, of_one)):
            if len(chain.kills) < most:
                chain.kill(command, duration, draw)
        chain.finish(command)
    chain.kills = [f"seed {seed}: {each}" for each in chain.kills]
    return chain


def differences(found: dict[str, bytes], wanted: dict[str, bytes], same_again: dict[str, bytes]) -> list[str]:
    """Files that are missing, left over or other; ``same_again``: those of a second uninterrupted chain."""
    lost = [f"missing: {name}" for name in sorted(set(wanted) - set(found))]
    left = [f"left over: {name}" for name in sorted(set(found) - set(wanted))]
    other = [
        f"other bits: {name}"
        for name in sorted(set(found) & set(wanted))
        if _masked(name, found[name], wanted[name], same_again[name])
        != _masked(name, wanted[name], wanted[name], same_again[name])
    ]
    return lost + left + other


def _masked(name: str, content: bytes, wanted: bytes, same_again: bytes) -> object:
    """``content`` without computing times: by their keys in JSON, elsewhere without the lines that differ anyway."""
    if name.endswith(".json"):
        return _without_times(json.loads(content))
    if wanted == same_again or not name.endswith(_WITH_TIMES):
        return content
    content, wanted, same_again = (_MOMENT.sub(b"", each) for each in (content, wanted, same_again))
    lines, others = content.split(b"\n"), (wanted.split(b"\n"), same_again.split(b"\n"))
    if len({len(lines), len(others[0]), len(others[1])}) > 1:
        return content
    return [line for line, one, two in zip(lines, *others, strict=True) if one == two]


def _without_times(content: object) -> object:
    if isinstance(content, dict):
        return {key: _without_times(value) for key, value in content.items() if key not in _TIMES}
    return [_without_times(value) for value in content] if isinstance(content, list) else content


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--of-one", type=int, default=8, help="kills of one command, at most; then it may end")
    parser.add_argument("--seed", type=int, default=0, help="of the first chain; each further one has the next")
    parser.add_argument("--chain", type=int, help="only the chain of this seed")
    arguments = parser.parse_args()
    kept: list[str] = []
    failed: list[str] = []
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        place, references = Path(name).resolve(), {}
        seed = arguments.seed if arguments.chain is None else arguments.chain
        while len(kept) < arguments.kills:
            kind = SWEEP if seed % 3 == 2 else DESIGN
            if kind not in references:
                one, seconds = uninterrupted(place / f"{kind[0][0]}-1", kind)
                two, _ = uninterrupted(place / f"{kind[0][0]}-2", kind)
                failed += one.failures + two.failures + differences(two.files(), one.files(), two.files())
                references[kind] = one.files(), two.files(), seconds
                print(f"uninterrupted {kind[0][0]}: {sum(seconds):.0f} s", flush=True)
            wanted, again, seconds = references[kind]
            most = arguments.kills - len(kept)
            chain = killed(place / f"killed-{seed}", seed, kind, seconds, most, arguments.of_one)
            problems = chain.failures + differences(chain.files(), wanted, again)
            for line in (*chain.kills, *(f"seed {seed}: FAILED: {problem}" for problem in problems)):
                print(line, flush=True)
            kept, failed, seed = kept + chain.kills, failed + problems, seed + 1
            shutil.rmtree(place / f"killed-{seed - 1}")
            if arguments.chain is not None:
                break
    print(f"{len(kept)} kills in {seed - (arguments.seed if arguments.chain is None else arguments.chain)} chains, "
          f"{len(failed)} failures")  # fmt: skip
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
