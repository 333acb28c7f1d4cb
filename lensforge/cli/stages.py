"""The commands on a result folder: one for each stage of the table, made from its row, and the pages of a folder."""

import functools
from collections.abc import Callable, Mapping
from inspect import signature
from pathlib import Path
from typing import Any, Literal

import click

from lensforge.cli.conclusion import finish, finish_handover, finish_page
from lensforge.cli.options import FOLDER, OPTIONS, Command, Number, WholeNumber, resume_after_interrupt
from lensforge.cli.output import Output, with_output
from lensforge.cli.studies import renewed_for
from lensforge.errors import InputError
from lensforge.report.folder import opened
from lensforge.report.pipeline import write_comparison, write_report
from lensforge.report.results import MOST_MODEL_RAYS, REPORT_FILE
from lensforge.report.results import handover as make_handover
from lensforge.results import StageResult
from lensforge.results.files import require_own, require_writable
from lensforge.spec.processes import Process
from lensforge.verbs import EVALUATE, STAGES, STRAY, VERIFY, FolderStage


def command_of(
    stage: FolderStage[Any], further: Mapping[str, Callable[[Command], Command]] | None = None
) -> click.Command:
    """The command of a stage: DIR, an option for each keyword that the stage names, ``--json`` and ``--quiet``.

    ``further``: options by keyword, beside those that every stage may take.
    """
    options = {**OPTIONS, **(further or {})}
    command: Command = with_output(functools.partial(_run, stage))
    for name in reversed((*stage.options, *_FURTHER.get(stage.name, ()))):
        command = options[name](command)
    made = click.command(stage.name, help=stage.help)(FOLDER(command))
    keywords = signature(stage.verb).parameters
    for option in made.params:
        keyword = keywords.get(option.name or "")
        option.required = option.required or (keyword is not None and keyword.default is keyword.empty)
    return made


def _run(
    stage: FolderStage[Any],
    *,
    directory: Path,
    output: Output,
    stray: bool = False,
    base: Literal["polished", "black"] = "polished",
    compare: bool = False,
    **options: Any,
) -> None:
    """Run ``stage`` in a folder, by the verb's defaults for options not given.

    With ``stray`` stray light follows, with ``compare`` a lens that is made for the other source.
    """
    from lensforge.cli.progress import PartsProgress, StageClock

    options = {name: value for name, value in options.items() if value is not None}
    if compare and "source" not in options:
        raise InputError("--compare: with which LED? Give its ray file as --source, too")
    renewed = None
    if stage.keeps:
        kept = directory / stage.keeps
        resume_after_interrupt(kept.exists, f"goes on with what it has measured ({stage.keeps})")
    with opened(directory) as here:
        with StageClock(stage.name, quiet=output.quiet) as clock:
            heard = PartsProgress(clock, stage.counts).heard(stage.name) if stage.counts else {}
            results: list[StageResult] = [stage.run_in(here, **options, **heard)]
            for line in (*getattr(results[0], "notes", ()), *getattr(results[0], "warnings", ())):
                clock.warn(line)
            if stray:
                clock.begin("stray light")
                results.append(STRAY.run_in(here, base=base, **options))
            if compare:
                renewed = renewed_for(here, options["source"], clock, options.get("threads"))
        finish(output, here, *results, decides=stage.decides, renewed=renewed)


_FURTHER = {VERIFY.name: ("stray", "base"), EVALUATE.name: ("compare",)}  # options of what follows the stage
STAGE_COMMANDS = tuple(command_of(stage) for stage in STAGES)


@click.command()
@FOLDER
@click.option("--spacing", type=Number(), metavar="MM", help="Between the points of dense tables; default: by --error.")
@click.option("--error", type=Number(), default=10.0, metavar="NM", help="Of interpolation between the points.")
@click.option("--interpolation", type=click.Choice(["bicubic", "linear"]), default="bicubic")
@click.option(
    "--drawing",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="TOML file whose [drawing] replaces the spec's: another revision.",
)
@OPTIONS["process"]
@click.option(
    "--rays", metavar="N", type=WholeNumber(0, MOST_MODEL_RAYS), default=0, help="Rays of the LED in lens_rays.glb."
)
@with_output
def handover(
    directory: Path,
    spacing: float | None,
    error: float,
    interpolation: Literal["bicubic", "linear"],
    drawing: Path | None,
    process: Process | None,
    rays: int,
    output: Output,
) -> None:
    """Write the files that go to the shop with the STEP.

    A drawing with the findings of the check (HTML, PDF, DXF), and tables of points. Those of --process, such as a
    turned prototype of a moulded lens, are written to DIR/PROCESS.
    """
    from lensforge.cli.progress import StageClock

    with opened(directory) as here:
        run = here.to_show()
        other = None if process == run.spec.manufacture.process else process
        folder = directory if other is None else directory / other
        with StageClock("handover", quiet=output.quiet) as clock:
            made = make_handover(
                run,
                spacing_mm=spacing,
                error_nm=error,
                interpolation=interpolation,
                drawing=drawing,
                process=other,
                rays=rays,
            )
            for note in made.notes:
                clock.warn(note)
            made.save(folder)
            here.renew()
        finish_handover(output, here, made, folder)


@click.command()
@click.argument("directories", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="The page on several designs; default: compare.html.")
@with_output
def report(directories: tuple[Path, ...], out: Path | None, output: Output) -> None:
    """Build report.html from the files in DIR.

    Of several folders one page is built that compares the designs.
    """
    if len(directories) == 1 and out is not None:
        raise InputError(f"--out = {out}: the report on one design is written to its folder; give two folders or more")
    from lensforge.cli.progress import StageClock

    page = directories[0] / REPORT_FILE if len(directories) == 1 else out or Path("compare.html")
    require_own(page)  # before it is drawn
    if len(directories) > 1:
        require_writable(page)
    run = None
    with StageClock("report", quiet=output.quiet):
        if len(directories) == 1:
            run = write_report(directories[0])
        else:
            write_comparison(directories, page)
    finish_page(output, run, page)
