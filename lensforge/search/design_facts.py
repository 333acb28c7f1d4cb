"""Facts of a search: the size of its lens, its course, and the searches from other seeds."""

from collections.abc import Iterator

from lensforge.results import Bound, Fact, Group
from lensforge.results.criteria import state_of
from lensforge.results.numerals import quantity
from lensforge.search.design_result import Design


def design_facts(design: Design) -> list[Group]:
    """Groups of the lens, of the search, and of its starts where there were several."""
    groups = [
        Group("lens", "Lens", tuple(_size(design))),
        Group("search", "Search", tuple(_search(design))),
    ]
    return groups if design.spread is None else [*groups, Group("starts", "Starts", tuple(_starts(design)))]


def _size(design: Design) -> Iterator[Fact]:
    limits = design.lens.spec.constraints
    yield Fact(
        "radius",
        "Farthest from the LED",
        design.max_radius_mm,
        "mm",
        limit=Bound("<=", limits.max_radius_mm),
        state=state_of(design.criteria, "radius margin"),
        note="distance in space, without the base",
    )
    yield Fact(
        "height",
        "Height above the LED",
        design.height_mm,
        "mm",
        limit=None if limits.max_height_mm is None else Bound("<=", limits.max_height_mm),
        state=state_of(design.criteria, "height margin"),
        note="without the base",
    )
    high, wide = quantity(limits.cavity_height_mm, "mm"), quantity(2.0 * limits.cavity_radius_mm, "mm")
    yield Fact(
        "cavity",
        "Free space over the LED",
        design.constraints.cavity_clearance_mm,
        "mm",
        limit=Bound(">=", 0.0),
        state=state_of(design.criteria, "cavity clearance"),
        note=f"beyond a dome {high} high, {wide} wide",
    )


def _search(design: Design) -> Iterator[Fact]:
    yield Fact("steps", "Steps", design.steps, note=design.ended or "")
    yield Fact("levels", "Levels", len(design.history))
    yield Fact(
        "functions", "Functions", design.history[-1].functions if design.history else None, note="of each surface"
    )


def _starts(design: Design) -> Iterator[Fact]:
    """The kept search and the next best one."""
    best, following, *_ = sorted(design.starts, key=lambda start: start.rank)
    scatter = Fact("spread", "Standard deviation of the merit", design.spread, digits=2)
    yield Fact("kept", "Kept", f"seed {best.seed} of {len(design.starts)}", note=f"{scatter.label} {scatter.text}")
    yield Fact("next", "Next", f"seed {following.seed}", note=following.words)
