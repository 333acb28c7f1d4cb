"""``design``: the whole way."""

from importlib import import_module
from pathlib import Path
from typing import Any

import click

from lensforge.commands.options import DEVICE, RAYS, THREADS, pipeline, search_device, use_threads
from lensforge.commands.printing import print_headline
from lensforge.gates import require


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@click.option(
    "--accuracy", type=click.Choice(["draft", "standard", "reference"]), default="standard", show_default=True
)
@click.option("--seed", type=click.IntRange(0, 2**20), default=0, show_default=True)
@click.option("--resume", is_flag=True, help="Go on from the checkpoint of an interrupted design.")
@click.option("--snapshots", is_flag=True, help="Draw lens and light after each level into DIR/snapshots.")
@RAYS
@THREADS
@DEVICE
def design(
    spec: Path,
    out: Path | None,
    accuracy: Any,
    seed: int,
    resume: bool,
    snapshots: bool,
    rays: int | None,
    threads: int | None,
    device: str,
) -> None:
    """Go the whole way: design, evaluate, export, check, verify, report."""
    content = import_module("lensforge.spec").load_spec(spec)
    directory = out or Path("cad_out") / content.name
    use_threads(threads)
    searched_on = search_device(device)
    observers = []
    if snapshots:
        taken = import_module("lensforge.report.snapshots").Snapshots(content, directory, resume=resume)
        observers = [taken.on_step]
    with import_module("lensforge.progress").Reporter(content, *observers) as reporter:
        gates = pipeline().run(
            content,
            directory,
            accuracy=accuracy,
            seed=seed,
            rays=rays,
            device=searched_on,
            resume=resume,
            observer=reporter.on_step,
            announce=reporter.on_stage,
        )
    click.echo(f"report\t{directory / 'report.html'}")
    print_headline(directory)
    require(gates)
