"""Fuzz everything that lensforge reads, and tell what was neither read nor refused in one line.

python benchmarks/fuzz.py                                    every kind, a thousand cases in all
python benchmarks/fuzz.py --cases 1000000 --foreign 10000    the figures of docs/reliability.md
python benchmarks/fuzz.py --kind ldt --seed 123              one case again; --keep DIR writes its files
python benchmarks/fuzz.py --kind ldt png --cases 5000        some kinds, as many cases of each
python benchmarks/fuzz.py --kind ldt --seed 123 --remember "RuntimeWarning: overflow"   keep it for the tests

A failure is printed with the command that repeats it. Records of a result folder are those of a small draft, which is
made once in --folder (a minute), or of a folder given there.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "cad_out" / "fuzz_folder"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", nargs="*", default=[], help="kinds of file; default: all")
    parser.add_argument(
        "--seed", type=int, default=0, help="the first seed, or with --kind and no --cases the only one"
    )
    parser.add_argument("--cases", type=int, help="of all kinds that are read in process, or with --kind of each")
    parser.add_argument("--foreign", type=int, help="cases of all kinds that are parsed by libraries of others")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="result folder whose files are changed")
    parser.add_argument("--keep", type=Path, help="write the files of the one case to this folder")
    parser.add_argument("--remember", help="keep the one case for the tests, with these words on its failure")
    parser.add_argument("--json", type=Path, help="write the outcomes to this file")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--state", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()

    from fuzzing.samples import use_folder

    use_folder(options.folder, options.worker is None)
    from fuzzing.kinds import chosen, counts_of, kind_named

    if options.worker:
        from fuzzing.worker import work

        work(kind_named(options.worker), options.seed, options.cases, options.state, options.folder)
    kinds = chosen(options.kind)
    if options.remember:
        from fuzzing.kept import keep

        keep(kinds[0].name, options.seed, options.remember)
    if options.kind and options.cases is None:
        return max(one_case(kind.name, options.seed, options.folder, options.keep) for kind in kinds)
    if options.kind:
        counts = [options.cases] * len(kinds)
    else:
        counts = counts_of(kinds, options.cases or 1000, 100 if options.foreign is None else options.foreign)
    return report(kinds, counts, options)


def one_case(name: str, seed: int, folder: Path, keep: Path | None) -> int:
    """Read one case here, and print its outcome."""
    from fuzzing.kinds import kind_named
    from fuzzing.outcome import outcome_of

    kind = kind_named(name)
    files = kind.case(seed)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        where = Path(scratch) if keep is None else keep
        where.mkdir(parents=True, exist_ok=True)
        others = [path for path in folder.iterdir() if path.is_file()] if kind.in_folder else []
        for path in others:
            (where / path.name).write_bytes(path.read_bytes())
        for file, content in files.items():
            (where / file).write_bytes(content)
        found = outcome_of(kind.read, where)
    print(f"{name} {seed}: {found.state} {found.place}\n{found.message}")
    return int(found.state == "failed")


def report(kinds: list, counts: list[int], options: argparse.Namespace) -> int:  # type: ignore[type-arg]
    from fuzzing.driver import named, python_command, run

    columns = ("kind", "cases", "accepted", "refused", "failed", "slowest_s", "most_mib", "cpu_ms_per_case")
    print("| " + " | ".join(columns) + " |\n|" + "---|" * len(columns), flush=True)
    tallies = []
    command = [*python_command(__file__), "--folder", str(options.folder)]
    for tally in run(kinds, counts, options.seed, options.workers, command):
        row = tally.row()
        print("| " + " | ".join(str(row[name]) for name in columns) + " |", flush=True)
        for place, count in tally.places().most_common():
            first = next(failure for failure in tally.failures if named(failure) == place)
            print(f"    {count} x {place}: {str(first['message']).partition(':')[2][:150]!r}")
            print(f"      python benchmarks/fuzz.py --kind {tally.kind} --seed {first['seed']}", flush=True)
        tallies.append(tally)
        if options.json:
            content = [{**each.row(), "failures": each.failures} for each in tallies]
            options.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    failed = sum(len(tally.failures) for tally in tallies)
    print(f"{sum(tally.cases for tally in tallies)} cases, {failed} failed", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
