"""``design``: a whole run, from the spec to the report; ``preview``: a first look."""

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

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
    SPEC,
    THREADS,
    resume_after_interrupt,
    with_force,
    with_rays,
)
from lensforge.cli.output import Output, document, print_json, with_output
from lensforge.cli.screen import Block, print_screen
from lensforge.cli.whole_number import WholeNumber
from lensforge.errors import InputError
from lensforge.light.lens_light import evaluate
from lensforge.report.results import REPORT_FILE
from lensforge.runs import pipeline
from lensforge.runs.folder import Run, opened
from lensforge.search import searches
from lensforge.search.checkpoint import CHECKPOINT, is_checkpoint
from lensforge.search.searches import SearchOptions
from lensforge.spec import Spec, load_spec

if TYPE_CHECKING:
    from lensforge.cli.stage_clock import StageClock

_PICTURE_FILE = "light.png"  # of a preview
_PREVIEW_RAYS = 2**17  # at most: an eighth of a draft's, for figures that have 2.8 times its errors


@click.command()
@SPEC
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@ACCURACY
@SEED
@click.option("--resume", is_flag=True, help="Continue from the checkpoint of an interrupted design.")
@with_force
@click.option("--starts", metavar="N", type=WholeNumber(1, 1000), default=1, help="Searches; the best is kept.")
@RAYS
@THREADS
@SCHEDULER
@DEVICE
@OPEN
@with_output
def design(
    spec: Path,
    out: Path | None,
    resume: bool,
    starts: int,
    rays: int | None,
    scheduler: str | None,
    shown: bool,
    output: Output,
    **options: Unpack[SearchOptions],
) -> None:
    """Make a lens from SPEC, from the search to the report.

    The stages are design, evaluate, export, check, verify, photometry and report; all files go into one folder. An
    interrupted search continues with --resume. Lengths in the spec are in mm, angles in degrees, flux in W or lm;
    examples/ has specs to begin from.
    """
    from lensforge.cli.stage_clock import StageClock

    content = with_rays(load_spec(spec), rays)
    directory = out or Path("cad_out") / content.name
    resume_after_interrupt(lambda: is_checkpoint(directory / CHECKPOINT))
    with StageClock("design", quiet=output.quiet) as clock:
        run = run_with_progress(content, directory, clock, resume=resume, starts=starts, scheduler=scheduler, **options)
        clock.total()
    if shown:
        click.launch(str(run.folder / REPORT_FILE))
    finish_run(output, run)


@click.command()
@SPEC
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>_preview.")
@SEED
@THREADS
@with_force
@OPEN
@with_output
def preview(spec: Path, out: Path | None, shown: bool, output: Output, **options: Unpack[SearchOptions]) -> None:
    """Search a draft of SPEC, and draw its light: a first look, without the files of a part."""
    from lensforge.cli.progress import DesignProgress
    from lensforge.cli.stage_clock import StageClock

    content = load_spec(spec)
    content = content.replace({"evaluate.rays": min(content.evaluate.rays or _PREVIEW_RAYS, _PREVIEW_RAYS)})
    directory = out or Path("cad_out") / f"{content.name}_preview"
    with StageClock("design", quiet=output.quiet) as clock:
        heard = DesignProgress(clock, content)
        with opened(directory, create=True) as here:
            options.update({"accuracy": "draft", "progress": heard.on_step, "warn": clock.warn})
            made = here.write(searches.design(content, **options))
            clock.begin("evaluate")
            light = here.write(evaluate(made.lens, threads=options.get("threads")))
            light.save(directory / _PICTURE_FILE)
            run = here.run
        clock.total()
    if shown:
        click.launch(str(directory / _PICTURE_FILE))
    if output.json:
        print_json(document(run, made, light))
    elif output.screen:
        picture = ("Picture", str(directory / _PICTURE_FILE))
        print_screen([Block(f"{content.name}: a draft, {run.design.steps} steps", [*preview_rows(run), picture])])


def run_with_progress(
    spec: Spec,
    directory: Path,
    clock: "StageClock",
    *,
    resume: bool = False,
    starts: int = 1,
    scheduler: str | None = None,
    **options: Unpack[SearchOptions],
) -> Run:
    """Call ``pipeline.run`` with its progress on ``clock``; ``resume``: from the checkpoint in ``directory``.

    Raises :class:`InputError` where there is no checkpoint to resume from.
    """
    from lensforge.cli.progress import DesignProgress

    checkpoint = directory / CHECKPOINT
    if resume and not checkpoint.exists():
        raise InputError(f"{checkpoint}: no checkpoint to resume from; run without --resume")
    heard = DesignProgress(clock, spec)
    options.update({"checkpoint": checkpoint if resume else None, "progress": heard.on_step, "warn": clock.warn})
    return pipeline.run(
        spec, directory, announce=heard.on_stage, ended=heard.on_end, starts=starts, scheduler=scheduler, **options
    )
