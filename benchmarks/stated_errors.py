"""Scatter of each metric of light and photometry over seeds, over the standard error stated: about 1 where it is true.

    python benchmarks/stated_errors.py cad_out/quickstart --rays 65536 --seeds 30

The stated error is the root mean square over the seeds. Of thirty seeds a ratio is known to 13 %.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import lensforge as lf
from lensforge.results import StageResult

_FIRST_SEED = 1000  # beyond the seeds by which a lens is usually designed


@dataclass(frozen=True)
class StatedError:
    """Scatter of a metric over the seeds, and the standard error that is stated of it."""

    scatter: float
    stated: float

    @property
    def ratio(self) -> float:
        """Scatter over what is stated."""
        return self.scatter / self.stated


def stated_errors(results: Sequence[StageResult]) -> dict[str, StatedError]:
    """Scatter and error of each metric that all ``results`` of as many seeds have, by its path in the record."""
    by_path: dict[str, list[tuple[float, float]]] = {}
    for result in results:
        for path, metric in _metrics(result.plain()):
            by_path.setdefault(path, []).append((metric["value"], metric["standard_error"] or 0.0))
    errors = {}
    for path, pairs in by_path.items():
        values, stated = np.array(pairs).T
        if len(pairs) == len(results) and stated.all() and np.ptp(values) > 0.0:
            errors[path] = StatedError(float(values.std(ddof=1)), float(np.sqrt(np.mean(stated**2))))
    return errors


def _metrics(content: Any, path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    if isinstance(content, Mapping):
        if "standard_error" in content and isinstance(content.get("value"), float):
            yield path, content
            return
        for key, entry in content.items():
            yield from _metrics(entry, f"{path}.{key}" if path else key)
    elif isinstance(content, list | tuple):
        for number, entry in enumerate(content):
            yield from _metrics(entry, f"{path}.{number}")


def main() -> None:
    """Print a row for each metric, the ratios farthest from 1 first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="result folder with lens.json")
    parser.add_argument("--rays", type=int, default=2**16)
    parser.add_argument("--seeds", type=int, default=30)
    options = parser.parse_args()
    seeds = range(_FIRST_SEED, _FIRST_SEED + options.seeds)
    for folder in options.folders:
        lens = lf.load_lens(folder / "lens.json")
        verbs: dict[str, Callable[..., StageResult]] = {"evaluate": lf.evaluate, "photometry": lf.photometry}
        for name, verb in verbs.items():
            errors = stated_errors([verb(lens, rays=options.rays, seed=seed) for seed in seeds])
            print(f"## {folder.name}, {name}, {options.rays} rays, {options.seeds} seeds\n")
            for path, error in sorted(errors.items(), key=lambda pair: -abs(np.log(pair[1].ratio))):
                print(f"{error.ratio:6.2f}  {path}: scatter {error.scatter:.2g}, stated {error.stated:.2g}")
            print(flush=True)


if __name__ == "__main__":
    main()
