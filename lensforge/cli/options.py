"""The options of the commands: one for each keyword of a verb, and those that several commands share."""

import re
from collections.abc import Callable
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, get_args

import click

from lensforge import seeds
from lensforge.cli.interrupts import Interrupts
from lensforge.errors import InputError
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS
from lensforge.spec.processes import PROCESSES

Command = Callable[..., None]
_FILE = click.Path(path_type=Path)


_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(e[-+]?\d+)?", re.IGNORECASE)
_MOST_DIGITS = 18  # of a number that any option takes; a larger exponent is not written out


class Number(click.FloatRange):
    """A number in a range, by default any."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Read ``value``, and refuse a decimal comma with the number that was meant."""
        if isinstance(value, str) and _DECIMAL_COMMA.fullmatch(value.strip()):
            self.fail(f"{value!r}: a number has a decimal point; write {value.strip().replace(',', '.')}", param, ctx)
        return super().convert(value, param, ctx)

    def _describe_range(self) -> str:
        return "" if self.min is None and self.max is None else super()._describe_range()


_ABOVE_ZERO = Number(0.0, min_open=True)


class WholeNumber(click.IntRange):
    """A whole number from ``min`` to ``max``, written with or without an exponent."""

    name = "whole number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read ``value``, and refuse it where it is no whole number, or not in the range."""
        if isinstance(value, str):
            try:
                number = Decimal(value)
            except InvalidOperation:
                if _DECIMAL_COMMA.fullmatch(value.strip()):
                    self.fail(f"{value!r} is no number; write it without a comma", param, ctx)
                self.fail(f"{value!r} is no number; write 1000000 or 1e6", param, ctx)
            if not number.is_finite() or number.adjusted() > _MOST_DIGITS or number != number.to_integral_value():
                self.fail(f"{value!r} is not a whole number {self._describe_range()}", param, ctx)
            value = int(number)
        return super().convert(value, param, ctx)

    def _describe_range(self) -> str:
        return f"from {self.min:,} to {self.max:,}"


FOLDER = click.argument("directory", metavar="DIR", type=_FILE)
SPEC = click.argument("spec", type=_FILE)
OPEN = click.option("--open", "shown", is_flag=True, help="Open the page or picture in the desktop's own program.")
RAYS = click.option(
    "--rays", type=WholeNumber(1, 2**28), metavar="N", help="Number of rays, such as 1e6; default: by spec or preset."
)
_OF_PRESETS = ", ".join(f"{preset.design_rays} {name}" for name, preset in PRESETS.items())
SEARCH_RAYS = click.option(
    "--rays",
    type=WholeNumber(64, 2**24),
    metavar="N",
    help=f"Rays of each step of the search with given lens.levels, such as 2e4; by preset: {_OF_PRESETS}, a quarter of "
    "that for faces of revolution. The light of the finished lens keeps evaluate.rays.",
)
THREADS = click.option("--threads", metavar="N", type=WholeNumber(1, 256), help="Threads; default: all cores.")
SCHEDULER = click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Dask cluster that computes: tcp://HOST:8786, or local:N for N processes of this machine; default: this one.",
)
ACCURACY = click.option(
    "--accuracy",
    type=click.Choice(["draft", "standard", "reference"]),
    default="standard",
    help="Preset. draft: for a first look, up to 289 functions a surface, 1 million rays to evaluate; standard: for a "
    "lens to be made, up to 1,089 functions, 8 million rays; reference: up to 4,225 functions, 17 million rays, hours.",
)
SEED = click.option("--seed", metavar="N", type=WholeNumber(0, seeds.MOST), default=0, help="Seed of the random rays.")
IES_VERSION = click.option(
    "--ies-version",
    type=click.Choice([str(year) for year in get_args(IesVersion)]),
    callback=lambda _context, _option, year: None if year is None else int(year),
    help=f"Year of LM-63 that an .ies file follows, for programs that read no newer one; default: {NEWEST}.",
)
DEVICE = click.option(
    "--device",
    type=click.Choice(["cpu", "cuda"]),
    default="cpu",
    help="Device that traces the rays of the search; cuda is experimental: not yet run on a GPU; all else runs on "
    "the CPU.",
)
# By the keyword of the verb; a command has those that its stage names.
OPTIONS: dict[str, Callable[[Command], Command]] = {
    "rays": RAYS,
    "threads": THREADS,
    "scheduler": SCHEDULER,
    "seed": SEED,
    "ies_version": IES_VERSION,
    "pixels": click.option(
        "--pixels", metavar="N", type=WholeNumber(1, 2048), help="Pixels across the receiver; default: from the spec."
    ),
    "source": click.option("--source", type=_FILE, help="A ray file to use instead of the spec's source."),
    "compare": click.option(
        "--compare",
        is_flag=True,
        help="Also search a lens for --source, from this one on, and say what it would gain; its folder is DIR-SOURCE.",
    ),
    "temperature_c": click.option(
        "--temperature",
        "temperature_c",
        type=Number(),
        metavar="C",
        help="Temperature (Celsius) of the lens and the air around it.",
    ),
    "name": click.option("--name", help="Name of the record under other conditions; default: made from them."),
    "schema": click.option(
        "--schema", type=click.Choice(["AP214", "AP242"]), default="AP214", help="Schema of the STEP."
    ),
    "extension_deg": click.option(
        "--extension",
        "extension_deg",
        type=Number(),
        metavar="DEG",
        help="Also write the faces untrimmed, extended by DEG degrees.",
    ),
    "nodes": click.option(
        "--nodes",
        metavar="N",
        type=WholeNumber(1, 10_000),
        help="Spline nodes across each optical face; default: as many as the form needs.",
    ),
    "form_nm": click.option(
        "--form-nm",
        type=Number(0.1, 1e4),
        metavar="NM",
        help="Largest form error of the optical faces in the STEP; default: the spec's, or 50.",
    ),
    "normal_mrad": click.option(
        "--normal-mrad",
        type=Number(1e-3, 10.0),
        metavar="MRAD",
        help="Largest error of their normals; default: the spec's, or 0.2, or as the LED's image requires.",
    ),
    "rings": click.option(
        "--rings",
        metavar="N",
        type=WholeNumber(1, 100_000),
        help="Equal rings of the mesh; default: its facets are within 2 um of the faces.",
    ),
    "date": click.option("--date", metavar="YYYY-MM-DD", help="Date of the files for the shop; default: the spec's."),
    "process": click.option(
        "--process",
        type=click.Choice([name for name, made in PROCESSES.items() if made.is_judged]),
        help="Process by which it is made; default: the spec's.",
    ),
    "stray": click.option(
        "--stray", is_flag=True, help="Also trace reflections, the base and absorption; writes stray.json."
    ),
    "base": click.option(
        "--base", type=click.Choice(["polished", "black"]), default="polished", help="Finish of the base under --stray."
    ),
    "lumens": click.option(
        "--lumens",
        type=Number(1e-6, 1e9),
        help="Flux of the LED (lm); default: the spec's, or relative to 1000.",
    ),
    "parts": click.option("--parts", type=WholeNumber(40, 100_000), metavar="N", default=1000, help="Number of parts."),
    "tolerances": click.option(
        "--tolerances",
        metavar="PRESET|FILE",
        help="Others than the spec's: precision, standard, moulded, or a TOML file with [tolerances].",
    ),
    "budget": click.option("--budget/--no-budget", default=True, help="Largest amount of each tolerance."),
}


with_force = click.option(
    "--force", is_flag=True, help="Search even if the upper bound is below half of what a target requires."
)


def with_rays(spec: Spec, rays: int | None) -> Spec:
    """Return ``spec`` with ``rays`` rays in each step of its search; None leaves it as it is.

    Raises :class:`InputError` for a spec whose search chooses its levels, and with them its rays.
    """
    if rays is not None and spec.lens.levels == "auto":
        raise InputError(
            f'--rays {rays}: with lens.levels = "auto" the search chooses its rays, too; leave out --rays (--accuracy '
            "draft takes fewer), or give lens.levels, such as [25, 81, 289]"
        )
    return spec if rays is None else spec.replace({"optimise.rays": rays})


def resume_after_interrupt(resumable: Callable[[], bool], how: str = "") -> None:
    """Let an interrupt of the running command advise ``--resume`` where ``resumable()`` is True at that moment.

    ``how``: words on the same command where it goes on without that option.
    """
    interrupts = click.get_current_context().find_object(Interrupts)
    if interrupts is not None:
        interrupts.resumable = resumable
        interrupts.how = how or interrupts.how
