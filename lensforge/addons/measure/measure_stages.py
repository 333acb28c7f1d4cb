"""The stages of a result folder, and their commands: ``compare``, ``correct`` and ``infer``."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lensforge.addons.measure.measure_verbs import (
    FEWEST_PIXELS,
    MOST_PIXELS,
    PIXELS,
    RAYS,
    compare,
    correct,
    infer,
)
from lensforge.cli.options import Number, WholeNumber
from lensforge.cli.stages import command_of
from lensforge.report.folder import RunFolder
from lensforge.report.results import Results
from lensforge.verbs import FolderStage

if TYPE_CHECKING:
    _Pixel = click.ParamType[tuple[float, float]]
else:
    _Pixel = click.ParamType  # generic from click 8.4 on only
_FILE = click.Path(path_type=Path)


class _Corner(_Pixel):
    name = "x,y"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        try:
            column, row = (float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r}: write column,row in pixels, such as 120.5,88", param, ctx)
        return column, row


def _measured(run: Results, options: Mapping[str, Any]) -> tuple[object, ...]:
    """Part of a run that a measurement is compared with: the light with a photograph, else the lens."""
    return (run.light,) if options.get("on") is not None else (run.lens,)


def _lens_of_photo(folder: RunFolder, options: Mapping[str, Any]) -> dict[str, object]:
    return {"lens": folder.run.lens} if options.get("on") is not None else {}


COMPARE = FolderStage(
    "compare",
    compare,
    """Compare the machined part with the design in DIR.

    By a photograph of its light (--on), or by points measured on a surface (--points).
    """,
    options=("on", "off", "corners", "target_mm", "gamma", "led", "points", "surface", "registration", "rays"),
    inputs=_measured,
    settings=_lens_of_photo,
)
CORRECT = FolderStage(
    "correct",
    correct,
    """Correct a face for its second cut by measured points, or by pictures.

    Writes lens_corrected_FACE.step from points measured on the first cut, or from its errors that infer read from
    pictures of its light (--inferred).
    """,
    options=("points", "inferred", "surface", "wavelength_mm", "gain", "registration", "rays", "threads"),
)
INFER = FolderStage(
    "infer",
    infer,
    """Infer errors of the made lens from pictures of its light.

    Form of both faces, decentre, gap, tilt, place of the LED, and index, each with its standard error, from photographs
    of the target with the LED moved: --pictures for each, --poses for the LED's places in their order.
    """,
    options=("pictures", "poses", "off", "corners", "gamma", "expected_um", "rays", "pixels", "threads"),
)

_OPTIONS = {
    "pictures": click.option("--pictures", type=_FILE, multiple=True, help="Photograph with the LED on; repeat it."),
    "poses": click.option("--poses", type=_FILE, help="Table of the LED’s x, y, z in mm, a row for each picture."),
    "expected_um": click.option(
        "--expected",
        "expected_um",
        type=Number(0.0, min_open=True),
        metavar="UM",
        default=5.0,
        help="Form error that is expected of a face, rms (µm).",
    ),
    "on": click.option("--on", type=_FILE, help="Photograph of the target with the LED on."),
    "off": click.option("--off", type=_FILE, help="The same with the LED off."),
    "corners": click.option(
        "--corners",
        type=_Corner(),
        nargs=4,
        callback=lambda _context, _option, given: list(given) if given else None,
        help="Corners of the target, clockwise from top left; default: found.",
    ),
    "target_mm": click.option(
        "--target-mm", type=Number(0.0, min_open=True), help="Side of the target; default: the receiver's."
    ),
    "gamma": click.option("--gamma", type=Number(0.2, 5.0), default=1.0, help="Gamma of the camera."),
    "led": click.option("--led", metavar="NAME", help="LED in the photographs, of several; default: the first."),
    "points": click.option(
        "--points",
        type=_FILE,
        help="Points x, y, z in mm on one surface; or folder of them, a file a part, CAVITY_PART.",
    ),
    "inferred": click.option("--inferred", type=_FILE, help="Errors by pictures: the infer.json of this lens."),
    "surface": click.option("--surface", metavar="FACE", help="Face that was measured, such as inner or outer."),
    "registration": click.option(
        "--registration",
        type=click.Choice(["rigid", "shift", "none"]),
        default="rigid",
        help="Motion that fits --points to the design; it is no part of a correction.",
    ),
    "wavelength_mm": click.option(
        "--wavelength",
        "wavelength_mm",
        type=Number(0.0, min_open=True),
        help="Cut-off wavelength of the filter of the deviation (mm); default: by the noise of the points.",
    ),
    "gain": click.option("--gain", type=Number(), default=1.0, help="Fraction of the deviation to correct."),
}
_OF_INFER = {
    "rays": click.option(
        "--rays", type=WholeNumber(16, 2**28), metavar="N", default=RAYS, help="Rays of each picture of the model."
    ),
    "pixels": click.option(
        "--pixels",
        type=WholeNumber(FEWEST_PIXELS, MOST_PIXELS),
        metavar="N",
        default=PIXELS,
        help="Pixels along the longer side of the model's pictures.",
    ),
}
COMMANDS = (
    *(command_of(stage, _OPTIONS) for stage in (COMPARE, CORRECT)),
    command_of(INFER, _OPTIONS | _OF_INFER),
)
