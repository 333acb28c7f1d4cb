"""The whole geometry stage of finished designs, after import: STEP, STL and 3MF, their proof, and the check.

Prints seconds (wall and processor) for each part and the peak memory of the process. On a quiet machine:

python benchmarks/geometry_stage.py cad_out/flat_top cad_out/pi
"""

import importlib
import resource
import sys
import tempfile
import time
from pathlib import Path

from lensforge.geometry import export_lens
from lensforge.lens import Lens, load_lens
from lensforge.manufacturing.check import check_lens

LIBRARIES = ("cadquery", "trimesh", "manifold3d", "lib3mf", "OCP.STEPCAFControl")
STAGES = {"export": export_lens, "check": check_lens}


def measure(lens: Lens) -> dict[str, tuple[float, float]]:
    """Wall and processor seconds of each stage."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, stage in STAGES.items():
            wall, processor = time.perf_counter(), time.process_time()
            stage(lens, Path(folder))
            found[name] = (time.perf_counter() - wall, time.process_time() - processor)
    return found


def main() -> None:
    for library in LIBRARIES:
        importlib.import_module(library)
    print("design\tstage\twall_s\tprocessor_s")
    for name in sys.argv[1:]:
        seconds = measure(load_lens(Path(name) / "lens.json"))
        seconds["both"] = tuple(sum(column) for column in zip(*seconds.values(), strict=True))
        for stage, (wall, processor) in seconds.items():
            print(f"{Path(name).name}\t{stage}\t{wall:.2f}\t{processor:.2f}")
    print(f"peak memory\t{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
