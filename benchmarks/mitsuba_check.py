"""Agreement of Mitsuba 3 with the design: Mitsuba's cast of `lensforge verify` at growing numbers of rays.

    pip install lensforge[mitsuba]
    python benchmarks/mitsuba_check.py DIR [--rays N]

DIR is a result folder with lens.json, lens.stl and evaluate.json. Prints one JSON object for each ray count, from 2**12
in steps of four up to --rays; exit code 1 where a criterion is missed.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lensforge.errors import LensforgeError
from lensforge.light.evaluation_result import Light
from lensforge.light.simulation import TracedLens, design_landings
from lensforge.proof.acceptance import mitsuba_criteria
from lensforge.proof.mitsuba_cast import cast_mitsuba
from lensforge.proof.part_comparison import Expected
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_inputs import screens_of
from lensforge.scene.lens import load_lens
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS

SEED = 2**42  # apart from the seeds of design, evaluation and verification


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=Path)
    parser.add_argument("--rays", type=int, default=2**18)
    given = parser.parse_args()
    all_met = True
    try:
        for result in casts(given.directory, given.rays):
            print(json.dumps(result))
            all_met &= all(criterion["passed"] for criterion in result["criteria"])
    except LensforgeError as error:
        print(f"mitsuba_check: {error}", file=sys.stderr)
        return 2
    return 0 if all_met else 1


def casts(directory: Path, most: int) -> Iterator[dict[str, Any]]:
    lens, part = load_lens(directory / "lens.json"), read_part_mesh((directory / "lens.stl").read_bytes())
    spec, source = lens.spec, build_source(lens.spec.source, lens.spec.lens.dispersion)
    rays = source.sample(min(most, source.ray_count or most), SEED)
    designed = Light.read(directory).map
    screen = screens_of(spec, max(designed.shape))[0]
    traced = TracedLens.of(lens, PRESETS[lens.accuracy].evaluate_nodes_per_sigma)
    landed = design_landings(traced, spec, rays)[0]
    expected = Expected(screen, designed, landed.hits, landed.flux)
    count = 2**12
    while count <= len(rays):
        ((cast, _),) = cast_mitsuba(part, rays, lens.media, [expected], count)
        criteria = mitsuba_criteria(cast, screen.reach_mm(designed))
        yield cast.model_dump(mode="json") | {"criteria": [criterion.model_dump(mode="json") for criterion in criteria]}
        count *= 4


if __name__ == "__main__":
    sys.exit(main())
