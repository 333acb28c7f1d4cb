"""Command line of spline_degrees.py: finished lenses in, Markdown tables out.

Not a script itself. With --json the tables are also written with all digits.
"""

import lensforge  # noqa: F401  before torch, whose idle threads then sleep

# isort: split
import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from convergence.study import ConvergenceStudy
from convergence.tables import SETTINGS, TableMeasurement, table_study
from convergence.text import study_text

from lensforge.scene.lens import Lens, load_lens
from lensforge.sources.build_source import build_source

Studies = Callable[[TableMeasurement], Sequence[ConvergenceStudy]]


def finest_tables(lens: Lens) -> TableMeasurement:
    """The finest tables of the presets, and rays of the lens's own source through the exact surfaces."""
    source = build_source(lens.spec.source, lens.spec.lens.dispersion)
    return table_study(lens, source, (max(SETTINGS),))


def main(description: str, studies_of: Studies) -> None:
    """Print the studies of each folder given, measured on one thread."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("directories", type=Path, nargs="+", metavar="DIR", help="result folder with lens.json")
    parser.add_argument("--json", type=Path, help="file that all digits are written to")
    options = parser.parse_args()
    torch.set_num_threads(1)
    found = {}
    for directory in options.directories:
        studies = studies_of(finest_tables(load_lens(directory / "lens.json")))
        found[directory.name] = {study.name: study.model_dump(mode="json") for study in studies}
        print(f"## {directory.name}")
        for study in studies:
            print("\n".join(study_text(study)))
        print(flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
