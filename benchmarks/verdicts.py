"""The verdict on every shipped spec, and on lenses that are known to be useless.

python benchmarks/verdicts.py                     the shipped specs, those of publications too, at draft, as a user
                                                  designs them; the last outcome of each is kept in build/verdicts
python benchmarks/verdicts.py pi published/street these
python benchmarks/verdicts.py --show              run nothing; print the table of the kept outcomes
python benchmarks/verdicts.py --useless           the lenses that no customer would accept: calibrates the bounds
python benchmarks/verdicts.py --processes batwing spot reflector
                                                  each of these made by each process, searched for it: can it be made,
                                                  and its light
python benchmarks/verdicts.py --against-none pi text
                                                  each of these as it is made against a study of light, both by a whole
                                                  search: what it loses, and the time of its search by the processor's
python benchmarks/verdicts.py --against-none --drawn 12
                                                  the same of so many of those that are made, drawn by chance

Exit code 1 where a command does not end with 0. A spec whose ray file comes from a vendor and is not
there is named and left out.
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
import json
import random
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np

from lensforge.report.results import Results
from lensforge.search.tool_costs import tool_costs
from lensforge.spec import Accuracy
from lensforge.spec.processes import PROCESSES

sys.path.append(str(Path(__file__).parent))
from result_tables import table

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
FOLDERS = ROOT / "build" / "verdicts"
KEPT = FOLDERS / "outcomes.json"
COLUMNS = ("lens", "NMSE without noise", "share in the target", "efficiency", "light")
AGAINST_NONE = (
    "spec",
    "process",
    "efficiency",
    "as a study",
    "points lost",
    "NMSE",
    "as a study",
    "time of the search",
    "with tool costs",
    "manufacture",
)
_RAYS = 2**19
_SEED = 0
PARTS = ("light", "files", "cutting")


def useless() -> Iterator[tuple[str, lf.Spec]]:
    """Lenses that no customer would accept, each for another reason."""
    pi = lf.load_spec(EXAMPLES / "pi.toml")
    small_lens = {"cavity_radius_mm": 4.6, "max_radius_mm": 8.0}
    yield (
        "6 mm source in an 8 mm lens",
        pi.replace(
            source={"side_mm": 6.0},
            lens={"inner": {"offset_mm": 5.0}, "outer": {"offset_mm": 7.7}},
            constraints=small_lens,
        ),
    )
    yield "a word of three letters", pi.replace(target={"text": "LED"})
    least_mm = pi.constraints.cavity_radius_mm + pi.constraints.min_thickness_mm
    yield (
        "lens of 1.2 x the least size",
        pi.replace(
            lens={"inner": {"offset_mm": 1.8}, "outer": {"offset_mm": 1.18 * least_mm}},
            constraints={"max_radius_mm": 1.2 * least_mm},
        ),
    )
    yield (
        "3 mm COB onto 60 x 40 mm at 500 mm",
        pi.replace(
            source=lf.DiscSource(diameter_mm=3.0),
            lens={"inner": {"offset_mm": 5.0}, "outer": {"offset_mm": 11.7}},
            constraints={"cavity_radius_mm": 2.2, "max_radius_mm": 12.0},
            target=lf.ArrayTarget(np.ones((40, 60)), width_mm=60.0, distance_mm=500.0, receiver_mm=120.0),
        ),
    )


def shipped() -> dict[str, Path]:
    """The shipped specs by name."""
    found = sorted(EXAMPLES.glob("*.toml")) + sorted(EXAMPLES.glob("published/*.toml"))
    return {path.relative_to(EXAMPLES).with_suffix("").as_posix(): path for path in found}


def outcome_of(name: str, path: Path) -> dict[str, Any]:
    """Design a spec as a user does, at draft: exit code, the verdict's three parts, and what was said where not 0."""
    folder = FOLDERS / name
    command = [sys.executable, "-m", "lensforge", "design", str(path), "--accuracy", "draft", "--out", str(folder)]
    ended = subprocess.run([*command, "--quiet"], cwd=ROOT, capture_output=True, encoding="utf-8")
    run = folder / "run.json"
    verdict = json.loads(run.read_text(encoding="utf-8"))["verdict"] if ended.returncode < 2 and run.exists() else {}
    said = ended.stderr.strip().splitlines()
    return {
        "exit": ended.returncode,
        **{part: verdict.get(part, "") for part in PARTS},
        "said": said[-1].replace(f"{folder}: ", "") if ended.returncode and said else "",
    }


def keep(name: str, found: dict[str, Any]) -> None:
    """Put an outcome in the place of the earlier one of its spec."""
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    written = KEPT.with_suffix(".new")
    written.write_text(json.dumps({**kept(), name: found}, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    written.replace(KEPT)


def kept() -> dict[str, Any]:
    """The last outcome of each spec that was run."""
    outcomes: dict[str, Any] = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    return outcomes


def shown(outcomes: dict[str, Any]) -> str:
    """Table of the outcomes, in Markdown, in the order of the shipped specs."""
    known = [(name, outcomes[name]) for name in shipped() if name in outcomes]
    rows = [(name, str(outcome["exit"]), *(outcome[part] for part in PARTS)) for name, outcome in known]
    return table(rows, ("spec", "exit code", *PARTS))


def run_shipped(names: Sequence[str]) -> int:
    """Design each spec; the number of those that do not end with 0."""
    wrong = 0
    for name in names:
        found = outcome_of(name, shipped()[name])
        vendor = found["exit"] == 2 and "no such file" in found["said"]
        if not vendor:
            keep(name, found)
            wrong += found["exit"] != 0
        print(f"{name}: {'left out' if vendor else found['exit']} {found['said']}", flush=True)
    return wrong


def row(name: str, spec: lf.Spec, expected: str, accuracy: Accuracy) -> tuple[str, ...]:
    """The figures on which the verdict on the light rests, and the verdict."""
    design = lf.design(spec, accuracy=accuracy, force=True)
    light = lf.evaluate(design.lens)
    verdict = Results(design.lens, {"design": design, "evaluate": light}).verdict.light
    figures = (light.nmse.value, light.share_in_target.value, light.efficiency.value)
    shown = verdict if verdict == expected else f"**{verdict}**, not {expected}"
    return name, *(f"{figure:.3f}" for figure in figures), shown


def by_process(name: str) -> Iterator[tuple[str, ...]]:
    """A row of a shipped spec for each process: its light, its verdict on manufacture, and the first reason."""
    spec = lf.load_spec(shipped()[name])
    for process in PROCESSES:
        made = lf.design(spec.replace({"manufacture": {"process": process}}), accuracy="draft", force=True)
        light = lf.evaluate(made.lens)
        check = lf.check(lf.build(made.lens))
        verdict = Results(made.lens, {"design": made, "evaluate": light, "check": check}).verdict
        reason = next(iter(verdict.reasons.cutting), "")
        yield name, process, f"{light.efficiency.value:.4f}", f"{light.nmse.value:.4f}", verdict.cutting, reason


class Searched(NamedTuple):
    """Outcome of a whole search: its lens, means over the states, and processor time (s) of search and tool costs."""

    design: lf.Design
    efficiency: float
    nmse: float | None
    seconds: float
    seconds_of_costs: float

    @staticmethod
    def of(spec: lf.Spec) -> "Searched":
        """Search at draft accuracy."""
        began = time.process_time()
        design = lf.design(spec, accuracy="draft", force=True)
        searched = time.process_time()
        tool_costs(design)
        ended = time.process_time()
        lights = [case.result for case in lf.evaluate(design.lens, rays=_RAYS).cases()]
        errors = [light.nmse.value for light in lights if light.nmse is not None]
        nmse = fmean(errors) if errors else None
        efficiency = fmean(light.efficiency.value for light in lights)
        return Searched(design, efficiency, nmse, searched - began, ended - searched)


def against_none(name: str) -> tuple[str, ...]:
    """A row of a shipped spec as it is made against a study of light; searches go on for as long as they gain."""
    spec = lf.load_spec(shipped()[name]).replace({"optimise.seconds": None})
    made, free = Searched.of(spec), Searched.of(spec.made_by("none"))
    results = {"design": made.design, "check": lf.check(lf.build(made.design.lens))}
    lost = 100.0 * (free.efficiency - made.efficiency)
    errors = ("–", "–") if made.nmse is None or free.nmse is None else (f"{made.nmse:.4f}", f"{free.nmse:.4f}")
    times = made.seconds / free.seconds, (made.seconds + made.seconds_of_costs) / free.seconds
    verdict = Results(made.design.lens, results).verdict.cutting
    return (
        name,
        str(spec.manufacture.process),
        f"{made.efficiency:.4f}",
        f"{free.efficiency:.4f}",
        f"{lost:.1f}",
        *errors,
        *(f"{ratio:.2f}" for ratio in times),
        verdict,
    )


def drawn(count: int) -> list[str]:
    """Shipped specs that are cut or moulded, drawn by chance."""
    made = [name for name, path in shipped().items() if lf.load_spec(path).manufacture.cuts]
    return sorted(random.Random(_SEED).sample(made, count))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="shipped specs; default: all")
    parser.add_argument("--show", action="store_true", help="run nothing")
    parser.add_argument("--useless", action="store_true", help="the lenses that no customer would accept")
    parser.add_argument("--processes", action="store_true", help="each of the named specs by each process")
    parser.add_argument("--against-none", action="store_true", help="each against a study of light, by whole searches")
    parser.add_argument("--drawn", type=int, metavar="N", help="so many of those that are made, drawn by chance")
    options = parser.parse_args()
    if options.useless:
        print(table([row(name, spec, "fail", "draft") for name, spec in useless()], COLUMNS))
        return 0
    if options.against_none:
        rows = []
        lf.design(lf.load_spec(shipped()["quickstart"]), accuracy="draft")  # loads all kernels before times are taken
        for name in drawn(options.drawn) if options.drawn else options.names:
            try:
                rows.append(against_none(name))
            except lf.InputError as error:  # the ray file of a vendor that is not there
                print(f"{name}: left out: {error}", file=sys.stderr, flush=True)
                continue
            print(rows[-1], file=sys.stderr, flush=True)
        print(table(rows, AGAINST_NONE))
        return 0
    if options.processes:
        rows = [row for name in options.names for row in by_process(name)]
        print(table(rows, ("spec", "process", "efficiency", "NMSE", "manufacture", "reason")))
        return 0
    if unknown := [name for name in options.names if name not in shipped()]:
        parser.error(f"no shipped spec {unknown[0]!r}; one of {', '.join(shipped())}")
    wrong = 0 if options.show else run_shipped(options.names or list(shipped()))
    print(shown(kept()))
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main())
