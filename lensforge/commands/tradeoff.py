"""``tradeoff``: what accuracy costs in time, for one scene."""

from pathlib import Path

import click

from lensforge.arguments import threads_of_torch
from lensforge.commands.options import THREADS
from lensforge.commands.printing import print_table
from lensforge.spec import load_spec


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@click.option(
    "--most-rays",
    type=click.IntRange(2**12, 2**24),
    default=2**20,
    show_default=True,
    help="The longest runs of the rays' ladder; 2^24 takes some minutes.",
)
@THREADS
def tradeoff(spec: Path, out: Path | None, most_rays: int, threads: int | None) -> None:
    """Measure accuracy against time for the scene of SPEC; writes tradeoff.json and tradeoff.html."""
    content = load_spec(spec)
    directory = out or Path("cad_out") / content.name

    from lensforge.studies.tradeoff.measure import Effort, run_tradeoff

    with threads_of_torch(threads):
        effort = Effort.up_to(most_rays)
        found = run_tradeoff(content, directory, effort=effort, announce=lambda line: click.echo(line, err=True))
    print_table(found.model_dump(mode="json", include={"presets"})["presets"])
    click.echo(f"page\t{directory / 'tradeoff.html'}")
