"""``design``: a whole run, from the spec to the report."""

from pathlib import Path
from typing import Literal

import click

from lensforge import pipeline
from lensforge.commands.options import (
    ACCURACY,
    DEVICE,
    RAYS,
    SCHEDULER,
    SEED,
    THREADS,
    resume_after_interrupt,
    with_rays,
)
from lensforge.commands.printing import print_headline, print_table, require_pass
from lensforge.errors import InputError
from lensforge.optimisation.checkpoint import CHECKPOINT
from lensforge.results import REPORT_FILE
from lensforge.run_folder import Run
from lensforge.spec import Accuracy, Spec, load_spec


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@ACCURACY
@SEED
@click.option("--resume", is_flag=True, help="Continue from the checkpoint of an interrupted design.")
@click.option("--snapshots", is_flag=True, help="Draw lens and light after each level into DIR/snapshots.")
@click.option("--anyway", is_flag=True, help="Design even where less than half of what a target asks is possible.")
@click.option(
    "--starts", type=click.IntRange(1, 1000), default=1, show_default=True, help="Searches; the best is kept."
)
@RAYS
@THREADS
@SCHEDULER
@DEVICE
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
) -> None:
    """Make a lens from SPEC: design, evaluate, export, check, verify, report."""
    content = with_rays(load_spec(spec), rays)
    if snapshots and starts > 1:
        raise InputError("--snapshots: of one search; leave out --starts, and give --seed")
    directory = out or Path("cad_out") / content.name
    resume_after_interrupt(lambda: pipeline.resumable(directory))
    run = run_with_progress(
        content,
        directory,
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
    print_starts(run)
    click.echo(f"report\t{directory / REPORT_FILE}")
    print_headline(run)
    require_pass(directory)


def run_with_progress(
    spec: Spec,
    directory: Path,
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
    """Call ``pipeline.run`` with its progress on stderr; ``resume``: from the checkpoint in ``directory``.

    Raises :class:`InputError` where there is no checkpoint to resume from.
    """
    from lensforge.commands.progress import Reporter
    from lensforge.report.snapshots import Snapshots

    checkpoint = directory / CHECKPOINT
    if resume and not checkpoint.exists():
        raise InputError(f"{checkpoint}: no checkpoint to resume from; run without --resume")
    observers = [Snapshots(spec, directory, resume=resume).on_step] if snapshots else []
    with Reporter(spec, *observers) as reporter:
        return pipeline.run(
            spec,
            directory,
            accuracy=accuracy,
            seed=seed,
            threads=threads,
            checkpoint=checkpoint if resume else None,
            progress=reporter.on_step,
            device=device,
            announce=reporter.on_stage,
            warn=reporter.on_warning,
            anyway=anyway,
            starts=starts,
            scheduler=scheduler,
        )


def print_starts(run: Run) -> None:
    """Print the figures of every start, and how far they scatter, where there were several."""
    if run.design.spread is None:
        return
    for start in run.design.starts:
        shown = start.model_dump(mode="json", include={"nmse", "efficiency", "missed"})
        print_table(shown, f"starts.{start.seed}.")
    print_table({"kept_seed": run.lens.seed, "merit_spread": run.design.spread}, "starts.")
