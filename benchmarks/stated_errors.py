"""Scatter of each stated figure over seeds, over the standard error stated of it: about 1 where that is true.

    python benchmarks/stated_errors.py cad_out/quickstart --rays 65536 --seeds 30
    python benchmarks/stated_errors.py cad_out/quickstart --verb verify --rays 4096 --seeds 100

The verbs are evaluate, photometry, verify, sensitivity and yield; the record of stray light states no errors. The
stated error is the root mean square over the seeds. Of n seeds a ratio is known to 1/√(2n): of thirty to 13 %.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import lensforge as lf
from lensforge.results import StageResult

_FIRST_SEED = 1000  # beyond the seeds by which a lens is usually designed
_PARTS = 100  # of each yield study
_NAMES = ("name", "tolerance", "faces")  # fields by which entries of a list are told apart: their order may change


@dataclass(frozen=True)
class StatedError:
    """Scatter of a figure over the seeds, and the standard error that is stated of it."""

    scatter: float
    stated: float

    @property
    def ratio(self) -> float:
        """Scatter over what is stated."""
        return self.scatter / self.stated


def stated_errors(results: Sequence[StageResult]) -> dict[str, StatedError]:
    """Scatter and error of each figure that all ``results`` of as many seeds have, by its path in the record."""
    by_path: dict[str, list[tuple[float, float]]] = {}
    for result in results:
        for path, value, error in _figures(result.plain()):
            by_path.setdefault(path, []).append((value, error))
    errors = {}
    for path, pairs in by_path.items():
        values, stated = np.array(pairs).T
        if len(pairs) == len(results) and stated.all() and np.ptp(values) > 0.0:
            errors[path] = StatedError(float(values.std(ddof=1)), float(np.sqrt(np.mean(stated**2))))
    return errors


def _figures(content: Any, path: str = "") -> Iterator[tuple[str, float, float]]:
    """Path, value and standard error of each figure that states one."""
    if isinstance(content, Mapping):
        value = content.get("value", content.get("share"))
        if "standard_error" in content and isinstance(value, float):
            yield path, value, content["standard_error"] or 0.0
            return
        for key, entry in content.items():
            yield from _figures(entry, f"{path}.{key}" if path else key)
    elif isinstance(content, list | tuple):
        for number, entry in enumerate(content):
            yield from _figures(entry, f"{path}.{_told_apart(number, entry)}")


def _told_apart(number: int, entry: Any) -> str:
    names = [entry[name] for name in _NAMES if name in entry] if isinstance(entry, Mapping) else []
    return " ".join(map(str, [*names, entry.get("amount", "")])).strip() if names else str(number)


def _verbs(lens: lf.Lens) -> dict[str, Callable[[int, int], StageResult]]:
    """By its name each verb whose record states errors, of rays and a seed."""
    part = lf.build(lens)

    def proof(rays: int, seed: int) -> lf.Proof:
        seeded = replace(lens, seed=seed)
        return lf.verify(part.changed(lens=seeded), lf.evaluate(seeded), rays=rays)

    def parts(rays: int, seed: int) -> lf.Yield:
        return lf.tolerance(replace(lens, seed=seed), parts=_PARTS, rays=rays, seed=seed, budget=False)

    return {
        "evaluate": lambda rays, seed: lf.evaluate(lens, rays=rays, seed=seed),
        "photometry": lambda rays, seed: lf.photometry(lens, rays=rays, seed=seed),
        "verify": proof,
        "sensitivity": lambda rays, seed: lf.sensitivity(replace(lens, seed=seed), rays=rays),
        "yield": parts,
    }


def main() -> None:
    """Print a row for each figure, the ratios farthest from 1 first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="result folder with lens.json")
    parser.add_argument(
        "--verb", action="append", help="by default evaluate and photometry; yield takes minutes a seed"
    )
    parser.add_argument("--rays", type=int, default=2**16)
    parser.add_argument("--seeds", type=int, default=30)
    options = parser.parse_args()
    seeds = range(_FIRST_SEED, _FIRST_SEED + options.seeds)
    for folder in options.folders:
        verbs = _verbs(lf.load_lens(folder / "lens.json"))
        for name in options.verb or ("evaluate", "photometry"):
            errors = stated_errors([verbs[name](options.rays, seed) for seed in seeds])
            print(f"## {folder.name}, {name}, {options.rays} rays, {options.seeds} seeds\n")
            for path, error in sorted(errors.items(), key=lambda pair: -abs(np.log(pair[1].ratio))):
                print(f"{error.ratio:6.2f}  {path}: scatter {error.scatter:.2g}, stated {error.stated:.2g}")
            print(flush=True)


if __name__ == "__main__":
    main()
