"""Share of single bugs (mutants) that the tests notice.

    pip install cosmic-ray                            # 8.7.0, which changes the source; lensforge does not need it
    python benchmarks/mutants.py --count 200 --seed 0
    python benchmarks/mutants.py --count 300          # goes on: the next hundred of the same draw
    python benchmarks/mutants.py --again              # those that survived, after tests were written
    python benchmarks/mutants.py --modules light/exit_light.py --count 50 --out cad_out/sphere.json

A mutant is one change of one place: + for -, < for <=, 2 for 3, a condition turned round. They are drawn from all that
cosmic-ray finds in the modules of mutation/own_tests.py, so that any number of them has of each module its share. The
tests of the module, which that table names, run in a copy of the checkout until one fails, or for three times the
processor time that they take without a bug. Outcomes are kept in build/mutants.json, and those of earlier runs counted.
mutation/equivalent.json has the survivors that are no bugs, with reasons.
Compiled kernels are not changed, and stay compiled: the modules drawn from have none.
"""

import argparse
from pathlib import Path

FOLDER = Path(__file__).parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="mutants in all, those of earlier runs among them")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--modules", nargs="*", default=[], help="such as targets or light/exit_light.py; default: all")
    parser.add_argument("--again", action="store_true", help="draw none; try those again that survived")
    parser.add_argument("--out", type=Path, default=FOLDER / "build" / "mutants.json", help="the file of outcomes")
    parser.add_argument("--copy", type=Path, default=FOLDER / "build" / "mutants", help="where the checkout is copied")
    options = parser.parse_args()
    from mutation import draw, kept, own_tests, trial

    modules = [name for name in own_tests.modules() if name.startswith(tuple(options.modules) or "")]
    record = kept.Record.load(options.out, options.seed)
    every = [draw.mutants_of(FOLDER / "lensforge", module) for module in modules]
    record.possible |= {module: len(mutants) for module, mutants in zip(modules, every, strict=True)}
    order = {mutant.key: mutant for mutant in draw.drawn(every, options.seed)}
    trial.copy_checkout(options.copy)
    trial.import_libraries()
    if options.again:
        left = [key for key, each in record.outcomes.items() if each.now == "passed"]
        chosen = [order[key] for key in left if key in order and key not in kept.equivalent()]
    else:
        missing = max(0, options.count - sum(key in record.outcomes for key in order))
        chosen = [mutant for key, mutant in order.items() if key not in record.outcomes][:missing]
    for number, mutant in enumerate(chosen, start=1):
        outcome = tried(mutant, record, options.copy)
        if outcome is not None:
            record.outcomes[mutant.key] = outcome
            change = f"\n  - {outcome.old}\n  + {outcome.new}" if outcome.now == "passed" else ""
            where = f"{outcome.place}:{mutant.line}"
            print(f"{number}/{len(chosen)} {outcome.now}: {where} {outcome.seconds:.0f} s{change}", flush=True)
        record.save()
    print(kept.table(record), *kept.survivors(record, order), sep="\n")
    for key in kept.stale(FOLDER / "lensforge"):
        print(f"equivalent.json: its line is gone: {key}")


def tried(mutant, record, copy: Path):
    """The outcome of a mutant's tests; None where the changed source is no program, or the machine had no time."""
    from mutation import draw, kept, own_tests, trial

    tests = own_tests.files_of(mutant.module)
    source = (copy / "lensforge" / mutant.module).read_text(encoding="utf-8")
    changed = draw.mutated(source, mutant)
    if changed is None:
        return None
    _try_without_bug(tests, record, copy)
    _, old, new = next(iter(draw.changed_lines(source, changed)))
    with trial.bug(copy, mutant.module, changed):
        limit = 3.0 * sum(record.without_bug[name] for name in tests) + 10.0
        now, seconds = trial.run_tests(copy, tests, limit, keep_bytecode=False)
    if now.startswith("pytest"):
        raise SystemExit(f"{mutant.key}: {now}; see {copy}/build/pytest.txt")
    if now == "stalled":
        print(f"stalled, to be tried again: {mutant.key}", flush=True)
        return None
    earlier = record.outcomes.get(mutant.key)
    first = earlier.first if earlier else now
    return kept.Outcome(mutant.key, mutant.module, old, new, first, now, round(seconds, 1))


def _try_without_bug(tests: tuple[str, ...], record, copy: Path) -> None:
    """Seconds of each file of tests without a bug, measured once; none of them may fail."""
    from mutation import trial

    for name in tests:
        if name not in record.without_bug:
            ended, seconds = trial.run_tests(copy, (name,), 600.0, keep_bytecode=True)
            if ended != "passed":
                raise SystemExit(f"without a bug: {ended}: tests/{name}.py; see {copy}/build/pytest.txt")
            record.without_bug[name] = round(seconds, 1)
            record.save()


if __name__ == "__main__":
    main()
