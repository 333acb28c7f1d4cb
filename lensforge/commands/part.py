"""Commands on a finished part: sensitivity, handover, comparison with the machined part, its correction, photometry."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from lensforge import pipeline
from lensforge.arguments import threads_of_torch
from lensforge.commands.options import FOLDER, IES_VERSION, RAYS, SCHEDULER, SEED, THREADS
from lensforge.commands.printing import conclude, finish, print_conditions, print_table, warning_line
from lensforge.commands.yield_table import print_yield
from lensforge.compared_folder import run_compare_photo, run_compare_surface, run_correct
from lensforge.errors import InputError
from lensforge.measured_part import refuse_unused
from lensforge.other_conditions import unless_own
from lensforge.sources.photometric.ies_labels import NEWEST, require_ies_version
from lensforge.spec.tolerances import read_tolerances
from lensforge.toleranced_folder import run_sensitivity, run_yield

if TYPE_CHECKING:
    _Pixel = click.ParamType[tuple[float, float]]
else:
    _Pixel = click.ParamType  # generic from click 8.4 on only


@click.command()
@FOLDER
@RAYS
@THREADS
def sensitivity(directory: Path, rays: int | None, threads: int | None) -> None:
    """Compute how each tolerance of the lens in DIR, at its end, changes its light; writes sensitivity.json."""
    from lensforge.commands.progress import PartsBar

    with threads_of_torch(threads), PartsBar("lens by lens") as bar:
        result = run_sensitivity(directory, rays=rays, progress=bar.on_parts)
    print_conditions(result)
    shown = ("nmse", "uniformity", "rsd", "efficiency")
    print_table({name: each for name, each in result.plain()["nominal"].items() if name in shown}, "as_designed.")
    click.echo("\t".join(("error", "amount", "unit", *(f"change of {name}" for name in shown))))
    for row in result.rows:
        changes = (str(getattr(row.change, name)) for name in shown)
        click.echo("\t".join((row.name, f"{row.amount:g}", row.unit, *changes)))
    conclude(directory, (result,))


@click.command("yield")
@FOLDER
@click.option("--parts", type=click.IntRange(40, 100_000), default=1000, show_default=True, help="Number of parts.")
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
def yield_(
    directory: Path,
    parts: int,
    rays: int | None,
    seed: int,
    tolerances: str | None,
    budget: bool,
    threads: int | None,
    scheduler: str | None,
) -> None:
    """Draw parts of the lens in DIR from its tolerances: how many pass, what decides; writes yield.json, yield.csv."""
    from lensforge.commands.progress import PartsBar

    other = None if tolerances is None else read_tolerances(tolerances)
    with threads_of_torch(threads), PartsBar() as bar:
        result = run_yield(
            directory,
            parts=parts,
            rays=rays,
            seed=seed,
            tolerances=other,
            budget=budget,
            scheduler=scheduler,
            progress=bar.on_parts,
            announce=bar.on_stage,
        )
    print_conditions(result)
    print_yield(result)
    conclude(directory, (result,))


@click.command()
@FOLDER
@click.option("--spacing", type=float, metavar="MM", help="Between the points of dense tables; default: by --error.")
@click.option(
    "--error", type=float, default=10.0, show_default=True, metavar="NM", help="Of interpolation between the points."
)
@click.option("--interpolation", type=click.Choice(["bicubic", "linear"]), default="bicubic", show_default=True)
@click.option("--slope", type=float, default=60.0, show_default=True, metavar="DEG", help="Where the raster ends.")
@click.option("--offset-inner", type=float, default=0.0, metavar="MM", help="Ball whose centres the tables hold.")
@click.option("--offset-outer", type=float, default=0.0, metavar="MM", help="The same for the outer face.")
def handover(
    directory: Path,
    spacing: float | None,
    error: float,
    interpolation: Literal["bicubic", "linear"],
    slope: float,
    offset_inner: float,
    offset_outer: float,
) -> None:
    """Write the files that go to the shop with the STEP in DIR: drawing and verdicts (HTML, PDF), tables of points."""
    from lensforge.drawings.grids import GridRequest

    request = GridRequest(spacing, error, interpolation, slope, offset_inner, offset_outer)
    result = pipeline.run_handover(directory, request)
    click.echo(f"files\t{', '.join(result.files)}")
    print_table({f"{each.file}.error_nm": each.error_nm for each in result.grids})
    print_table({"points": result.points, "sha256": result.sha256, "refused": [each.reason for each in result.refused]})
    conclude(directory)


class _Corner(_Pixel):
    """A pixel, written as column,row."""

    name = "x,y"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
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
    "--corners", type=_Corner(), nargs=4, help="Corners of the target, clockwise from top left; default: found."
)
@click.option(
    "--target-mm", type=click.FloatRange(0.0, min_open=True), help="Side of the target; default: that of the receiver."
)
@click.option("--gamma", type=click.FloatRange(0.2, 5.0), default=1.0, show_default=True, help="Gamma of the camera.")
@click.option("--points", type=click.Path(path_type=Path), help="Points x, y, z in mm, measured on one surface.")
@click.option("--surface", type=click.Choice(["inner", "outer"]), help="Surface on which --points lie.")
@click.option(
    "--registration",
    type=click.Choice(["rigid", "shift", "none"]),
    default="rigid",
    show_default=True,
    help="Motion that fits --points to the design.",
)
@RAYS
def compare(
    directory: Path,
    on: Path | None,
    off: Path | None,
    corners: tuple[tuple[float, float], ...] | None,
    target_mm: float | None,
    gamma: float,
    points: Path | None,
    surface: Literal["inner", "outer"] | None,
    registration: Literal["rigid", "shift", "none"],
    rays: int | None,
) -> None:
    """Compare the machined part with the design in DIR: a photograph of its light, or points on a surface."""
    of_points = {"--surface": surface, "--registration": unless_own(registration, "rigid"), "--rays": rays}
    of_photo = {"--off": off, "--corners": corners or None, "--target-mm": target_mm, "--gamma": unless_own(gamma, 1.0)}
    if on is not None and points is None:
        refuse_unused("a photograph", of_points)
        found = run_compare_photo(
            directory, on=on, off=off, corners=list(corners) if corners else None, target_mm=target_mm, gamma=gamma
        )
        finish(directory, found)
    elif points is not None and on is None:
        refuse_unused("points", of_photo)
        if surface is None:
            raise InputError("compare: --points needs --surface, inner or outer")
        measured = run_compare_surface(directory, points=points, surface=surface, registration=registration, rays=rays)
        finish(directory, measured)
    else:
        raise InputError("compare: give --on PHOTO, or --points FILE with --surface")


@click.command()
@FOLDER
@click.option(
    "--points", type=click.Path(path_type=Path), required=True, help="Points x, y, z in mm, of the first cut."
)
@click.option("--surface", type=click.Choice(["inner", "outer"]), required=True, help="Surface on which they lie.")
@click.option(
    "--wavelength",
    type=click.FloatRange(0.0, min_open=True),
    help="Shortest wave of the deviation that is corrected (mm); default: by the noise of the points.",
)
@click.option("--gain", type=float, default=1.0, show_default=True, help="Share of the deviation that is mirrored.")
@click.option(
    "--registration",
    type=click.Choice(["rigid", "shift", "none"]),
    default="rigid",
    show_default=True,
    help="Motion that fits --points to the design; it is no part of the correction.",
)
@RAYS
@THREADS
def correct(
    directory: Path,
    points: Path,
    surface: Literal["inner", "outer"],
    wavelength: float | None,
    gain: float,
    registration: Literal["rigid", "shift", "none"],
    rays: int | None,
    threads: int | None,
) -> None:
    """Write the STEP of a face corrected for its second cut by points measured on the first, lens_corrected_*.step."""
    with threads_of_torch(threads):
        made = run_correct(
            directory,
            points=points,
            surface=surface,
            wavelength_mm=wavelength,
            gain=gain,
            registration=registration,
            rays=rays,
        )
    finish(directory, made)


@click.command()
@FOLDER
@RAYS
@THREADS
@click.option(
    "--lumens", type=click.FloatRange(1e-6, 1e9), help="Flux of the LED (lm); default: the spec's, or relative to 1000."
)
@IES_VERSION
def photometry(
    directory: Path, rays: int | None, threads: int | None, lumens: float | None, ies_version: str | None
) -> None:
    """Compute lumens, candela and beam angles of the lens in DIR; write IES, EULUMDAT, TM-33 and TM-25 files."""
    version = require_ies_version(int(ies_version or NEWEST))
    with threads_of_torch(threads):
        result = pipeline.run_photometry(directory, rays=rays, lumens=lumens, ies_version=version)
    for words in result.warnings:
        click.echo(warning_line(words), err=True)
    finish(directory, result)
