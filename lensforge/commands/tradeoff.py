"""``tradeoff``: what accuracy costs in time, for one scene."""

from importlib import import_module
from pathlib import Path

import click

from lensforge.commands.options import THREADS, use_threads
from lensforge.commands.printing import print_table


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@THREADS
def tradeoff(spec: Path, out: Path | None, threads: int | None) -> None:
    """Measure accuracy against time for the scene of SPEC; writes tradeoff.json and tradeoff.html."""
    content = import_module("lensforge.spec").load_spec(spec)
    directory = out or Path("cad_out") / content.name
    use_threads(threads)
    run = import_module("lensforge.tradeoff.measure").run_tradeoff
    print_table(run(content, directory, announce=lambda line: click.echo(line, err=True))["presets"])
    click.echo(f"page\t{directory / 'tradeoff.html'}")
