"""Commands on a finished part: handover, comparison with the machined part, its correction, photometry."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from lensforge.cli.conclusion import finish, finish_handover
from lensforge.cli.options import FOLDER, IES_VERSION, RAYS, THREADS
from lensforge.cli.output import Output, with_output
from lensforge.errors import InputError
from lensforge.made.measurement_result import PhotoComparison, SurfaceComparison
from lensforge.runs import pipeline
from lensforge.runs.arguments import threads_of_torch
from lensforge.runs.compared_folder import run_compare_photo, run_compare_surface, run_correct
from lensforge.runs.measured_part import refuse_unused
from lensforge.runs.other_conditions import unless_own
from lensforge.sources.photometric.ies import NEWEST, require_ies_version
from lensforge.spec.part_section import read_drawing

if TYPE_CHECKING:
    _Pixel = click.ParamType[tuple[float, float]]
else:
    _Pixel = click.ParamType  # generic from click 8.4 on only


@click.command()
@FOLDER
@click.option("--spacing", type=float, metavar="MM", help="Between the points of dense tables; default: by --error.")
@click.option(
    "--error", type=float, default=10.0, show_default=True, metavar="NM", help="Of interpolation between the points."
)
@click.option("--interpolation", type=click.Choice(["bicubic", "linear"]), default="bicubic", show_default=True)
@click.option("--offset-inner", type=float, default=0.0, metavar="MM", help="Ball whose centres the tables hold.")
@click.option("--offset-outer", type=float, default=0.0, metavar="MM", help="The same for the outer face.")
@click.option(
    "--drawing",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="TOML file whose [drawing] replaces the spec's: another revision.",
)
@with_output
def handover(
    directory: Path,
    spacing: float | None,
    error: float,
    interpolation: Literal["bicubic", "linear"],
    offset_inner: float,
    offset_outer: float,
    drawing: Path | None,
    output: Output,
) -> None:
    """Write the files that go to the shop with the STEP.

    A drawing with the findings of the check (HTML, PDF, DXF), and tables of points.
    """
    from lensforge.cli.stage_clock import StageClock
    from lensforge.shop.dense_table import GridRequest

    words = None if drawing is None else read_drawing(drawing)
    request = GridRequest(spacing, error, interpolation, offset_inner, offset_outer)
    with StageClock("handover", quiet=output.quiet):
        result = pipeline.run_handover(directory, request, words)
    finish_handover(output, directory, result)


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
@with_output
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
    output: Output,
) -> None:
    """Compare the machined part with the design in DIR.

    By a photograph of its light (--on), or by points measured on a surface (--points).
    """
    from lensforge.cli.stage_clock import StageClock

    of_points = {"--surface": surface, "--registration": unless_own(registration, "rigid"), "--rays": rays}
    of_photo = {"--off": off, "--corners": corners or None, "--target-mm": target_mm, "--gamma": unless_own(gamma, 1.0)}
    found: PhotoComparison | SurfaceComparison
    with StageClock("compare", quiet=output.quiet):
        if on is not None and points is None:
            refuse_unused("a photograph", of_points)
            given = list(corners) if corners else None
            found = run_compare_photo(directory, on=on, off=off, corners=given, target_mm=target_mm, gamma=gamma)
        elif points is not None and on is None:
            refuse_unused("points", of_photo)
            if surface is None:
                raise InputError("compare: --points needs --surface, inner or outer")
            found = run_compare_surface(directory, points=points, surface=surface, registration=registration, rays=rays)
        else:
            raise InputError("compare: give --on PHOTO, or --points FILE with --surface")
    finish(output, directory, found)


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
@with_output
def correct(
    directory: Path,
    points: Path,
    surface: Literal["inner", "outer"],
    wavelength: float | None,
    gain: float,
    registration: Literal["rigid", "shift", "none"],
    rays: int | None,
    threads: int | None,
    output: Output,
) -> None:
    """Correct a face for its second cut by measured points.

    Writes lens_corrected_inner.step or lens_corrected_outer.step from points measured on the first cut.
    """
    from lensforge.cli.stage_clock import StageClock

    with StageClock("correct", quiet=output.quiet), threads_of_torch(threads):
        made = run_correct(
            directory,
            points=points,
            surface=surface,
            wavelength_mm=wavelength,
            gain=gain,
            registration=registration,
            rays=rays,
        )
    finish(output, directory, made)


@click.command()
@FOLDER
@RAYS
@THREADS
@with_output
@click.option(
    "--lumens", type=click.FloatRange(1e-6, 1e9), help="Flux of the LED (lm); default: the spec's, or relative to 1000."
)
@IES_VERSION
def photometry(
    directory: Path,
    rays: int | None,
    threads: int | None,
    lumens: float | None,
    ies_version: str | None,
    output: Output,
) -> None:
    """Compute lumens, candela and beam angles of the lens in DIR; write IES, EULUMDAT, TM-33 and TM-25 files."""
    from lensforge.cli.stage_clock import StageClock

    version = require_ies_version(int(ies_version or NEWEST))
    with StageClock("photometry", quiet=output.quiet) as clock, threads_of_torch(threads):
        result = pipeline.run_photometry(directory, rays=rays, lumens=lumens, ies_version=version)
        for words in result.warnings:
            clock.warn(words)
    finish(output, directory, result)
