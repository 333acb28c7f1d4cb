"""Options that several commands share."""

from pathlib import Path

import click

from lensforge.spec import Spec

FOLDER = click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
RAYS = click.option("--rays", type=click.IntRange(1, 2**28), help="Number of rays; default: by the accuracy preset.")
THREADS = click.option("--threads", type=click.IntRange(1, 256), help="Threads; default: all cores.")
ACCURACY = click.option(
    "--accuracy", type=click.Choice(["draft", "standard", "reference"]), default="standard", show_default=True
)
SEED = click.option("--seed", type=click.IntRange(0, 2**20), default=0, show_default=True)
DEVICE = click.option(
    "--device",
    type=click.Choice(["cpu", "cuda"]),
    default="cpu",
    show_default=True,
    help="Where the search traces its rays; what judges the lens runs on the CPU, in float64, either way.",
)


def with_rays(spec: Spec, rays: int | None) -> Spec:
    """``spec`` with ``rays`` rays in a step of its search; None leaves it as it is."""
    return spec if rays is None else spec.replace({"optimise.rays": rays})
