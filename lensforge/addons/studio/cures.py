"""Cures of a verdict: the one change that its reasons name, which a button of the page makes."""

from collections.abc import Iterator

from lensforge.addons.studio.page_frames import Fields
from lensforge.cad.part import Part
from lensforge.cad.part_limits import MORE_RINGS, OTHER_RINGS
from lensforge.proof.remedies import FINER_FACETS
from lensforge.report.folder import Run
from lensforge.results.verdict import TITLES
from lensforge.shop.check_result import Check
from lensforge.spec.accuracy import PRESETS

_RINGS = (OTHER_RINGS, MORE_RINGS, FINER_FACETS)  # remedies that ask for a finer mesh
_FINER = 2  # times as many rings as before
_MOST_RINGS = 10_000


def cure_of(title: str, run: Run) -> Fields | None:
    """Cure of the verdict named ``title``: text and action of a button. None if its reasons name no change.

    ``do``: an action of the page with its ``content``; ``change``: of the spec, for the next search.
    """
    cures = {TITLES["light"]: _of_light, TITLES["files"]: _of_files, TITLES["cutting"]: _of_cutting}
    return next(cures[title](run), None)


def _of_light(run: Run) -> Iterator[Fields]:
    names = [*map(str, PRESETS)]
    accuracy = str(run.lens.accuracy)
    if accuracy in names[:-1]:
        better = names[names.index(accuracy) + 1]
        yield {"words": f"Search with accuracy {better}", "do": "search", "content": {"accuracy": better}}


def _of_files(run: Run) -> Iterator[Fields]:
    remedies = [criterion.remedy for _, criterion in run.criteria() if not criterion.holds]
    part = run.find(Part)
    if part is not None and any(asked in remedy for asked in _RINGS for remedy in remedies):
        rings = min(_FINER * part.triangulation.rings, _MOST_RINGS)
        yield {"words": f"Export with a finer mesh ({rings} rings)", "do": "finer", "content": {"rings": rings}}
    elif any("export" in remedy for remedy in remedies) or set(run.missing) & {"export", "verify"}:
        yield {"words": "Make the part again" if remedies else "Make the part", "do": "part", "content": {}}


def _of_cutting(run: Run) -> Iterator[Fields]:
    check = run.find(Check)
    if check is None:
        yield {"words": "Make the part", "do": "part", "content": {}}
        return
    for finding in check.judgements()["verdicts"]:  # made again: a file keeps the sentences alone
        for change in finding.changes[:1]:
            made = {"place": change.field.split("."), "value": {"toml": change.value}}
            yield {"words": f"Set {change.field} = {change.value}, then search again", "change": made}
