"""``design``: a whole run, from the spec to the report."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from lensforge.cli.blocks import preview_rows
from lensforge.cli.conclusion import finish_run
from lensforge.cli.options import (
    ACCURACY,
    DEVICE,
    OPEN,
    RAYS,
    SCHEDULER,
    SEED,
    THREADS,
    resume_after_interrupt,
    with_rays,
)
from lensforge.cli.output import Output, document, print_json, with_output
from lensforge.cli.screen import Block, print_screen
from lensforge.cli.whole_number import WholeNumber
from lensforge.errors import InputError
from lensforge.results.folder_lock import locked
from lensforge.runs import pipeline, stages
from lensforge.runs.arguments import threads_of_torch
from lensforge.runs.results import REPORT_FILE
from lensforge.runs.run_folder import Run, open_run, write_result
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.spec import Accuracy, Spec, load_spec

if TYPE_CHECKING:
    from lensforge.cli.stage_clock import StageClock

_PICTURE_FILE = "light.png"  # of a preview
_PREVIEW_RAYS = 2**17  # at most: an eighth of a draft's, for figures that have 2.8 times its errors


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@ACCURACY
@SEED
@click.option("--resume", is_flag=True, help="Continue from the checkpoint of an interrupted design.")
@click.option("--snapshots", is_flag=True, help="Draw lens and light after each level into DIR/snapshots.")
@click.option("--anyway", is_flag=True, help="Design even where less than half of what a target asks is possible.")
@click.option(
    "--starts", metavar="N", type=WholeNumber(1, 1000), default=1, show_default=True, help="Searches; the best is kept."
)
@RAYS
@THREADS
@SCHEDULER
@DEVICE
@OPEN
@with_output
def design(
    spec: Path,
    out: Path | None,
    accuracy: Accuracy,
    seed: int,
    resume: bool,
    snapshots: bool,
    anyway: bool,
    starts: int,
    rays: int | None,
    threads: int | None,
    scheduler: str | None,
    device: Literal["cpu", "cuda"],
    shown: bool,
    output: Output,
) -> None:
    """Make a lens from SPEC, from the search to the report.

    The stages are design, evaluate, export, check, verify, photometry and report; all files go into one folder. An
    interrupted search continues with --resume. Lengths in the spec are in mm, angles in degrees, flux in W or lm;
    examples/ has specs to begin from.
    """
    from lensforge.cli.stage_clock import StageClock

    content = with_rays(load_spec(spec), rays)
    if snapshots and starts > 1:
        raise InputError("--snapshots: of one search; leave out --starts, and give --seed")
    directory = out or Path("cad_out") / content.name
    resume_after_interrupt(lambda: pipeline.resumable(directory))
    with StageClock("design", quiet=output.quiet) as clock:
        run = run_with_progress(
            content,
            directory,
            clock,
            accuracy=accuracy,
            seed=seed,
            threads=threads,
            device=device,
            resume=resume,
            snapshots=snapshots,
            anyway=anyway,
            starts=starts,
            scheduler=scheduler,
        )
        clock.total()
    if shown:
        click.launch(str(run.folder / REPORT_FILE))
    finish_run(output, run)


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>_preview.")
@SEED
@THREADS
@click.option("--anyway", is_flag=True, help="Search even where less than half of what a target asks is possible.")
@OPEN
@with_output
def preview(
    spec: Path,
    out: Path | None,
    seed: int,
    threads: int | None,
    anyway: bool,
    shown: bool,
    output: Output,
) -> None:
    """Search a draft of SPEC, and draw its light: a first look, without the files of a part."""
    from lensforge.cli.progress import DesignProgress
    from lensforge.cli.stage_clock import StageClock

    content = load_spec(spec)
    content = content.replace({"evaluate.rays": min(content.evaluate.rays or _PREVIEW_RAYS, _PREVIEW_RAYS)})
    directory = out or Path("cad_out") / f"{content.name}_preview"
    with StageClock("design", quiet=output.quiet) as clock:
        told = DesignProgress(clock, content)
        with locked(directory, create=True), threads_of_torch(threads):
            made = stages.design(
                content, accuracy="draft", seed=seed, progress=told.on_step, warn=clock.warn, anyway=anyway
            )
            pipeline.write_design(made, directory)
            clock.begin("evaluate")
            write_result(stages.evaluate(made.lens), directory).save(directory / _PICTURE_FILE)
            run = open_run(directory)
        clock.total()
    if shown:
        click.launch(str(directory / _PICTURE_FILE))
    if output.json:
        print_json(document(run, run.design, run.light))
    elif output.screen:
        picture = ("Picture", str(directory / _PICTURE_FILE))
        print_screen([Block(f"{content.name}: a draft, {run.design.steps} steps", [*preview_rows(run), picture])])


def run_with_progress(
    spec: Spec,
    directory: Path,
    clock: "StageClock",
    *,
    accuracy: Accuracy,
    seed: int,
    threads: int | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    resume: bool = False,
    snapshots: bool = False,
    anyway: bool = False,
    starts: int = 1,
    scheduler: str | None = None,
) -> Run:
    """Call ``pipeline.run`` with its progress on ``clock``; ``resume``: from the checkpoint in ``directory``.

    Raises :class:`InputError` where there is no checkpoint to resume from.
    """
    from lensforge.cli.progress import DesignProgress
    from lensforge.report.snapshots import Snapshots

    checkpoint = directory / CHECKPOINT
    if resume and not checkpoint.exists():
        raise InputError(f"{checkpoint}: no checkpoint to resume from; run without --resume")
    observers = [Snapshots(spec, directory, resume=resume).on_step] if snapshots else []
    shown = DesignProgress(clock, spec, *observers)
    return pipeline.run(
        spec,
        directory,
        accuracy=accuracy,
        seed=seed,
        threads=threads,
        checkpoint=checkpoint if resume else None,
        progress=shown.on_step,
        device=device,
        announce=shown.on_stage,
        ended=shown.on_end,
        warn=clock.warn,
        anyway=anyway,
        starts=starts,
        scheduler=scheduler,
    )
