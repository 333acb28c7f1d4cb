"""Errors of manufacture and mounting, one at a time and all together: the verbs ``sensitivity`` and ``tolerance``."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lensforge import seeds
from lensforge.light.lens_light import judging_source, rays_of, unless_own
from lensforge.made.tolerance_result import MOST_PARTS, Sensitivity, Yield
from lensforge.results import Conditions
from lensforge.results.arguments import count_of, path_of, require, threads_of_torch
from lensforge.scene.lens import Lens
from lensforge.search.cluster import connected
from lensforge.spec.spec_files import section_sha256
from lensforge.spec.tolerances_section import TolerancesSection, read_tolerances

if TYPE_CHECKING:
    from lensforge.made.measured_parts import ClusterParts

_LEAST_PARTS = 40  # two in each block by which the shares of the variance have their errors


def sensitivity(
    lens: Lens,
    *,
    rays: int | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Sensitivity:
    """Compute the effect of each tolerance of the spec, at its end, on the light of ``lens``.

    ``progress`` is called with the number of lenses traced and of all.
    """
    from lensforge.made.sensitivity import RAYS, measure_sensitivity

    require(lens, Lens, "sensitivity")
    count, conditions = rays_of(count_of("rays", rays), RAYS, judging_source(lens.spec))
    with threads_of_torch(threads):
        found = measure_sensitivity(lens, rays=count, progress=progress)
    return found.model_copy(update={"conditions": conditions})


def tolerance(
    lens: Lens,
    *,
    parts: int = 1000,
    rays: int | None = None,
    seed: int = 0,
    tolerances: TolerancesSection | Path | str | None = None,
    budget: bool = True,
    checkpoint: Path | str | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], object] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Yield:
    """Draw ``parts`` from the tolerances of the lens's spec: the share that passes, spread of the light, its causes.

    ``rays``: of each part; by default as many as keep its standard error below a tenth of the spread over the parts.
    ``tolerances``: others than those of the spec, by a section, the name of a preset, or a TOML file. ``budget``: also
    search for the largest amount of each tolerance. ``checkpoint``: a file of measured parts, with which an interrupted
    study goes on to the same bits. ``scheduler``: a Dask cluster that measures the parts, to the same bits: its
    address, such as ``tcp://10.0.0.5:8786``, or ``local:4`` for processes of this machine. ``progress`` is called with
    the number of parts measured and of all, in each stage of the study, and cancels by returning False. Raises
    :class:`InputError` for tolerances that the part cannot bear, and where no scheduler answers.
    """
    from lensforge.made.yield_study import measure_yield

    require(lens, Lens, "tolerance")
    if isinstance(tolerances, Path | str):
        tolerances = read_tolerances(str(tolerances))
    elif tolerances is not None:
        require(tolerances, TolerancesSection, "tolerance")
    parts = count_of("parts", parts, least=_LEAST_PARTS, most=MOST_PARTS) or parts
    count, seed = count_of("rays", rays), count_of("seed", seed, least=0, most=seeds.MOST) or 0
    other = tolerances if tolerances is not None and tolerances != lens.spec.tolerances else None
    drawn = lens if other is None else replace(lens, spec=lens.spec.model_copy(update={"tolerances": other}))
    with threads_of_torch(threads), _part_workers(scheduler) as workers:
        found = measure_yield(
            drawn,
            parts=parts,
            rays=count,
            seed=seed,
            with_budget=budget,
            workers=workers,
            file=path_of("checkpoint", checkpoint),
            progress=progress,
            announce=announce,
        )
    conditions = Conditions.of(
        tolerances=None if other is None else _name_of(other),
        tolerances_sha256=None if other is None else section_sha256(other),
        seed=unless_own(seed, 0),
    )
    return found.model_copy(update={"inputs": {"lens": lens.sha256}, "conditions": conditions})


@contextmanager
def _part_workers(scheduler: str | None) -> "Iterator[ClusterParts | None]":
    """Workers of the cluster of ``scheduler``; None for the threads of this process."""
    if scheduler is None:
        yield None
        return
    from lensforge.made.measured_parts import ClusterParts

    with connected(scheduler) as cluster:
        yield ClusterParts(cluster)


def _name_of(tolerances: TolerancesSection) -> str:
    """Name of a preset, or one of its own for each other section: no study takes the place of another."""
    if tolerances == TolerancesSection(preset=tolerances.preset):
        return tolerances.preset
    return f"own_{section_sha256(tolerances)[:8]}"
