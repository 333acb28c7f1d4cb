"""``sweep`` and ``tradeoff``: one field of a spec varied, and accuracy against time."""

from pathlib import Path

import click

from lensforge.cli.blocks import study_block
from lensforge.cli.conclusion import finish_study
from lensforge.cli.design import run_with_progress
from lensforge.cli.options import ACCURACY, RAYS, SCHEDULER, SEED, THREADS, resume_after_interrupt, with_rays
from lensforge.cli.output import Output, with_output
from lensforge.cli.whole_number import WholeNumber
from lensforge.results.arguments import threads_of_torch
from lensforge.results.criteria import require
from lensforge.spec import Accuracy, Spec, load_spec


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
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

    Writes sweep.json, sweep.png and sweep.html.

    \b
    lensforge sweep examples/pi.toml --vary constraints.max_radius_mm=8,10,12,14 \\
        --scale lens.inner_offset_mm --scale lens.outer_offset_mm
    """
    from lensforge.cli.stage_clock import StageClock
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
    block = study_block(f"{result.vary}, {len(result.designs)} designs", result.facts)
    finish_study(output, directory, result, block, "sweep.html")
    require(result.criteria)


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
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

    from lensforge.cli.progress import StudyProgress
    from lensforge.cli.stage_clock import StageClock
    from lensforge.report.tradeoff_study import run_tradeoff

    with StageClock("tradeoff", quiet=output.quiet, study=True) as clock, threads_of_torch(threads):
        announce = StudyProgress(clock).on_stage
        found = run_tradeoff(content, directory, most_rays=most_rays, announce=announce)
    block = study_block("Error of each preset on this scene", found.facts)
    finish_study(output, directory, found, block, "tradeoff.html")
