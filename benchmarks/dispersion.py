"""Effect of dispersion on a finished lens: the same rays with each one's index, with the mean, with the design's.

    python benchmarks/dispersion.py cad_out/osram_pi --material PMMA

Rays go through the exact surfaces. Shifts are between landings of the same ray on the first receiver, a plane, weighted
by flux.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensforge.light.reference_bodies import ReferenceBody
from lensforge.light.reference_trace import as_arrays, trace_reference
from lensforge.light.table_trace import Scene
from lensforge.optics.material import MATERIALS
from lensforge.optics.media import Medium
from lensforge.scene.lens import load_lens
from lensforge.scene.pixel_grid import Window
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source, summarise
from lensforge.surfaces.bicubic_table import grid_for, tabulate

NODES_PER_SIGMA = 6.0  # the table only leads to the crossing: steps on the exact surface follow


def shift(one, other, whole):
    """Distances (mm) between the landings of the same rays on the ``whole`` receiver, a plane, by two traces."""
    both = one.arrived & other.arrived & whole.contains(other.hits)
    apart = np.linalg.norm(one.hits[both] - other.hits[both], axis=1)
    rms = float(np.sqrt(np.average(apart**2, weights=other.flux[both])))
    return {"rms_mm": rms, "median_mm": float(np.median(apart)), "p99_mm": float(np.quantile(apart, 0.99))}


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("directory", type=Path, help="of a design whose source has wavelengths")
    arguments.add_argument("--material", choices=list(MATERIALS), default="PMMA")
    arguments.add_argument("--rays", type=int, default=100_000)
    given = arguments.parse_args()
    lens = load_lens(given.directory / "lens.json")
    source = build_source(lens.spec.source, MATERIALS[given.material])
    rays = source.sample(min(given.rays, source.ray_count or given.rays), 1)
    if rays.wavelengths_nm is None:
        raise SystemExit(f"{given.directory}: its source has no wavelengths; add source.spectrum")
    dispersive = Medium(lens.refractive_index, material=MATERIALS[given.material])
    each = dispersive.indices(rays.wavelengths_nm, len(rays))
    grid = grid_for(lens.detail_rad, NODES_PER_SIGMA)
    guides = np.stack([tabulate(grid, surface) for surface in lens.surfaces.values()])
    mean = float(np.average(each, weights=rays.flux))
    receiver = receivers_of(lens.spec, lens.spec.evaluate.pixels)[0]
    whole = Window(*receiver.grid.size)
    landed = {}
    for name, body in (("each", dispersive), ("mean", Medium(mean)), ("design", Medium(lens.refractive_index))):
        bodies = ReferenceBody.exact(lens.surfaces, Scene(replace(lens.media, body=body), grid), guides)
        landed[name] = receiver.land(as_arrays(trace_reference(bodies, rays)))
    inside = {name: whole.contains(light.hits) for name, light in landed.items()}
    report = {
        "rays": len(rays),
        "wavelengths_nm": summarise(source, lens.spec.source).wavelengths_nm,
        "index": {"design": lens.refractive_index, "mean": mean, "standard_deviation": float(each.std())},
        "colours": shift(landed["each"], landed["mean"], whole),
        "mean_instead_of_design": shift(landed["mean"], landed["design"], whole),
        "efficiency": {name: float(light.flux[inside[name]].sum() / source.flux_w) for name, light in landed.items()},
    }
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
