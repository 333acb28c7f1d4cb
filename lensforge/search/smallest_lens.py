"""The smallest lens that holds all limits on the light: searches within one size after another.

The most light that lenses within a size send into the targets grows with the size. The least size within which a lens
holds the limits is therefore that of the smallest lens, and no price has to be set on size against light. Each search
is that of ``aim = "share"`` by a spec with that size, begun anew: the lens is the one that a user would get who wrote
the size into the spec. It is judged by rays that judge no lens afterwards, and holds a limit by so much that others
agree.

Sizes are chosen between the smallest that holds and the largest below it that does not, by the margin of the limit
nearest to its bound, which is nearly linear in the logarithm of the size. A margin that jumps, as that of a lens that
starts otherwise, costs a search or two more: every third size halves the interval.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.results import Fact
from lensforge.scene.lens import Lens
from lensforge.search.checkpoint import MOST_SIZES, CheckpointError, of_later_size
from lensforge.search.design_result import ENOUGH, Design, Observer, Progress, TriedSize
from lensforge.search.searches_in_turn import search_in_turn
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.accuracy import preset_of

if TYPE_CHECKING:
    from lensforge.sources.ray_bundle import Source

_SMALLER = 0.8  # of a size that holds, where nothing is known of smaller ones
_LEAST_SMALLER = 0.5  # and at least that, where the margins of two sizes say that it is less
_SURE = 4.0  # standard errors by which a limit is held
_BISECT_EVERY = 3
_ROUNDING = 1e-9


def lens_by_search(spec: Spec, source: "Source", **options: Any) -> Design:
    """Search for the lens of ``spec``: for the smallest one, where it aims at that."""
    find = smallest_lens if spec.optimise.aim == "size" else search_in_turn
    return find(spec, source, **options)


@dataclass
class _Searches:
    """Searches that are done, by their ``sizes``: the ``seconds`` and steps of all, and the ``smallest`` that holds.

    ``first``: the one within the largest size. ``enough``: their observer wants no further step.
    """

    progress: Observer | None
    sizes: list[TriedSize]
    seconds: float = 0.0
    steps: int = 0
    first: Design | None = None
    smallest: Design | None = None
    enough: bool = False

    def observer(self, within: str) -> Observer:
        """Observer of the next search."""

        def heard(now: Progress) -> object:
            if self.progress is None:
                return None
            of_all = replace(
                now,
                seconds=self.seconds + now.seconds,
                steps_done=self.steps + now.steps_done,
                steps_total=self.steps + now.steps_total,
                within=within,
            )
            answer = self.progress(of_all)
            self.enough = answer == ENOUGH
            return answer

        return heard

    def add(self, tried: TriedSize, design: Design | None) -> None:
        """Add the search within a size."""
        self.sizes.append(tried)
        if design is None:
            return
        self.seconds += design.seconds
        self.steps += design.steps
        self.first = self.first or design
        if tried.holds and (self.smallest is None or design_size(design) < design_size(self.smallest)):
            self.smallest = design

    @property
    def end(self) -> Design:
        """The smallest lens that holds the limits, or that of the first search where none does."""
        design = self.smallest or self.first
        assert design is not None, "the first search raises what it refuses"
        return design.changed(seconds=self.seconds, sizes=tuple(self.sizes))


def smallest_lens(
    spec: Spec,
    source: "Source",
    *,
    accuracy: AnyAccuracy = "standard",
    seed: int = 0,
    start: Lens | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Observer | None = None,
    **options: Any,
) -> Design:
    """Search for the smallest lens that holds all limits of ``spec``, within sizes from its largest one downwards.

    Where even that one does not hold them, its lens is the result. ``start``: from which each search begins. Each has
    a ``checkpoint`` of its own. Raises :class:`InputError` as the first search does, and for a checkpoint of a later
    one; that no lens is as small as a later one asks only ends the interval of sizes.
    """
    step = preset_of(accuracy).effort.size_step
    searches = _Searches(progress, [])
    within_mm = largest_mm(spec)
    while True:
        number = len(searches.sizes)
        path = None if checkpoint is None else of_later_size(checkpoint, number)
        again = resume and (number == 0 or (path is not None and path.exists()))
        try:
            design = search_in_turn(
                spec if within_mm is None else within(spec, within_mm),
                source,
                accuracy=accuracy,
                seed=seed,
                start=start,
                checkpoint=path,
                resume=again,
                progress=searches.observer("" if within_mm is None else f"{spec.optimise.size} {within_mm:.4g} mm"),
                **options,
            )
        except CheckpointError:
            raise  # it says nothing about lenses of this size
        except InputError as error:
            if within_mm is None or number == 0:
                raise
            searches.add(TriedSize(within_mm=within_mm, holds=False, why=str(error)), None)
        else:
            searches.add(_judged(design, within_mm, seeds.of_choice(seed)), design)
        within_mm = None if searches.enough or number + 1 == MOST_SIZES else next_size(searches.sizes, step)
        if within_mm is None:
            return searches.end


def largest_mm(spec: Spec) -> float | None:
    """Size within which the first search looks; None for a height that the spec does not limit."""
    limits = spec.constraints
    return limits.max_radius_mm if spec.optimise.size == "radius" else limits.max_height_mm


def within(spec: Spec, size_mm: float) -> Spec:
    """``spec`` for lenses within ``size_mm``. Raises :class:`InputError` where they have no room for its LED."""
    return spec.replace({f"constraints.max_{spec.optimise.size}_mm": size_mm})


def within_size_of(spec: Spec, lens: Lens) -> Spec:
    """``spec`` with the size within which ``lens`` was found, where it aims at the smallest."""
    size_mm = largest_mm(lens.spec)
    return spec if spec.optimise.aim != "size" or size_mm is None else within(spec, size_mm)


def design_size(design: Design) -> float:
    """Size of the lens (mm), of which the least is sought."""
    return design.max_radius_mm if design.lens.spec.optimise.size == "radius" else design.height_mm


def _judged(design: Design, within_mm: float | None, rays_seed: int) -> TriedSize:
    from lensforge.search.other_rays import light_by_other_rays  # a second, which no search of one size needs here

    limits = [limit for light in light_by_other_rays(design.lens, rays_seed) for limit in light.limits]
    margins = list(_margins(limits))
    size_mm = design_size(design)
    margin, error = min(margins, key=lambda of_limit: of_limit[0] - _SURE * of_limit[1])
    holds = len(margins) == len(limits) and all(criterion.holds for criterion in design.criteria)
    return TriedSize(
        within_mm=within_mm or size_mm,
        holds=holds and margin >= _SURE * error,
        size_mm=size_mm,
        margin=margin,
        standard_error=error,
    )


def _margins(limits: Sequence[Fact]) -> Iterator[tuple[float, float]]:
    """Margin of each of the ``limits`` that could be measured, relative to its bound, and its standard error."""
    for limit in limits:
        if isinstance(limit.value, float | int) and limit.limit is not None:
            scale = abs(limit.limit) or 1.0
            inside = limit.value - limit.limit if limit.sense == ">=" else limit.limit - limit.value
            yield inside / scale, (limit.standard_error or 0.0) / scale


def next_size(tried: Sequence[TriedSize], step: float) -> float | None:
    """Size (mm) within which to search next; None where the least is known to a share of ``step``, or none holds.

    ``tried``: the sizes so far, of which the first is the largest.
    """
    holding = sorted((size for size in tried if size.holds), key=_size_mm)
    if not holding:
        return None
    held = holding[0]
    failed = max(
        (size for size in tried if not size.holds and size.within_mm < _size_mm(held)),
        key=lambda size: size.within_mm,
        default=None,
    )
    if failed is None:
        return _below(holding)
    low = math.log(failed.within_mm)
    high = math.log(_size_mm(held))
    near = math.log1p(step)
    if high - low <= near * (1.0 + _ROUNDING):
        return None
    middle = 0.5 * (low + high)
    if high - low <= 2.0 * near:
        return math.exp(middle)
    share = None if len(tried) % _BISECT_EVERY == 0 else _share_at_the_bound(failed, held)
    at = middle if share is None else low + share * (high - low) + 0.5 * near  # rather inside the limits
    return math.exp(min(max(at, low + near), high - near))  # an interval that it leaves on one side is done


def _size_mm(held: TriedSize) -> float:
    """Size of a lens that holds the limits: no larger than what it was searched within."""
    return held.within_mm if held.size_mm is None else min(held.size_mm, held.within_mm)


def _share_at_the_bound(failed: TriedSize, held: TriedSize) -> float | None:
    """Share of the way from a size that fails to one that holds at which the margin would be 0; None if not known."""
    if failed.margin is None or held.margin is None or not failed.margin < 0.0 < held.margin:
        return None
    return failed.margin / (failed.margin - held.margin)


def _below(holding: Sequence[TriedSize]) -> float:
    """A size that may not hold, by the margins of the two smallest that do."""
    held, *larger = holding
    smaller_mm = _SMALLER * _size_mm(held)
    if not larger or held.margin is None or larger[0].margin is None:
        return smaller_mm
    distance = math.log(_size_mm(larger[0]) / _size_mm(held))
    fall = larger[0].margin - held.margin
    if not (fall > 0.0 and distance > 0.0):
        return smaller_mm
    at_bound_mm = _size_mm(held) * math.exp(-held.margin / fall * distance)
    return max(min(smaller_mm, at_bound_mm), _LEAST_SMALLER * _size_mm(held))
