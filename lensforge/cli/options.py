"""Options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import get_args

import click

from lensforge import seeds
from lensforge.cli.interrupts import Interrupts
from lensforge.cli.whole_number import WholeNumber
from lensforge.sources.photometric.ies import NEWEST, IesVersion
from lensforge.spec import Spec

FOLDER = click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
RAYS = click.option(
    "--rays", type=WholeNumber(1, 2**28), metavar="N", help="Number of rays, such as 1e6; default: by spec or preset."
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
    show_default=True,
    help="Preset. draft: for a first look, up to 289 functions a surface, 1 million rays to evaluate; standard: for a "
    "lens to be made, up to 1,089 functions, 8 million rays; reference: up to 4,225 functions, 17 million rays, hours.",
)
SEED = click.option(
    "--seed",
    metavar="N",
    type=WholeNumber(0, seeds.MOST),
    default=0,
    show_default=True,
    help="Seed of the random rays.",
)
IES_VERSION = click.option(
    "--ies-version",
    type=click.Choice([str(year) for year in get_args(IesVersion)]),
    help=f"Year of LM-63 that an .ies file follows, for programs that read no newer one; default: {NEWEST}.",
)
OPEN = click.option("--open", "shown", is_flag=True, help="Open the page or picture in the desktop's own program.")
DEVICE = click.option(
    "--device",
    type=click.Choice(["cpu", "cuda"]),
    default="cpu",
    show_default=True,
    help="Device that traces the rays of the search; cuda is experimental: not yet run on a GPU; all else runs on "
    "the CPU.",
)


def with_rays(spec: Spec, rays: int | None) -> Spec:
    """Return ``spec`` with ``rays`` rays in each step of its search; None leaves it as it is."""
    return spec if rays is None else spec.replace({"optimise.rays": rays})


def resume_after_interrupt(resumable: Callable[[], bool]) -> None:
    """Let an interrupt of the running command advise ``--resume`` where ``resumable()`` is True at that moment."""
    interrupts = click.get_current_context().find_object(Interrupts)
    if interrupts is not None:
        interrupts.resumable = resumable
