"""Execute the notebooks of examples/ into build/notebooks, or with --store in their place; an error in one is an error.

python docs/run_notebooks.py [NAME ...] [--store]
"""

import argparse
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
LIMIT_S = 1800  # for a cell, on a machine that does other work, too


def execute(path: Path, target: Path) -> float:
    """Run the notebook at ``path`` in an empty folder, write it with its results to ``target``; the seconds."""
    notebook = nbformat.read(path, as_version=4)
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(
            notebook, timeout=LIMIT_S, kernel_name="python3", resources={"metadata": {"path": folder}}
        ).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # times of day
    target.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, target)
    return time.monotonic() - start


def main() -> None:
    """Execute the named notebooks, or all."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--store", action="store_true", help="keep the results in examples/")
    options = parser.parse_args()
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        if not options.names or path.stem in options.names:
            target = path if options.store else ROOT / "build" / "notebooks" / path.name
            print(f"{path.stem}: {execute(path, target):.0f} s", flush=True)


if __name__ == "__main__":
    main()
