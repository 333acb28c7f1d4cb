"""The end of a command: its results as the user asked for them, warnings on stderr, the criteria it must meet."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lensforge.cli.blocks import blocks_of, rows_of, summary
from lensforge.cli.output import Output, document, folder_document, print_json
from lensforge.cli.printing import warning_line
from lensforge.cli.screen import Block, print_screen
from lensforge.errors import CriterionMissed
from lensforge.report.headline import headline
from lensforge.report.results import conditions_of, stem_of
from lensforge.results import StageResult
from lensforge.results.criteria import require
from lensforge.runs.folder import Run, RunFolder
from lensforge.runs.stage import Decides

if TYPE_CHECKING:
    from lensforge.shop.handover import Handover

# The bytes of the files, which lie in the folder.
_FILES_OF_HANDOVER: dict[str, Any] = {
    **dict.fromkeys(("html", "pdf", "dxf", "points_csv"), True),
    "grids": {"__all__": {"content"}},
}


def finish(output: Output, here: RunFolder, *results: StageResult, decides: Decides = "") -> None:
    """Print the ``results`` of a stage, the first one the stage's own, and refresh the report if there is one.

    Raises :class:`CriterionMissed` where a criterion is missed, or the part of the verdict that the stage ``decides``.
    A result under other conditions than the lens's own decides nothing.
    """
    run = here.run
    if output.json:
        print_json(document(run, *results))
    elif output.screen:
        print_screen([block for each in results for block in blocks_of(each, run)])
    for each in results:
        _tell_conditions(each)
    here.refresh_report()
    require(criterion for each in results for criterion in getattr(each, "criteria", ()))
    if decides and conditions_of(results[0]) is None:
        _require_pass(run, decides)


def finish_run(output: Output, run: Run) -> None:
    """Print the results of a whole run. Raises :class:`CriterionMissed` where its verdict fails."""
    if output.json:
        print_json(document(run, *run.found.values()))
    elif output.screen:
        print_screen(summary(run))
    _require_pass(run)


def finish_page(output: Output, run: Run | None, written: Mapping[str, Path]) -> None:
    """Print the paths of the pages that were ``written``, and the verdict of the ``run`` where they are on one."""
    names = {name: str(path) for name, path in written.items()}
    if output.json:
        print_json({**({} if run is None else document(run)), **names})
    elif output.screen:
        title = "Comparison" if run is None else headline(run).sentence
        print_screen([Block(title, list(names.items()))])


def finish_handover(output: Output, here: RunFolder, made: "Handover") -> None:
    """Print the files that were ``made`` for the shop, and the findings of the check that do not hold."""
    run = here.run
    if output.json:
        content = made.model_dump(mode="json", exclude=_FILES_OF_HANDOVER)
        print_json({**document(run), "handover": {"files": list(made.files), **content}})
    elif output.screen:
        title = f"For the shop, in {run.folder}"
        print_screen([Block(title, list(rows_of([made.facts]))), Block(headline(run).sentence)])
    here.refresh_report()


def finish_study(output: Output, directory: Path, found: StageResult, block: Block, page: str) -> None:
    """Print a study of its own folder, and its ``page``."""
    if output.json:
        print_json(folder_document(directory, found))
    elif output.screen:
        print_screen([block, Block(f"Written: {directory / page}")])


def _tell_conditions(result: StageResult) -> None:
    """Say on stderr where ``result`` is under other conditions than the lens's own, and warn on its source."""
    conditions = conditions_of(result)
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


def _require_pass(run: Run, *parts: str) -> None:
    """Raise :class:`CriterionMissed` where the verdict on ``run`` fails, in ``parts`` or, without them, any."""
    try:
        run.verdict.require(cutting=run.spec.manufacture.required, parts=parts)
    except CriterionMissed as error:
        raise CriterionMissed(f"{run.folder}: {error}") from None
