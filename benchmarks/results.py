"""The paper's designs, repeated: their figures go to docs/figures.json, from which docs/validation.md takes its tables.

python benchmarks/results.py cad_out/flat_top cad_out/pi --store       # of finished result folders
python benchmarks/results.py examples/flat_top.toml --store            # design, evaluation and export alone
python benchmarks/results.py --fill                                    # the tables of the pages again, from the file
"""

import argparse
import datetime
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from result_tables import fill, row, stated, table

import lensforge as lf

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures.json"


def shown(metric: lf.Metric | None, digits: int) -> str:
    """A metric with its standard error, as the tables of the pages have it."""
    return stated(_metric(metric), digits)


def _metric(metric: lf.Metric | None) -> dict[str, float | None] | None:
    return None if metric is None else {"value": metric.value, "standard_error": metric.standard_error}


def record(
    design: lf.Design, light: lf.Light, part: lf.Part, proof: lf.Proof | None = None, check: lf.Check | None = None
) -> dict[str, Any]:
    """Figures of one design, unrounded; those of stages that were not run are None."""
    return {
        "uniformity": _metric(light.uniformity),
        "efficiency": _metric(light.efficiency),
        "nmse": _metric(light.nmse),
        "possible_efficiency": light.possible.efficiency,
        "max_radius_mm": design.max_radius_mm,
        "height_mm": design.height_mm,
        "functions": design.lens.basis.size,
        "steps": design.steps,
        "search_s": design.seconds,
        "form_error_nm": part.form_error_nm.max,
        "normal_error_mrad": part.normal_error_mrad.max,
        "deviation_mm": proof.deviation_mm.rms if proof else None,
        "min_wall_mm": check.min_wall_mm if check else None,
    }


def measured(path: Path, accuracy: str, threads: int | None = None) -> tuple[str, dict[str, Any]]:
    """Command and figures of a spec that is designed now, or of a folder that a command has written."""
    if path.is_dir():
        run = lf.load(path)
        command = f"lensforge design examples/{run.spec.name}.toml"
        return command, record(run.design, run.light, run.part, run.proof, run.check)
    design = lf.design(lf.load_spec(path), accuracy=accuracy, threads=threads)
    name = path.relative_to(ROOT) if path.is_absolute() else path
    command = f"python benchmarks/results.py {name} --store"
    if accuracy != "standard":
        command += f" --accuracy {accuracy}"
    return command, record(design, lf.evaluate(design.lens, threads=threads), lf.build(design.lens))


def store(name: str, command: str, found: dict[str, Any], *, accuracy: str, beside: bool) -> None:
    """Put the figures of one design into docs/figures.json, with the day, the commit and the command."""
    content = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {"designs": {}}
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, encoding="utf-8", check=True).stdout.strip()
    made = {"date": datetime.datetime.now(datetime.UTC).date().isoformat(), "commit": commit, "command": command}
    content["designs"][name] = {**made, "accuracy": accuracy, "seed": 0, "beside_other_work": beside, **found}
    FIGURES.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=Path, help="result folders, or specs to design now")
    parser.add_argument("--accuracy", default="standard")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--store", action="store_true", help="keep the figures in docs/figures.json")
    parser.add_argument("--beside", action="store_true", help="other work has run at the same time")
    parser.add_argument("--fill", action="store_true", help="write the tables of the pages from docs/figures.json")
    options = parser.parse_args()
    for path in options.paths:
        command, found = measured(path, options.accuracy, options.threads)
        print(table([row(path.stem, {**found, "beside_other_work": options.beside})]), flush=True)
        if options.store:
            store(path.stem, command, found, accuracy=options.accuracy, beside=options.beside)
    if options.fill:
        for page in fill(ROOT, json.loads(FIGURES.read_text(encoding="utf-8"))):
            print(page, file=sys.stderr)


if __name__ == "__main__":
    main()
