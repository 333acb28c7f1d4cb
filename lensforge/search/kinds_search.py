"""The search for the lens of a spec; where lamps have lenses of several kinds, one lens for all of them comes first.

From it all kinds go on together, against the sum of their light: the first search is as long as that of equal lamps.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from lensforge.scene.lens import Lens
from lensforge.search.checkpoint import of_kinds
from lensforge.search.design_result import Design, Observer, Progress
from lensforge.search.optimiser import search
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec


def search_kinds(
    spec: Spec,
    source: Source,
    *,
    start: Lens | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Observer | None = None,
    **options: Any,
) -> Design:
    """Search for the lens of ``spec``, or for those of all its kinds; all as of :func:`search`.

    ``start``: with the lenses of all kinds, they go on from these at once. The kinds have a checkpoint of their own
    beside that of the first search, which stays until they end.
    """
    common: dict[str, Any] = {"progress": progress, **options}
    if spec.lamps is None or not spec.all_lamps.kinds:
        return search(spec, source, start=start, checkpoint=checkpoint, resume=resume, **common)
    if start is not None and start.others:
        return search(spec, source, start=start, checkpoint=checkpoint, resume=resume, **common)
    equal = spec.model_copy(update={"lamps": spec.lamps.of_one_kind})
    first = search(equal, source, start=start, checkpoint=checkpoint, resume=resume, **common)
    if progress is not None:
        common["progress"] = _after(first, progress)
    beside = None if checkpoint is None else of_kinds(checkpoint)
    again = resume and beside is not None and beside.exists()
    found = search(spec, source, start=first.lens, checkpoint=beside, resume=again, **common)
    return _joined(first, found)


def _after(first: Design, progress: Observer) -> Observer:
    """An observer to which the steps of ``first`` have been done."""
    levels = _levels(first)

    def heard(now: Progress) -> object:
        done = {"level": levels + now.level, "steps_done": first.steps + now.steps_done}
        total, seconds = first.steps + now.steps_total, first.seconds + now.seconds
        return progress(replace(now, **done, steps_total=total, seconds=seconds))

    return heard


def _levels(design: Design) -> int:
    return 1 + max((level.level for level in design.history), default=-1)


def _joined(first: Design, found: Design) -> Design:
    """The record of ``found``, with the search that went before."""
    levels = _levels(first)
    later = tuple(level.model_copy(update={"level": levels + level.level}) for level in found.history)
    ended = None if found.ended is None else f"one lens: {first.ended}; lenses of all kinds: {found.ended}"
    both = {"steps": first.steps + found.steps, "seconds": first.seconds + found.seconds, "ended": ended}
    return found.model_copy(update={**both, "history": (*first.history, *later)})
