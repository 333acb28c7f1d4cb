"""Searches in turn, each from the lens of the one before: polished then frosted, for one lens then for all kinds.

Light that a face spreads hides where a lens errs, so that a search from the first faces on ends early. The lens that is
designed polished and frosted afterwards is the better start, and no search ends worse than it begins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lensforge.scene.lens import Lens
from lensforge.search.checkpoint import of_later_search
from lensforge.search.design_result import Design, Level, Observer, Progress
from lensforge.spec import Spec
from lensforge.spec.polished_faces import frosted_as, polished, scatters_about_the_light

if TYPE_CHECKING:
    from lensforge.sources.ray_bundle import Source


class Turn(NamedTuple):
    """A search by ``spec``, in words. ``wanted``: the spec as whose lenses its observer is shown polished ones."""

    phrase: str
    spec: Spec
    wanted: Spec | None = None


def number_of_searches(spec: Spec) -> int:
    """Number of searches for the lens of ``spec`` from the first faces on."""
    return len(tuple(_turns(spec, None)))


def search_in_turn(
    spec: Spec,
    source: "Source",
    *,
    start: Lens | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Observer | None = None,
    **options: Any,
) -> Design:
    """Search for the lens of ``spec`` from the first faces on, or from ``start``.

    Where faces scatter about the direction of the light, first for the polished lens, unless there is a ``start``;
    where lamps have lenses of several kinds, first for one. ``start``: with the lenses of all kinds, they go on from
    these at once. Each later search has a checkpoint of its own beside that of the first, which stays until they end.
    """
    from lensforge.search.optimiser import search

    turns = tuple(_turns(spec, start))
    done = list[Design]()
    for number, turn in enumerate(turns):
        path = None if checkpoint is None else of_later_search(checkpoint, number)
        again = resume and (number == 0 or (path is not None and path.exists()))
        observer = None if progress is None else _after(done, turn.wanted, progress)
        begin = done[-1].lens if done else start
        done.append(search(turn.spec, source, start=begin, checkpoint=path, resume=again, progress=observer, **options))
    return _joined(turns, done)


def _turns(spec: Spec, start: Lens | None) -> Iterator[Turn]:
    if spec.lamps is None or not spec.all_lamps.kinds:
        yield from _turns_of_one_lens(spec, start, "frosted")
        return
    if start is None or not start.others:
        yield from _turns_of_one_lens(spec.changed(lamps=spec.lamps.of_one_kind), start, "one lens")
    yield Turn("lenses of all kinds", spec)


def _turns_of_one_lens(spec: Spec, start: Lens | None, description: str) -> Iterator[Turn]:
    if start is None and scatters_about_the_light(spec):
        half = with_half_of_the_time(spec)
        yield Turn("polished", polished(half), wanted=half)
        yield Turn(description, half)
    else:
        yield Turn(description, spec)


def with_half_of_the_time(spec: Spec) -> Spec:
    """``spec`` of one of two searches that share its time."""
    seconds = spec.optimise.seconds
    return spec if seconds is None else spec.changed(optimise=spec.optimise.changed(seconds=0.5 * seconds))


def _after(done: Sequence[Design], wanted: Spec | None, progress: Observer) -> Observer:
    """An observer of the search that follows those that are ``done``; its lenses have the faces of ``wanted``."""
    levels = _next_level(_history(done))
    steps = _steps(done)
    seconds = _seconds(done)

    def heard(now: Progress) -> object:
        def lens() -> Lens:
            shown = now.lens()
            return shown if wanted is None else replace(shown, spec=frosted_as(shown.spec, wanted))

        both = replace(now, level=levels + now.level, seconds=seconds + now.seconds, lens=lens)
        return progress(replace(both, steps_done=steps + now.steps_done, steps_total=steps + now.steps_total))

    return heard


def _joined(turns: Sequence[Turn], done: Sequence[Design]) -> Design:
    last = done[-1]
    if len(done) == 1:
        return last
    pairs = zip(turns, done, strict=True)
    ended = "; ".join(f"{turn.phrase}: {design.ended}" for turn, design in pairs if design.ended) or None
    kept = all(design.kept_start for design in done)
    return last.changed(
        steps=_steps(done), seconds=_seconds(done), ended=ended, kept_start=kept, history=_history(done)
    )


def _history(done: Sequence[Design]) -> tuple[Level, ...]:
    """The levels of all searches, counted through."""
    history: tuple[Level, ...] = ()
    for design in done:
        first = _next_level(history)
        history += tuple(level.changed(level=first + level.level) for level in design.history)
    return history


def _next_level(history: Sequence[Level]) -> int:
    return 1 + max((level.level for level in history), default=-1)


def _steps(done: Sequence[Design]) -> int:
    return sum(design.steps for design in done)


def _seconds(done: Sequence[Design]) -> float:
    return sum(design.seconds for design in done)
