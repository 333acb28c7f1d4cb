"""Sections of the page that add-ons fill: what they show of their results, beside the facts."""

from dataclasses import dataclass
from functools import singledispatch

from lensforge.addon import addons
from lensforge.report.page import PagePicture
from lensforge.report.results import Results
from lensforge.results import Group, StageResult

FIRST = 4  # facts of a group that a page shows at once


@dataclass(frozen=True)
class Place:
    """A section of the page: its ``anchor``, its ``name`` in the list of sections, and its ``heading``."""

    anchor: str
    name: str
    heading: str


@dataclass(frozen=True)
class OnPlace:
    """Place at which a result is shown, and its rows of pictures."""

    place: Place
    rows: list[list[PagePicture]]


@dataclass(frozen=True)
class AddedSection:
    """A section: its place, and for each result there its facts and rows of pictures."""

    place: Place
    results: list[tuple[Group, list[list[PagePicture]]]]


@singledispatch
def shown_on_page(result: StageResult, results: Results) -> OnPlace | None:
    """Place and pictures of a result on the page, None for none; an add-on registers the function for its class."""
    return None


def added_sections(results: Results) -> list[AddedSection]:
    """The sections that results of add-ons have, in the order of the results."""
    for addon in addons():
        addon.pages()
    by_place: dict[Place, AddedSection] = {}
    for result in results.found.values():
        page = shown_on_page(result, results)
        if page is not None:
            section = by_place.setdefault(page.place, AddedSection(page.place, []))
            section.results.extend((group, page.rows) for group in results.facts(result))
    return list(by_place.values())
