"""``sweep``: one design for each of several values of a field."""

from pathlib import Path

import click

from lensforge.commands.design import run_with_progress
from lensforge.commands.options import ACCURACY, RAYS, SEED, THREADS, with_rays
from lensforge.commands.printing import print_table
from lensforge.gates import require
from lensforge.spec import Accuracy, Spec, load_spec

_PRINTED = ("nmse", "uniformity", "efficiency", "max_radius_mm", "height_mm")


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--vary", required=True, metavar="FIELD=V1,V2,...", help="The field, and the values that it takes.")
@click.option("--scale", multiple=True, metavar="FIELD", help="A field that keeps its ratio to the varied one.")
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>_sweep.")
@ACCURACY
@SEED
@click.option("--resume", is_flag=True, help="Keep the designs that an earlier call finished, and go on.")
@RAYS
@THREADS
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
) -> None:
    """Design SPEC for each value of a field; writes sweep.json, sweep.png and sweep.html.

    \b
    lensforge sweep examples/pi.toml --vary constraints.max_radius_mm=8,10,12,14 \\
        --scale lens.inner_offset_mm --scale lens.outer_offset_mm
    """
    from lensforge.studies.sweep.runs import run_sweep
    from lensforge.studies.sweep.vary import parse_variation

    content = with_rays(load_spec(spec), rays)
    variation = parse_variation(vary, scale)
    directory = out or Path("cad_out") / f"{content.name}_sweep"

    def go(spec: Spec, folder: Path, resume: bool) -> object:
        return run_with_progress(spec, folder, accuracy=accuracy, seed=seed, threads=threads, resume=resume)

    result = run_sweep(
        content,
        variation,
        directory,
        go,
        accuracy=accuracy,
        seed=seed,
        resume=resume,
        announce=lambda line: click.echo(line, err=True),
    )
    for row in result.designs:
        figures = row.model_dump(mode="json", include=set(_PRINTED), exclude_none=True)
        print_table({key: figures[key] for key in _PRINTED if key in figures}, f"{row.folder}.")
    click.echo(f"page\t{directory / 'sweep.html'}")
    require(result.gates)
