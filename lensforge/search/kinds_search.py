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
    if spec.lamps is None or not spec.all_lamps.kinds or (start is not None and start.others):
        return search(spec, source, start=start, checkpoint=checkpoint, resume=resume, progress=progress, **options)
    equal = spec.changed(lamps=spec.lamps.of_one_kind)
    first = search(equal, source, start=start, checkpoint=checkpoint, resume=resume, progress=progress, **options)
    after = None if progress is None else _after(first, progress)
    beside = None if checkpoint is None else of_kinds(checkpoint)
    again = resume and beside is not None and beside.exists()
    found = search(spec, source, start=first.lens, checkpoint=beside, resume=again, progress=after, **options)
    return _joined(first, found)


def _after(first: Design, progress: Observer) -> Observer:
    """An observer to which the steps of ``first`` have been done."""
    levels = _levels(first)

    def heard(now: Progress) -> object:
        steps_done, steps_total = first.steps + now.steps_done, first.steps + now.steps_total
        both = replace(now, level=levels + now.level, seconds=first.seconds + now.seconds)
        return progress(replace(both, steps_done=steps_done, steps_total=steps_total))

    return heard


def _levels(design: Design) -> int:
    return 1 + max((level.level for level in design.history), default=-1)


def _joined(first: Design, found: Design) -> Design:
    """The record of ``found``, with the search that went before."""
    levels = _levels(first)
    later = tuple(level.changed(level=levels + level.level) for level in found.history)
    each = {"one lens": first.ended, "lenses of all kinds": found.ended}
    ended = "; ".join(f"{which}: {words}" for which, words in each.items() if words) or None
    both: dict[str, object] = {"steps": first.steps + found.steps, "seconds": first.seconds + found.seconds}
    both |= {"ended": ended, "kept_start": first.kept_start and found.kept_start}
    return found.changed(**both, history=(*first.history, *later))
