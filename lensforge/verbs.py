"""Verbs beyond the stages of one lens: documents for the shop, studies of several designs, summaries of ray files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from lensforge.errors import InputError
from lensforge.results import StageResult
from lensforge.results.validation import its_type
from lensforge.runs import cast_stages, stages
from lensforge.runs.arguments import require, source_of, threads_of_torch
from lensforge.runs.results import Results
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Design, Observer
from lensforge.sources.photometric.photometric_summary import inspect
from lensforge.spec import Accuracy, DrawingSection, Spec
from lensforge.spec.design_spec import require_spec

if TYPE_CHECKING:
    from lensforge.runs.sweep import Sweep
    from lensforge.runs.tradeoff_result import Tradeoff
    from lensforge.shop.handover import Handover
    from lensforge.sources.photometric.photometric_summary import PhotometricSummary
    from lensforge.sources.rayfiles.ray_file_summary import RayFileSummary


def handover(
    run: Results,
    *,
    spacing_mm: float | None = None,
    error_nm: float = 10.0,
    interpolation: Literal["bicubic", "linear"] = "bicubic",
    offset_inner_mm: float = 0.0,
    offset_outer_mm: float = 0.0,
    drawing: DrawingSection | None = None,
) -> "Handover":
    """Make the documents for the shop: drawing, verdicts, point tables, hashes; ``save(folder)`` writes them.

    ``drawing``: words of its title block and notes, such as another revision; None: those of the spec.

    ``spacing_mm``: of the dense tables; None: as wide as an ``interpolation`` error of ``error_nm`` along the normal
    allows. ``offset_inner_mm``, ``offset_outer_mm``: radius of a probe or tool whose centres they
    hold. Raises :class:`InputError` where the ball does not fit, or for too many points.
    """
    from lensforge.shop.dense_table import GridRequest
    from lensforge.shop.shop_files import make_handover

    if not isinstance(run, Results):
        raise InputError(f"handover: {str(run)[:60]!r} is {its_type(run)}, must be a Run: run(...) or load(...)")
    request = GridRequest(spacing_mm, error_nm, interpolation, offset_inner_mm, offset_outer_mm)
    return make_handover(run, request, drawing)


def sweep(
    spec: Spec,
    field: str,
    values: Sequence[float],
    *,
    scale: Sequence[str] = (),
    accuracy: Accuracy = "standard",
    seed: int = 0,
    threads: int | None = None,
    progress: Observer | None = None,
) -> "Sweep":
    """Run every stage for each of ``values`` of ``field`` (dotted, ``constraints.max_radius_mm``), in memory.

    Every field of ``scale`` keeps its ratio to the varied one. Raises :class:`InputError` for a value that the
    spec does not allow.
    """
    from lensforge.runs.sweep import sweep_of, variation_of

    require_spec(spec, "sweep")
    variation = variation_of(field, values, tuple(scale))
    found = []
    for variant in variation.variants(spec):
        design = stages.design(variant.spec, accuracy=accuracy, seed=seed, threads=threads, progress=progress)
        found.append((variant, run_in_memory(design, threads)))
    return sweep_of(spec, variation, found)


def run_in_memory(design: Design, threads: int | None = None) -> Results:
    """Evaluate, build, check and verify the lens of ``design``: the stages of a run, without a folder."""
    light, part = stages.evaluate(design.lens, threads=threads), stages.build(design.lens)
    check, proof = stages.check(part), cast_stages.verify(part, light, threads=threads)
    results: tuple[StageResult, ...] = (design, light, part, check, proof)
    return Results(design.lens, {result.stage: result for result in results})


def tradeoff(
    spec: Spec,
    *,
    lens: Lens | None = None,
    most_rays: int = 2**20,
    threads: int | None = None,
    announce: Callable[[str], None] | None = None,
) -> "Tradeoff":
    """Measure accuracy against computing time for the scene of ``spec``, on ``lens`` or on a draft designed first.

    ``most_rays``: of the largest sample, 2^12 to 2^24. ``announce`` is called with each series as it starts.
    """
    from lensforge.runs.tradeoff_study import LEAST_RAYS, MOST_RAYS, measure, require_same_scene

    require_spec(spec, "tradeoff")
    if not (isinstance(most_rays, int) and LEAST_RAYS <= most_rays <= MOST_RAYS):
        raise InputError(f"most_rays = {most_rays!r}: an integer from {LEAST_RAYS} to {MOST_RAYS}")
    source = source_of(spec)
    if lens is None:
        lens = stages.design(spec, accuracy="draft", threads=threads).lens
    else:
        require_same_scene(require(lens, Lens, "tradeoff"), spec, source, "tradeoff")
    with threads_of_torch(threads):
        return measure(lens, source, most_rays, announce or (lambda _: None))


def rays(file: Path | str) -> "RayFileSummary | PhotometricSummary":
    """Summarise a file of light: header and statistics of a ray file, or beam and flux of a photometric file.

    The content decides, not the name. Raises :class:`InputError` for a file of no known format.
    """
    if not isinstance(file, Path | str):
        raise InputError(f"rays: {type(file).__name__} given; give the path of a ray file")
    return inspect(Path(file))
