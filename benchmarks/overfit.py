"""Overfitting to measured rays: a lens is designed on one part of a ray file and evaluated on the other.

    python benchmarks/overfit.py examples/led_rayfile.toml --accuracy draft [--levels 9,25,81,289]

NMSEs are without ray noise, by 16 replicates, so that parts of different sizes can be compared.
"""

import argparse
import json
from pathlib import Path

from lensforge.light.evaluation import evaluate_lens
from lensforge.search.optimiser import search
from lensforge.sources.ray_set_loading import load_ray_set
from lensforge.spec import load_spec
from lensforge.spec.accuracy import PRESETS


def evaluated(lens, emitter, preset, pixels):
    light = evaluate_lens(lens, emitter, preset, rays=len(emitter), pixels=pixels)
    return {
        "rays": light.rays,
        "nmse": light.nmse.model_dump(),
        "nmse_raw": light.raw.nmse,
        "efficiency": light.efficiency.model_dump(),
    }


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("spec", type=Path)
    arguments.add_argument("--accuracy", choices=list(PRESETS), default="draft")
    arguments.add_argument("--pixels", type=int, default=48, help="coarse: a pixel should see many rays")
    arguments.add_argument("--fraction", type=float, default=0.5, help="of the rays, to design on")
    arguments.add_argument("--levels", help="instead of automatic ones, such as 9,25,81,289")
    arguments.add_argument("--seed", type=int, default=0)
    given = arguments.parse_args()
    spec = load_spec(given.spec).with_automatic_levels()
    if given.levels:
        spec = spec.replace({"lens.levels": [int(count) for count in given.levels.split(",")]})
    training, holdout = load_ray_set(spec.source, spec.lens.dispersion).split(given.fraction, given.seed)
    result = search(spec, training, accuracy=given.accuracy, seed=given.seed)
    preset = PRESETS[given.accuracy]
    report = {
        "spec": spec.name,
        "accuracy": given.accuracy,
        "levels": result.lens.basis.levels,
        "seconds": round(result.seconds, 1),
        "training": evaluated(result.lens, training, preset, given.pixels),
        "holdout": evaluated(result.lens, holdout, preset, given.pixels),
    }
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
