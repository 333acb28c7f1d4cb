"""Commands that design: ``design``, a whole run; ``preview``, a first look; ``sweep`` and ``tradeoff``, studies."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from lensforge.cli.conclusion import document, finish_run, finish_study, preview_rows
from lensforge.cli.options import (
    ACCURACY,
    DEVICE,
    OPEN,
    RAYS,
    SCHEDULER,
    SEED,
    SPEC,
    THREADS,
    WholeNumber,
    resume_after_interrupt,
    with_force,
    with_rays,
)
from lensforge.cli.output import Block, Output, with_output
from lensforge.errors import InputError
from lensforge.light.lens_light import evaluate
from lensforge.report import pipeline
from lensforge.report.folder import Run, opened
from lensforge.report.results import REPORT_FILE
from lensforge.results.arguments import threads_of_torch
from lensforge.results.criteria import require
from lensforge.search import searches
from lensforge.search.checkpoint import CHECKPOINT, is_checkpoint
from lensforge.search.searches import SearchOptions
from lensforge.spec import Accuracy, Spec, load_spec

if TYPE_CHECKING:
    from lensforge.cli.progress import StageClock

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
    from lensforge.cli.progress import StageClock

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
    """Search a draft of SPEC in fewer steps, and draw its light: a first look, without the files of a part."""
    from lensforge.cli.progress import DesignProgress, StageClock

    content = load_spec(spec)
    content = content.replace({"evaluate.rays": min(content.evaluate.rays or _PREVIEW_RAYS, _PREVIEW_RAYS)})
    directory = out or Path("cad_out") / f"{content.name}_preview"
    with StageClock("design", quiet=output.quiet) as clock:
        heard = DesignProgress(clock, content)
        with opened(directory, create=True) as here:
            options.update({"accuracy": "draft", "preview": True, "progress": heard.on_step, "warn": clock.warn})
            made = here.write(searches.design(content, **options))
            clock.begin("evaluate")
            light = here.write(evaluate(made.lens, threads=options.get("threads")))
            light.save(directory / _PICTURE_FILE)
            run = here.run
        clock.total()
    if shown:
        click.launch(str(directory / _PICTURE_FILE))
    title, picture = f"{content.name}: a draft, {run.design.steps} steps", ("Picture", str(directory / _PICTURE_FILE))
    output.show(lambda: document(run, made, light), lambda: [Block(title, [*preview_rows(run), picture])])


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
    """Run with progress on ``clock``. Raises :class:`InputError` where there is no checkpoint to ``resume`` from."""
    from lensforge.cli.progress import DesignProgress

    checkpoint = directory / CHECKPOINT
    if resume and not checkpoint.exists():
        raise InputError(f"{checkpoint}: no checkpoint to resume from; run without --resume")
    heard = DesignProgress(clock, spec)
    options.update({"checkpoint": checkpoint if resume else None, "progress": heard.on_step, "warn": clock.warn})
    return pipeline.run(
        spec, directory, announce=heard.on_stage, ended=heard.on_end, starts=starts, scheduler=scheduler, **options
    )


@click.command()
@SPEC
@click.option("--vary", required=True, metavar="FIELD=V1,V2,...", help="The field and its values.")
@click.option("--scale", multiple=True, metavar="FIELD", help="A field that keeps its ratio to the varied one.")
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>_sweep.")
@ACCURACY
@SEED
@click.option("--resume", is_flag=True, help="Keep the designs that an earlier call finished, and continue.")
@RAYS
@THREADS
@SCHEDULER
@with_output
def sweep(
    spec: Path,
    vary: str,
    scale: tuple[str, ...],
    out: Path | None,
    accuracy: Accuracy,
    seed: int,
    resume: bool,
    rays: int | None,
    threads: int | None,
    scheduler: str | None,
    output: Output,
) -> None:
    """Design SPEC for each value of one field.

    Writes sweep.json and sweep.html.

    \b
    lensforge sweep examples/pi.toml --vary constraints.max_radius_mm=8,10,12,14 \\
        --scale lens.inner.offset_mm --scale lens.outer.offset_mm
    """
    from lensforge.cli.progress import StageClock
    from lensforge.report.sweep import parse_variation
    from lensforge.report.sweep_runs import resumable, run_sweep

    content = with_rays(load_spec(spec), rays)
    variation = parse_variation(vary, scale)
    directory = out or Path("cad_out") / f"{content.name}_sweep"
    resume_after_interrupt(lambda: resumable(directory))

    with StageClock("sweep", quiet=output.quiet, study=True) as clock:

        def run_design(spec: Spec, folder: Path, resume: bool) -> object:
            clock.begin("design")
            return run_with_progress(spec, folder, clock, accuracy=accuracy, seed=seed, threads=threads, resume=resume)

        result = run_sweep(
            content,
            variation,
            directory,
            run_design,
            accuracy=accuracy,
            seed=seed,
            resume=resume,
            scheduler=scheduler,
            announce=clock.head,
        )
    finish_study(output, directory, result, f"{result.vary}, {len(result.designs)} designs", "sweep.html")
    require(result.criteria)


@click.command()
@SPEC
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@click.option(
    "--most-rays",
    metavar="N",
    type=WholeNumber(2**12, 2**24),
    default=2**20,
    show_default=True,
    help="Rays of the longest evaluation; 2^24 takes a minute.",
)
@THREADS
@with_output
def tradeoff(spec: Path, out: Path | None, most_rays: int, threads: int | None, output: Output) -> None:
    """Measure accuracy against time for the scene of SPEC.

    Writes tradeoff.json and tradeoff.html.
    """
    content = load_spec(spec)
    directory = out or Path("cad_out") / content.name

    from lensforge.cli.progress import StageClock
    from lensforge.report.tradeoff_study import run_tradeoff

    with StageClock("tradeoff", quiet=output.quiet, study=True) as clock, threads_of_torch(threads):
        begin = partial(clock.begin, "study")
        found = run_tradeoff(content, directory, most_rays=most_rays, announce=begin, warn=clock.warn)
    finish_study(output, directory, found, "Error of each preset on this scene", "tradeoff.html")
