"""``sweep``: one design for each of several values of a field."""

from importlib import import_module
from pathlib import Path
from typing import Any

import click

from lensforge.commands.options import RAYS, THREADS, pipeline, use_threads
from lensforge.commands.printing import print_table
from lensforge.gates import require

_PRINTED = ("nmse", "uniformity", "efficiency", "max_radius_mm", "height_mm")


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--vary", required=True, metavar="FIELD=V1,V2,...", help="The field, and the values that it takes.")
@click.option("--scale", multiple=True, metavar="FIELD", help="A field that keeps its ratio to the varied one.")
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>_sweep.")
@click.option(
    "--accuracy", type=click.Choice(["draft", "standard", "reference"]), default="standard", show_default=True
)
@click.option("--seed", type=click.IntRange(0, 2**20), default=0, show_default=True)
@click.option("--resume", is_flag=True, help="Keep the designs that an earlier call finished, and go on.")
@RAYS
@THREADS
def sweep(
    spec: Path,
    vary: str,
    scale: tuple[str, ...],
    out: Path | None,
    accuracy: Any,
    seed: int,
    resume: bool,
    rays: int | None,
    threads: int | None,
) -> None:
    """Design SPEC for each value of a field; writes sweep.json, sweep.png and sweep.html.

    \b
    lensforge sweep examples/pi.toml --vary constraints.max_radius_mm=8,10,12,14 \\
        --scale lens.inner_offset_mm --scale lens.outer_offset_mm
    """
    content = import_module("lensforge.spec").load_spec(spec)
    variation = import_module("lensforge.studies.sweep.vary").parse_variation(vary, scale)
    runs = import_module("lensforge.studies.sweep.runs")
    directory = out or Path("cad_out") / f"{content.name}_sweep"
    use_threads(threads)
    result = runs.run_sweep(
        content,
        variation,
        directory,
        _whole_way,
        settings=runs.Settings(accuracy, seed, rays),
        resume=resume,
        announce=lambda line: click.echo(line, err=True),
    )
    for row in result["designs"]:
        print_table({key: row[key] for key in _PRINTED if row[key] is not None}, f"{row['folder']}.")
    click.echo(f"page\t{directory / 'sweep.html'}")
    require(runs.gates_of_sweep(result))


def _whole_way(spec: Any, directory: Path, settings: Any, resume: bool) -> None:
    """``pipeline.run`` with its progress on stderr."""
    with import_module("lensforge.progress").Reporter(spec) as reporter:
        pipeline().run(
            spec,
            directory,
            **vars(settings),
            resume=resume,
            observer=reporter.on_step,
            announce=reporter.on_stage,
        )
