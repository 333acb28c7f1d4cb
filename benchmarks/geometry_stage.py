"""The whole geometry stage of finished designs, after import: STEP, STL and 3MF, reading them back, and the check.

Prints seconds (wall and processor) for each part and the peak memory of the process. On a quiet machine:

python benchmarks/geometry_stage.py cad_out/flat_top cad_out/pi
"""

import importlib
import resource
import sys
import time
from pathlib import Path

from lensforge.cad.part_export import build_part
from lensforge.scene.lens import Lens, load_lens
from lensforge.shop.check import check_lens

LIBRARIES = ("cadquery", "trimesh", "manifold3d", "lib3mf", "OCP.STEPCAFControl")


def measure(lens: Lens) -> dict[str, tuple[float, float]]:
    """Wall and processor seconds of each stage."""
    started = _clocks()
    part = build_part(lens)
    built = _clocks()
    check_lens(part.lens)
    checked = _clocks()
    return {"export": _between(started, built), "check": _between(built, checked), "both": _between(started, checked)}


def _clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def _between(before: tuple[float, float], after: tuple[float, float]) -> tuple[float, float]:
    return after[0] - before[0], after[1] - before[1]


def main() -> None:
    for library in LIBRARIES:
        importlib.import_module(library)
    print("design\tstage\twall_s\tprocessor_s")
    for name in sys.argv[1:]:
        seconds = measure(load_lens(Path(name) / "lens.json"))
        for stage, (wall, processor) in seconds.items():
            print(f"{Path(name).name}\t{stage}\t{wall:.2f}\t{processor:.2f}")
    print(f"peak memory\t{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
