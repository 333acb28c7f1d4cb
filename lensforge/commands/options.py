"""Options that several commands share, and the late import that keeps ``--help`` quick."""

from importlib import import_module
from pathlib import Path
from typing import Any

import click

FOLDER = click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
RAYS = click.option("--rays", type=click.IntRange(1, 2**28), help="Number of rays; default: by the accuracy preset.")
THREADS = click.option("--threads", type=click.IntRange(1, 256), help="Threads; default: all cores.")
DEVICE = click.option(
    "--device",
    type=click.Choice(["cpu", "cuda"]),
    default="cpu",
    show_default=True,
    help="Where the search traces its rays; what judges the lens runs on the CPU, in float64, either way.",
)


def pipeline() -> Any:
    """The pipeline, loaded at the first call: torch and numba load only where light is traced."""
    return import_module("lensforge.pipeline")


def use_threads(threads: int | None) -> None:
    """Let torch and the tracer use ``threads`` threads; None leaves the default."""
    if threads is not None:
        import_module("torch").set_num_threads(threads)


def search_device(name: str) -> Any:
    """The torch device of that name; None for the CPU, where compiled kernels trace."""
    return import_module("lensforge.tracing.on_device").search_device(name)
