"""Studies of several designs, or of one scene: the verbs ``sweep`` and ``tradeoff``."""

from collections.abc import Callable, Sequence

from lensforge.errors import InputError
from lensforge.light.lens_light import evaluate, source_of
from lensforge.proof.casts import verify
from lensforge.report.results import Results
from lensforge.results import StageResult
from lensforge.results.arguments import require, threads_of_torch
from lensforge.runs.stage import build, check
from lensforge.runs.sweep import Sweep, sweep_of, variation_of
from lensforge.runs.tradeoff_result import Tradeoff
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Design, Observer
from lensforge.search.searches import design
from lensforge.spec import Accuracy, Spec
from lensforge.spec.design_spec import require_spec


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
) -> Sweep:
    """Run every stage for each of ``values`` of ``field`` (dotted, ``constraints.max_radius_mm``), in memory.

    Every field of ``scale`` keeps its ratio to the varied one. Raises :class:`InputError` for a value that the
    spec does not allow.
    """
    require_spec(spec, "sweep")
    variation = variation_of(field, values, tuple(scale))
    found = []
    for variant in variation.variants(spec):
        made = design(variant.spec, accuracy=accuracy, seed=seed, threads=threads, progress=progress)
        found.append((variant, _run_in_memory(made, threads)))
    return sweep_of(spec, variation, found)


def _run_in_memory(made: Design, threads: int | None) -> Results:
    """Evaluate, build, check and verify the lens of a design: the stages of a run, without a folder."""
    light, part = evaluate(made.lens, threads=threads), build(made.lens)
    results: tuple[StageResult, ...] = (made, light, part, check(part), verify(part, light, threads=threads))
    return Results(made.lens, {result.stage: result for result in results})


def tradeoff(
    spec: Spec,
    *,
    lens: Lens | None = None,
    most_rays: int = 2**20,
    threads: int | None = None,
    announce: Callable[[str], None] | None = None,
) -> Tradeoff:
    """Measure accuracy against computing time for the scene of ``spec``, on ``lens`` or on a draft designed first.

    ``most_rays``: of the largest sample, 2^12 to 2^24. ``announce`` is called with the name of each study as it starts.
    """
    from lensforge.runs.tradeoff_study import measure, require_same_scene

    require_spec(spec, "tradeoff")
    if not (isinstance(most_rays, int) and 2**12 <= most_rays <= 2**24):
        raise InputError(f"most_rays = {most_rays!r}: an integer from {2**12} to {2**24}")
    source = source_of(spec)
    if lens is None:
        lens = design(spec, accuracy="draft", threads=threads).lens
    else:
        require_same_scene(require(lens, Lens, "tradeoff"), spec, source, "tradeoff")
    with threads_of_torch(threads):
        return measure(lens, source, most_rays, announce or (lambda _: None))
