"""Every ladder for one scene; ``lensforge tradeoff`` writes them as ``tradeoff.json`` and ``tradeoff.html``."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from lensforge.errors import InputError
from lensforge.evaluation.simulate import TracedLens
from lensforge.files import replacing
from lensforge.lens import Lens, load_lens
from lensforge.optimisation.symmetry import settled_symmetry
from lensforge.pipeline import run_design
from lensforge.receivers.plane import PlaneReceiver
from lensforge.sources.build import build_source
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.studies.tradeoff import casting, degrees, pixels, precision, rays, shape, tables
from lensforge.studies.tradeoff.page import tradeoff_page
from lensforge.studies.tradeoff.prices import preset_prices
from lensforge.studies.tradeoff.record import MeasuredLens, Tradeoff
from lensforge.studies.tradeoff.runs import trace_run
from lensforge.tracing.fused import Scene

PAGE = "tradeoff.html"
_THINNED = 4  # of the rays that tables are measured with: the slower ladders take every fourth
_WARM_UP_RAYS = 512  # compiles the kernels, so that no rung pays for it


@dataclass(frozen=True)
class Effort:
    """The settings of each ladder; without ``cad`` no STEP file is weighed and the CAD kernel stays out."""

    nodes_per_sigma: tuple[float, ...] = tables.SETTINGS
    rays: tuple[int, ...] = rays.SETTINGS
    pixels: tuple[int, ...] = pixels.PIXELS
    nodes: tuple[int, ...] = shape.NODES
    rings: tuple[int, ...] = shape.RINGS
    degrees: tuple[float, ...] = degrees.SETTINGS
    bisections: tuple[int, ...] = precision.BISECTIONS
    cast_rings: tuple[int, ...] = casting.RINGS
    cad: bool = True

    @staticmethod
    def up_to(most_rays: int) -> "Effort":
        """Every ladder as it is, the rays in steps of four up to ``most_rays``."""
        return Effort(rays=tuple(2**power for power in range(12, 25, 2) if 2**power <= most_rays))


def run_tradeoff(
    spec: Spec,
    directory: Path,
    *,
    effort: Effort | None = None,
    announce: Callable[[str], None] = lambda _: None,
) -> Tradeoff:
    """Measure the lens in ``directory`` for the scene ``spec``; without a lens there, a draft is designed first.

    Writes ``tradeoff.json`` and ``tradeoff.html`` there. ``announce`` hears what is measured next. Raises
    :class:`InputError` if the lens is that of another scene.
    """
    path, source = directory / "lens.json", build_source(spec.source, spec.lens.dispersion)
    if path.exists():
        lens = load_lens(path)
        require_same_scene(lens, spec, source, str(path))
    else:
        announce("no lens yet: a draft is designed")
        lens = run_design(spec, directory, accuracy="draft").lens
    found = measure(lens, source, effort or Effort(), announce)
    found.write(directory)
    with replacing(directory / PAGE) as temporary:
        temporary.write_text(tradeoff_page(found), encoding="utf-8")
    return found


def measure(lens: Lens, source: Source, effort: Effort, announce: Callable[[str], None]) -> Tradeoff:
    """All ladders of ``lens`` under ``source``; ``announce`` hears what is measured next."""
    started = time.perf_counter()
    coarse = TracedLens.of(lens, min(effort.nodes_per_sigma))
    receiver = PlaneReceiver.of(lens.spec.target, lens.spec.evaluate.pixels)
    trace_run(coarse, receiver, source, min(_WARM_UP_RAYS, source.population or _WARM_UP_RAYS), 0)
    announce("tables")
    found = tables.table_ladder(lens, source, effort.nodes_per_sigma)
    by_nodes, grid, finest, few = found.ladder, found.grid, found.tables, found.truth.thinned(_THINNED)
    announce("degrees of the splines, precision")
    by_degree = degrees.degree_ladder(few, grid, finest, effort.degrees)
    by_bits = precision.precision_ladder(found.truth, grid, finest)
    by_search = precision.search_ladder(found.truth, effort.bisections)
    scene = Scene(lens.refractive_index, grid)
    traced = TracedLens(scene, torch.from_numpy(finest["inner"]), torch.from_numpy(finest["outer"]), {})
    announce("rays")
    by_rays, runs = rays.ray_ladder(traced, lens.spec, source, effort.rays)
    announce("pixels and filter")
    by_pixels, by_filter = pixels.pixel_ladder(runs, lens.spec, effort.pixels), pixels.filter_ladder(runs, lens.spec)
    del runs
    announce("NURBS nodes, mesh rings, rays through the mesh")
    by_knots, plan = shape.nurbs_ladder(lens, effort.nodes, cad=effort.cad)
    by_mesh, by_cast = shape.mesh_ladder(plan, effort.rings), casting.casting_ladder(few, plan, effort.cast_rings)
    searched = [] if by_search is None else [by_search]
    ladders = [by_rays, by_nodes, by_degree, by_bits, *searched, by_pixels, by_filter, by_knots, by_mesh, by_cast]
    return Tradeoff(
        inputs={"lens": lens.sha256},
        name=lens.spec.name,
        lens=MeasuredLens(accuracy=lens.accuracy, seed=lens.seed, version=lens.version),
        threads=torch.get_num_threads(),
        presets=preset_prices(by_rays, by_nodes, source.population),
        ladders={ladder.name: ladder for ladder in ladders},
        seconds=time.perf_counter() - started,
    )


def require_same_scene(lens: Lens, spec: Spec, source: Source, origin: str) -> None:
    """Raise :class:`InputError` where ``lens`` is one for another scene than ``spec`` with its ``source``."""
    wanted = settled_symmetry(spec, source)
    for section in ("source", "lens", "target"):
        if getattr(lens.spec, section) != getattr(wanted, section):
            raise InputError(
                f"{origin}: its lens was designed for another [{section}] than {spec.name!r} has now; "
                "give another folder, or design it again"
            )
