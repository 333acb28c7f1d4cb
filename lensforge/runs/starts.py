"""Searches from several starts, each with a seed of its own: the best of them, and how far they scatter."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.runs import stages
from lensforge.runs.arguments import count_of, preset_of, threads_of_torch, warned_source
from lensforge.scene.lens import Lens
from lensforge.search.cluster import connected
from lensforge.search.design_result import Design, Observer, Start
from lensforge.spec import Accuracy, Spec
from lensforge.spec.design_spec import require_spec

MOST_STARTS = 1000


@dataclass(frozen=True)
class SeededSearch:
    """A search but for its seed; ``progress`` is called in this process only."""

    spec: Spec
    accuracy: Accuracy
    anyway: bool
    progress: Observer | None
    rays_seed: int  # of the rays that choose


def best_design(
    spec: Spec,
    *,
    starts: int,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    threads: int | None = None,
    scheduler: str | None = None,
    progress: Observer | None = None,
    announce: Callable[[str], None] | None = None,
    warn: Callable[[str], None] | None = None,
    anyway: bool = False,
) -> Design:
    """Search ``starts`` times, with the seeds from ``seed`` on, and return the best; its ``starts`` has all of them.

    The best keeps most constraints and limits and, of those, has the smallest NMSE. Rays that judge no lens afterwards,
    the same for all, choose it: of the figures of many lenses by the rays that judge, the best would be the luckiest.
    ``scheduler``: a Dask cluster, to the same bits, as of :func:`tolerance`; ``progress`` then hears nothing.
    ``announce`` is called with a line for each start that has ended. Other arguments as of :func:`design`.
    """
    require_spec(spec, "best_design")
    preset_of(accuracy)
    count, first = count_of("starts", starts, most=MOST_STARTS) or 1, count_of("seed", seed, 0) or 0
    if first + count - 1 > seeds.MOST:
        raise InputError(f"seed = {seed}: with {count} starts the last seed is above {seeds.MOST}")
    warned_source(spec, warn, stages.start_of(spec, None), anyway=anyway)
    search = SeededSearch(spec, accuracy, anyway, progress if scheduler is None else None, seeds.of_choice(first))
    found: dict[int, tuple[Design, Start]] = {}
    for number, each in _all(search, tuple(range(first, first + count)), threads, scheduler):
        found[number] = each
        if announce is not None:
            announce(f"start {len(found)} of {count}: seed {each[1].seed}, {each[1].words}")
    ordered = [found[number] for number in range(count)]
    best, _ = min(ordered, key=lambda each: each[1].rank)  # of equals the first seed
    return best.model_copy(update={"starts": tuple(start for _, start in ordered)})


def _all(
    search: SeededSearch, numbers: tuple[int, ...], threads: int | None, scheduler: str | None
) -> Iterator[tuple[int, tuple[Design, Start]]]:
    """Every search, as it ends: its number from 0 on, and what it found."""
    if scheduler is not None:
        with connected(scheduler) as cluster:
            yield from cluster.map(started, search, numbers)
        return
    with threads_of_torch(threads):
        for number, seed in enumerate(numbers):
            yield number, started(search, seed)


def started(search: SeededSearch, seed: int) -> tuple[Design, Start]:
    """One search, and the light of its lens."""
    design = stages.design(
        search.spec,
        accuracy=search.accuracy,
        seed=seed,
        progress=search.progress,
        warn=lambda _: None,  # once is enough
        anyway=search.anyway,
    )
    light = _light_by_other_rays(design.lens, search.rays_seed)
    missed = sum(not criterion.passed for criterion in design.criteria)
    missed += sum(limit.state == "missed" for limit in light.limits)
    errors = [each.nmse.value for each in light.receivers if each.nmse is not None]
    return design, Start(
        seed=seed,
        nmse=light.nmse,
        efficiency=light.efficiency,
        merit=sum(errors) / len(errors),
        missed=missed,
        seconds=design.seconds,
    )


def _light_by_other_rays(lens: Lens, seed: int) -> Light:
    """The light of ``lens`` by rays of its source that judge none: measured ones are those of the search, turned."""
    from lensforge.light.evaluation import evaluate_traced
    from lensforge.light.simulation import TracedLens
    from lensforge.scene.limit_readings import light_limits
    from lensforge.scene.receiver_shapes import receivers_of
    from lensforge.sources.build_source import build_source, summarise
    from lensforge.sources.measured_rays import searched, smoothed

    spec, preset = lens.spec, preset_of(lens.accuracy)
    source = build_source(spec.source, lens.dispersion)
    efficacy = summarise(source, spec.source).lumens_per_watt
    limits = light_limits(spec, receivers_of(spec, spec.evaluate.pixels), efficacy, source.flux_w)
    return evaluate_traced(
        TracedLens.of(lens, preset.evaluate_nodes_per_sigma),
        spec,
        smoothed(searched(source)),
        spec.evaluate.rays or preset.evaluate_rays,
        seed,
        limits=limits,
        bounds_by=source,
    )
