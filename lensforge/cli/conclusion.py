"""End of a command: its result on stdout as the user asked for it, warnings on stderr, the criteria it must meet."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from lensforge.cli.blocks import blocks_of, rows_of, summary
from lensforge.cli.output import Output, document, folder_document, print_json
from lensforge.cli.printing import warning_line
from lensforge.cli.screen import Block, print_screen
from lensforge.errors import CriterionMissed
from lensforge.report.headline import headline
from lensforge.results import SimulatedResult, StageResult
from lensforge.results.criteria import require
from lensforge.results.ownership import is_free_or_own
from lensforge.runs.pipeline import refresh_report
from lensforge.runs.results import REPORT_FILE, stem_of
from lensforge.runs.run_folder import Run, open_run

if TYPE_CHECKING:
    from lensforge.shop.handover import Handover

Decides = Literal["light", "files", "cutting", ""]
# The bytes of the files, which lie in the folder.
_FILES_OF_HANDOVER: dict[str, Any] = {
    **dict.fromkeys(("html", "pdf", "dxf", "points_csv", "sag_csv"), True),
    "grids": {"__all__": {"content"}},
}


def finish(output: Output, directory: Path, *results: StageResult, decides: Decides = "") -> None:
    """Print the ``results`` of a stage, the first one the stage's own, and refresh the report if there is one.

    Raises :class:`CriterionMissed` where a criterion is missed, or the part of the verdict that the stage ``decides``.
    A result under other conditions than the lens's own decides nothing.
    """
    run = open_run(directory)
    if output.json:
        print_json(document(run, *results))
    elif output.screen:
        print_screen([block for each in results for block in blocks_of(each, run)])
    for each in results:
        tell_conditions(each)
    refresh_page(directory)
    require(criterion for each in results for criterion in getattr(each, "criteria", ()))
    first = results[0]
    if decides and (not isinstance(first, SimulatedResult) or first.conditions is None):
        require_pass(directory, decides)


def finish_run(output: Output, run: Run) -> None:
    """Print the results of a whole run. Raises :class:`CriterionMissed` where its verdict fails."""
    if output.json:
        print_json(document(run, *run.found.values()))
    elif output.screen:
        print_screen(summary(run))
    require_pass(run.folder)


def finish_page(output: Output, directory: Path | None, written: Mapping[str, Path]) -> None:
    """Print the paths of the pages that were ``written``, and the verdict on ``directory`` where it is one design."""
    run = None if directory is None else open_run(directory)
    names = {name: str(path) for name, path in written.items()}
    if output.json:
        print_json({**({} if run is None else document(run)), **names})
    elif output.screen:
        title = "Comparison" if run is None else headline(run).sentence
        print_screen([Block(title, list(names.items()))])


def finish_handover(output: Output, directory: Path, made: "Handover") -> None:
    """Print the files that were ``made`` for the shop, and the findings of the check that do not hold."""
    run = open_run(directory)
    if output.json:
        content = made.model_dump(mode="json", exclude=_FILES_OF_HANDOVER)
        print_json({**document(run), "handover": {"files": list(made.files), **content}})
    elif output.screen:
        print_screen(
            [Block(f"For the shop, in {directory}", list(rows_of([made.facts]))), Block(headline(run).sentence)]
        )
    refresh_page(directory)


def finish_study(output: Output, directory: Path, found: StageResult, block: Block, page: str) -> None:
    """Print a study of its own folder, and its ``page``."""
    if output.json:
        print_json(folder_document(directory, found))
    elif output.screen:
        print_screen([block, Block(f"Written: {directory / page}")])


def refresh_page(directory: Path) -> None:
    """Draw the report again where there is one that this program wrote."""
    if (directory / REPORT_FILE).exists() and is_free_or_own(directory / REPORT_FILE):
        refresh_report(directory)


def tell_conditions(result: StageResult) -> None:
    """Say on stderr where ``result`` is under other conditions than the lens's own, and warn on its source."""
    conditions = result.conditions if isinstance(result, SimulatedResult) else None
    if conditions is None:
        return
    for words in conditions.warnings:
        click.echo(warning_line(words), err=True)
    own = stem_of(result.model_copy(update={"conditions": None}))
    click.echo(
        f"{stem_of(result)}.json: other conditions than the lens's own ({conditions}); {own}.json and the verdict rest "
        "on the lens's own",
        err=True,
    )


def require_pass(directory: Path, *parts: str) -> None:
    """Raise :class:`CriterionMissed` where the verdict on ``directory`` fails, in ``parts`` or, without them, any."""
    run = open_run(directory)
    try:
        run.verdict.require(cutting=run.spec.manufacture.required, parts=parts)
    except CriterionMissed as error:
        raise CriterionMissed(f"{directory}: {error}") from None
