"""Measure what each loop over the events of rays costs on the usual lens, and by how much their light differs.

python benchmarks/event_loops.py       # a quarter of a minute; CPU seconds of one thread
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

import lensforge as lf
from lensforge.light.reference_bodies import ReferenceBody
from lensforge.light.reference_trace import as_arrays, trace_reference
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays
from lensforge.search.problem import parameters_of
from lensforge.sources.build_source import build_source

EXAMPLES = Path(__file__).parents[1] / "examples"
CHAIN = Chain(("inner", "outer"), ("cavity", "body"), ("body", "outside"), 2)
READABLE, COMPILED = 2**11, 2**17  # rays


def seconds(trace: Callable[[], ExitRays], times: int) -> tuple[ExitRays, float]:
    """What was traced, and the least CPU time of some runs after a first one."""
    found, taken = trace(), []
    for _ in range(times):
        start = time.process_time()
        found = trace()
        taken.append(time.process_time() - start)
    return found, min(taken)


def main() -> None:
    """Trace a lens of three levels by every loop, and print times and differences."""
    torch.set_num_threads(1)
    spec = lf.load_spec(EXAMPLES / "quickstart.toml").with_levels((9, 25, 81))
    parameters = parameters_of(spec, 3.0)
    weights, offsets = parameters.start()
    weights += 0.002 * torch.from_numpy(np.random.default_rng(1).normal(size=weights.shape))
    lens = parameters.lens(weights, offsets, spec, 0, "draft")
    traced, source = TracedLens.of(lens, 6.0), build_source(spec.source, None)
    few, many, grid = source.sample(READABLE, 0), source.sample(COMPILED, 0), traced.scene.grid
    usual, chain = Scene(lens.media, grid), Scene(lens.media, grid, chain=CHAIN)
    guided = ReferenceBody.exact(lens.surfaces, usual, traced.tables)
    scanned, scanned_chain = (ReferenceBody.exact(lens.surfaces, scene) for scene in (usual, chain))
    tabled = ReferenceBody.by_tables(torch.from_numpy(traced.tables), usual)
    runs: dict[str, Callable[[], ExitRays]] = {
        "reference, guided by tables": lambda: as_arrays(trace_reference(guided, few)),
        "reference, dense scans": lambda: as_arrays(trace_reference(scanned, few)),
        "reference, dense scans, as a chain": lambda: as_arrays(trace_reference(scanned_chain, few)),
        "kernels, the usual lens": lambda: TracedBundle.of(traced.tables, usual, many).exits,
        "kernels, as a chain": lambda: TracedBundle.of(traced.tables, chain, many).exits,
        "reference, on the tables": lambda: as_arrays(trace_reference(tabled, many)),
    }
    first: dict[int, ExitRays] = {}
    for name, trace in runs.items():
        found, taken = seconds(trace, 1 if name.startswith("reference") else 5)
        base = first.setdefault(len(found.flux), found)
        apart = np.abs(found.points - base.points)[found.left_lens & base.left_lens].max()
        fates = int((found.fates != base.fates).sum())
        print(f"{name}: {len(found.flux):,} rays, {taken:.3f} s, {apart:.1e} mm apart, {fates} other fates")


if __name__ == "__main__":
    main()
