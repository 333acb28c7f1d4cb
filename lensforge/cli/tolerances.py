"""Commands on the tolerances of a lens: ``sensitivity``, one at a time, and ``yield``, all together."""

from pathlib import Path

import click

from lensforge.cli.conclusion import finish
from lensforge.cli.options import FOLDER, RAYS, SCHEDULER, SEED, THREADS
from lensforge.cli.output import Output, with_output
from lensforge.cli.whole_number import WholeNumber
from lensforge.runs.arguments import threads_of_torch
from lensforge.runs.toleranced_folder import run_sensitivity, run_yield
from lensforge.spec.tolerances_section import read_tolerances


@click.command()
@FOLDER
@RAYS
@THREADS
@with_output
def sensitivity(directory: Path, rays: int | None, threads: int | None, output: Output) -> None:
    """Change each tolerance of the lens in DIR, one at a time.

    Each is set to its end; the change of the light goes to sensitivity.json.
    """
    from lensforge.cli.progress import PartsProgress
    from lensforge.cli.stage_clock import StageClock

    with StageClock("sensitivity", quiet=output.quiet, study=True) as clock, threads_of_torch(threads):
        progress = PartsProgress(clock, "lenses")
        result = run_sensitivity(directory, rays=rays, progress=progress.on_parts)
    finish(output, directory, result)


@click.command("yield")
@FOLDER
@click.option(
    "--parts", type=WholeNumber(40, 100_000), metavar="N", default=1000, show_default=True, help="Number of parts."
)
@RAYS
@SEED
@click.option(
    "--tolerances",
    metavar="PRESET|FILE",
    help="Others than the spec's: precision, standard, moulded, or a TOML file with [tolerances].",
)
@click.option("--budget/--no-budget", default=True, show_default=True, help="Largest amount of each tolerance.")
@THREADS
@SCHEDULER
@with_output
def yield_(
    directory: Path,
    parts: int,
    rays: int | None,
    seed: int,
    tolerances: str | None,
    budget: bool,
    threads: int | None,
    scheduler: str | None,
    output: Output,
) -> None:
    """Draw parts of the lens in DIR from its tolerances.

    The share that passes, which tolerance decides, and how large each may be; writes yield.json, yield.csv and
    yield.html. An interrupted study goes on where it was.
    """
    from lensforge.cli.progress import PartsProgress
    from lensforge.cli.stage_clock import StageClock

    other = None if tolerances is None else read_tolerances(tolerances)
    with StageClock("yield", quiet=output.quiet, study=True) as clock, threads_of_torch(threads):
        progress = PartsProgress(clock)
        result = run_yield(
            directory,
            parts=parts,
            rays=rays,
            seed=seed,
            tolerances=other,
            budget=budget,
            scheduler=scheduler,
            progress=progress.on_parts,
            announce=progress.on_stage,
        )
    finish(output, directory, result)
