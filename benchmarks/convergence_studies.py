"""Convergence studies of finished lenses, as Markdown: rays, tables, pixels, faces, meshes and stages of the search.

    python benchmarks/convergence_studies.py cad_out/flat_top cad_out/pi [--most-rays N]

Some minutes a lens on one thread, with 2^24 rays.
"""

import lensforge  # noqa: F401  before torch, whose idle threads then sleep

# isort: split
import argparse
from collections.abc import Iterator
from pathlib import Path

import torch
from convergence import exported, pixels, rays, search, tables
from convergence.presets import accuracy_of_presets
from convergence.runs import trace_run
from convergence.text import preset_text, study_text

from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene
from lensforge.scene.lens import Lens, load_lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source

THINNED = 4  # the cast uses every fourth of the rays of the table study
WARM_UP_RAYS = 512  # compile the kernels, so that no level includes it


def text_of(lens: Lens, most_rays: int) -> Iterator[str]:
    """All studies of a lens with its own source."""
    source = build_source(lens.spec.source, lens.spec.lens.dispersion)
    receiver = receivers_of(lens.spec, lens.spec.evaluate.pixels)[0]
    trace_run(TracedLens.of(lens, 2.5), receiver, source, min(WARM_UP_RAYS, source.ray_count or WARM_UP_RAYS), 0)
    measured = tables.table_study(lens, source)
    finest = measured.tables
    traced = TracedLens(Scene(lens.media, measured.grid), np.stack([*finest.values()]), {})
    counts = tuple(2**power for power in range(12, 25, 2) if 2**power <= most_rays)
    by_rays, runs = rays.ray_study(traced, lens.spec, source, counts)
    studies = [by_rays, measured.study, pixels.pixel_study(runs, lens.spec), pixels.filter_study(runs, lens.spec)]
    del runs
    by_nodes, plan = exported.nurbs_study(lens)
    cast = exported.casting_study(measured.reference.thinned(THINNED), plan)
    studies += [by_nodes, exported.mesh_study(plan), cast, search.search_study(lens.spec, source, rays=most_rays)]
    yield f"Lens: `--accuracy {lens.accuracy}`, seed {lens.seed}."
    yield from preset_text(accuracy_of_presets(by_rays, measured.study, source.ray_count))
    for study in studies:
        yield from study_text(study)


def main() -> None:
    """Print the studies of each folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directories", type=Path, nargs="+", metavar="DIR", help="result folder with lens.json")
    parser.add_argument("--most-rays", type=int, default=2**24, help="rays of the longest runs")
    options = parser.parse_args()
    torch.set_num_threads(1)
    for directory in options.directories:
        print(f"## {directory.name}\n")
        print(*text_of(load_lens(directory / "lens.json"), options.most_rays), sep="\n", end="\n\n", flush=True)


if __name__ == "__main__":
    main()
