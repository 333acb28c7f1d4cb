"""Around the part: sensitivity, handover to the shop, the measured part, its photometry."""

from importlib import import_module
from pathlib import Path
from typing import Any

import click

from lensforge.commands.options import FOLDER, RAYS, THREADS, pipeline, use_threads
from lensforge.commands.printing import finish
from lensforge.errors import InputError


@click.command()
@FOLDER
@RAYS
@THREADS
def sensitivity(directory: Path, rays: int | None, threads: int | None) -> None:
    """Say what errors of form, position and index of the lens in DIR do to its light; writes sensitivity.json."""
    use_threads(threads)
    result = pipeline().run_sensitivity(directory, rays=rays)
    click.echo("error\tamount\tunit\tnmse\tuniformity\tefficiency")
    for row in ({"name": "as designed", "amount": 0.0, "unit": "", **result["nominal"]}, *result["rows"]):
        click.echo("\t".join(str(row[key]) for key in ("name", "amount", "unit", "nmse", "uniformity", "efficiency")))


@click.command()
@FOLDER
def handover(directory: Path) -> None:
    """Write what goes to the shop with the STEP in DIR: drawing, verdicts, points.csv, hashes; HTML and PDF."""
    finish(pipeline().run_handover(directory), directory)


class _Corner(click.ParamType):
    """A pixel, written as column,row."""

    name = "x,y"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[float, float]:
        try:
            column, row = (float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r}: write column,row in pixels, such as 120.5,88", param, ctx)
        return column, row


@click.command()
@FOLDER
@click.option("--on", type=click.Path(path_type=Path), help="Photograph of the target with the LED on.")
@click.option("--off", type=click.Path(path_type=Path), help="The same with the LED off.")
@click.option(
    "--corners", type=_Corner(), nargs=4, help="Target corners in it: top left, and on clockwise; default: found."
)
@click.option("--target-mm", type=click.FloatRange(0.0, min_open=True), help="Side of the square of --corners.")
@click.option("--gamma", type=click.FloatRange(0.2, 5.0), default=1.0, show_default=True, help="Of the camera.")
@click.option("--points", type=click.Path(path_type=Path), help="Points x, y, z in mm, measured on one surface.")
@click.option("--surface", type=click.Choice(["inner", "outer"]), help="The surface of --points.")
@click.option(
    "--registration",
    type=click.Choice(["rigid", "shift", "none"]),
    default="rigid",
    show_default=True,
    help="How --points may be moved onto the design.",
)
@RAYS
def compare(directory: Path, on: Path | None, points: Path | None, rays: int | None, **options: Any) -> None:
    """Compare the machined part with the design in DIR: a photograph of its light, or points on a surface."""
    if (on is None) == (points is None):
        raise InputError("compare: give --on PHOTO, or --points FILE with --surface")
    if on is not None:
        shot = {name: options[name] for name in ("off", "corners", "target_mm", "gamma")}
        result = pipeline().run_compare_photo(directory, on=on, **shot)
    else:
        if not options["surface"]:
            raise InputError("compare: --points needs --surface, inner or outer")
        chosen = {name: options[name] for name in ("surface", "registration")}
        result = pipeline().run_compare_surface(directory, points=points, rays=rays, **chosen)
    finish(result, directory)


@click.command()
@FOLDER
@RAYS
@THREADS
@click.option("--lumens", type=click.FloatRange(1e-6, 1e9), help="Of the LED; default: by the spec, or 1000.")
def photometry(directory: Path, rays: int | None, threads: int | None, lumens: float | None) -> None:
    """Write the light of the lens in DIR as IES, EULUMDAT and TM-25 files."""
    use_threads(threads)
    export = import_module("lensforge.far_field.export").export_photometry
    finish(export(directory, rays=rays, lumens=lumens), directory)
