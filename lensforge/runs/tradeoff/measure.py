"""Convergence studies of one scene, as ``tradeoff.json`` and ``tradeoff.html``: of the light on its first receiver."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from lensforge.errors import InputError
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene
from lensforge.report.ownership import require_own
from lensforge.report.page import write_page
from lensforge.results.folder_lock import locked
from lensforge.runs.pipeline import write_design
from lensforge.runs.run_folder import open_run
from lensforge.runs.stages import design
from lensforge.runs.tradeoff import exported, pixels, rays, tables
from lensforge.runs.tradeoff.page import tradeoff_page
from lensforge.runs.tradeoff.presets import accuracy_of_presets
from lensforge.runs.tradeoff.record import MeasuredLens, Tradeoff
from lensforge.runs.tradeoff.runs import trace_run
from lensforge.runs.tradeoff.search import search_study
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.design_result import Design
from lensforge.search.symmetry import settled_symmetry
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Accuracy, Spec
from lensforge.spec.spec_files import section_sha256
from lensforge.surfaces.imported_face import LENS_FILE

PAGE = "tradeoff.html"
_THINNED = 4  # slower studies use every fourth of the rays of the table study
_WARM_UP_RAYS = 512  # compile the kernels, so that no level includes it


@dataclass(frozen=True)
class Effort:
    """The settings of each study; without ``cad`` no STEP file is written and the CAD kernel is not loaded.

    ``search``: accuracy of the search that is looked at, None for no search.
    """

    nodes_per_sigma: tuple[float, ...] = tables.SETTINGS
    rays: tuple[int, ...] = rays.SETTINGS
    pixels: tuple[int, ...] = pixels.PIXELS
    nodes: tuple[int, ...] = exported.NODES
    rings: tuple[int, ...] = exported.MESH_RINGS
    cast_rings: tuple[int, ...] = exported.CAST_RINGS
    cad: bool = True
    search: Accuracy | None = "standard"

    @staticmethod
    def up_to(most_rays: int) -> "Effort":
        """Default settings of every study, but rays in factors of four up to ``most_rays``."""
        return Effort(rays=tuple(2**power for power in range(12, 25, 2) if 2**power <= most_rays))


def run_tradeoff(
    spec: Spec,
    directory: Path,
    *,
    effort: Effort | None = None,
    announce: Callable[[str], None] = lambda _: None,
) -> Tradeoff:
    """Measure the lens in ``directory`` for the scene ``spec``; without a lens there, a draft is designed first.

    Writes ``tradeoff.json`` and ``tradeoff.html`` there. ``announce`` is called with what is measured next. Raises
    :class:`InputError` if the lens is that of another scene, for a page of another program, and where another process
    writes there.
    """
    require_own(directory / PAGE)
    with locked(directory, create=True):
        source = build_source(spec.source, spec.lens.dispersion)
        lens = _lens_in(directory, spec, source, announce)
        found = measure(lens, source, effort or Effort(), announce)
        found.write(directory)
        write_page(tradeoff_page(found), directory / PAGE)
        return found


def _lens_in(directory: Path, spec: Spec, source: Source, announce: Callable[[str], None]) -> Lens:
    """The lens in ``directory``, or where there is none a draft that is designed and written there."""
    path = directory / LENS_FILE
    if not path.exists():
        announce("no lens yet: a draft is designed")
        draft = design(spec, accuracy="draft", warn=lambda words: announce(f"warning: {words}"))
        return write_design(draft, directory).lens
    results = open_run(directory)
    require_same_scene(results.lens, spec, source, str(path))
    made = results.find(Design)
    if made is not None and made.inputs["spec"] != section_sha256(results.spec):
        raise InputError(f"{path}: a file that its spec names has changed since; give another folder, or design again")
    return results.lens


def measure(lens: Lens, source: Source, effort: Effort, announce: Callable[[str], None]) -> Tradeoff:
    """Measure all convergence studies of ``lens`` with ``source``; ``announce`` is called with the next one's name."""
    started = time.perf_counter()
    coarse = TracedLens.of(lens, min(effort.nodes_per_sigma))
    receiver = receivers_of(lens.spec, lens.spec.evaluate.pixels)[0]
    trace_run(coarse, receiver, source, min(_WARM_UP_RAYS, source.ray_count or _WARM_UP_RAYS), 0)
    announce("tables")
    found = tables.table_study(lens, source, effort.nodes_per_sigma)
    by_nodes, grid, finest, few = found.study, found.grid, found.tables, found.reference.thinned(_THINNED)
    scene = Scene(lens.media, grid)
    traced = TracedLens(scene, torch.from_numpy(finest["inner"]), torch.from_numpy(finest["outer"]), {})
    announce("rays")
    by_rays, runs = rays.ray_study(traced, lens.spec, source, effort.rays)
    announce("pixels and filter")
    by_pixels, by_filter = pixels.pixel_study(runs, lens.spec, effort.pixels), pixels.filter_study(runs, lens.spec)
    del runs
    announce("NURBS nodes, mesh rings, rays through the mesh")
    by_knots, plan = exported.nurbs_study(lens, effort.nodes, cad=effort.cad)
    by_mesh, by_cast = exported.mesh_study(plan, effort.rings), exported.casting_study(few, plan, effort.cast_rings)
    studies = [by_rays, by_nodes, by_pixels, by_filter, by_knots, by_mesh, by_cast]
    if effort.search is not None:
        announce("functions and steps of a search")
        studies.append(search_study(lens.spec, source, effort.search, max(effort.rays)))
    return Tradeoff(
        inputs={"lens": lens.sha256},
        name=lens.spec.name,
        lens=MeasuredLens(accuracy=lens.accuracy, seed=lens.seed, version=lens.version),
        threads=torch.get_num_threads(),
        presets=accuracy_of_presets(by_rays, by_nodes, source.ray_count),
        studies={study.name: study for study in studies},
        seconds=time.perf_counter() - started,
    )


def require_same_scene(lens: Lens, spec: Spec, source: Source, origin: str) -> None:
    """Raise :class:`InputError` where ``lens`` was designed for another scene than ``spec`` with its ``source``."""
    wanted = settled_symmetry(spec, source)
    if wanted.lens.levels == "auto":
        wanted = wanted.with_levels(lens.spec.lens.basis.levels)
    for section in ("source", "lens", "target", "receivers"):
        if _hashes(lens.spec, section) != _hashes(wanted, section):
            raise InputError(
                f"{origin}: its lens was designed for another [{section}] than {spec.name!r} has now; "
                "give another folder, or design it again"
            )


def _hashes(spec: Spec, section: str) -> list[str]:
    """Hash of a section of ``spec``, or of each of a list of them; empty where it is not given."""
    found = getattr(spec, section)
    listed = found if isinstance(found, tuple) else () if found is None else (found,)
    return [section_sha256(each) for each in listed]
