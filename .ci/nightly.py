"""What takes longer than the suite: run step by step, and the last outcome of each kept in build/nightly/outcomes.json.

python .ci/nightly.py                    every step, one after another; a step that fails stops no other
python .ci/nightly.py wheel notebooks    these
python .ci/nightly.py --show             run nothing; print the table of the kept outcomes

The output of a step is in build/nightly. Exit code 1 where a step failed.
"""

import argparse
import datetime
import json
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
LOGS = ROOT / "build" / "nightly"
KEPT = LOGS / "outcomes.json"
sys.path.append(str(ROOT / "benchmarks"))
from result_tables import table  # noqa: E402

_TESTS = ".venv/bin/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder"
# Files whose number of cases grows with LENSFORGE_FUZZ. Ten times as many: a hundred times would take days.
_RANDOM = (
    "tests/extremes tests/cad/test_mesh.py tests/cad/test_base.py tests/made/test_yield_study.py "
    "tests/made/test_sensitivity.py tests/reliability/test_hostile_files.py"
)
STEPS = {
    "lowest": "make lowest",
    "wheel": "make wheel",
    "addons": ".venv/bin/python .ci/without_addons.py",
    "docs": "make docs",
    "notebooks": "make notebooks",
    "verdicts": ".venv/bin/python benchmarks/verdicts.py",
    "random": f"LENSFORGE_FUZZ=10 {_TESTS} -m 'not nightly' {_RANDOM}",
    "slow": f"LENSFORGE_FUZZ=2 {_TESTS}",  # all: other tests have more cases, too, and check the arrays of every call
}
_COUNTS = re.compile(r"^=*\s*((?:\d+ \w+,? ?)+) in [\d.]+s|^(\d+ cases.*)$", re.MULTILINE)


def main() -> int:
    """Run the steps, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steps", nargs="*", metavar="STEP", help=f"of {', '.join(STEPS)}; default: all")
    parser.add_argument("--show", action="store_true", help="run nothing")
    options = parser.parse_args()
    unknown = [name for name in options.steps if name not in STEPS]
    if unknown:
        parser.error(f"no step {unknown[0]!r}; one of {', '.join(STEPS)}")
    failed = 0
    for name in () if options.show else options.steps or STEPS:
        found = outcome_of(name)
        failed += found["outcome"] != "passed"
        print(f"{name}: {found['outcome']}, {found['seconds']} s {found['counts']}", flush=True)
        keep(name, found)
    print(rows())
    return min(failed, 1)


def outcome_of(name: str) -> dict[str, Any]:
    """Run a step: day, commit, seconds, whether it passed, and what it counts."""
    LOGS.mkdir(parents=True, exist_ok=True)
    log, tried, start = LOGS / f"{name}.txt", commit(), time.monotonic()
    with log.open("w", encoding="utf-8") as stream:
        code = subprocess.run(
            ["bash", "-c", STEPS[name]], cwd=ROOT, stdout=stream, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
        ).returncode
    counts = _COUNTS.findall(log.read_text(encoding="utf-8", errors="replace"))
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "commit": tried,
        "seconds": round(time.monotonic() - start),
        "outcome": "passed" if code == 0 else f"failed ({code})",
        "counts": next(filter(None, counts[-1]), "").strip() if counts else "",
    }


def commit() -> str:
    """The commit that is checked out, with a + where files are changed."""
    git = ["git", "-C", str(ROOT)]
    head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, encoding="utf-8", check=True)
    changed = subprocess.run([*git, "status", "--porcelain", "-uno"], capture_output=True)
    return head.stdout.strip() + ("+" if changed.stdout else "")


def keep(name: str, found: dict[str, Any]) -> None:
    """Put an outcome in the place of the earlier one of its step."""
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    kept[name] = found
    written = KEPT.with_suffix(".new")
    written.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    written.replace(KEPT)


def rows() -> str:
    """The table of all steps, in Markdown."""
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    return table([row(name, kept.get(name)) for name in STEPS], ("step", "day", "commit", "time", "outcome", "counted"))


def row(name: str, found: dict[str, Any] | None) -> tuple[str, ...]:
    """A step's row of the table."""
    if found is None:
        return name, "", "", "", "not run yet", ""
    minutes = f"{found['seconds'] / 60:.1f} min"
    return name, found["date"], found["commit"], minutes, found["outcome"], found["counts"]


if __name__ == "__main__":
    sys.exit(main())
