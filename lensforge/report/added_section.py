"""Parts of the page that add-ons bring: sections of their results, and applications beside the photometry."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import singledispatch

from lensforge.addon import addons
from lensforge.light.photometry_result import Photometry
from lensforge.report.page import PagePicture, numbered
from lensforge.report.results import Results
from lensforge.results import Group, StageResult
from lensforge.scene.application_light import ApplicationJudgement
from lensforge.spec import Spec
from lensforge.spec.application import Application

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


@dataclass(frozen=True)
class ShownApplication:
    """Application number ``index`` of ``spec``, judged in ``photometry`` with LED number ``led``."""

    photometry: Photometry
    spec: Spec
    index: int
    led: int

    @property
    def entry(self) -> Application:
        """Its entry in the spec."""
        return self.spec.applications[self.index]

    @property
    def judgement(self) -> ApplicationJudgement:
        """Its judgement."""
        return [*self.photometry.judgements_of(self.spec.applications)][self.index]

    def picture_name(self, name: str) -> str:
        """Name of one of its pictures, unique on the page."""
        return numbered(f"{name}-{self.index}", self.led)


@singledispatch
def application_pictures(judgement: ApplicationJudgement, shown: ShownApplication) -> list[PagePicture]:
    """Pictures of an application; an add-on registers the function for the class of its judgements."""
    return []


def pictures_of_applications(photometry: Photometry, spec: Spec, led: int) -> Iterator[PagePicture]:
    """Pictures of all applications of ``spec``."""
    for addon in addons():
        addon.pages()
    for index in range(len(spec.applications)):
        shown = ShownApplication(photometry, spec, index, led)
        yield from application_pictures(shown.judgement, shown)


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
