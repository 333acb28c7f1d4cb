"""``compile``: kernels compiled ahead of the first design, for a machine, an image of a container, or a wheel."""

from pathlib import Path
from tempfile import TemporaryDirectory

import click

from lensforge import kernels, proof
from lensforge.cli.options import THREADS
from lensforge.cli.output import Block, Output, with_output
from lensforge.report import pipeline
from lensforge.results.files import MIB
from lensforge.spec import load_spec
from lensforge.spec.accuracy import PRESETS
from lensforge.spec.shipped_specs import shipped_specs

_USUAL = ("quickstart", "spot")  # shipped specs, of two freeform faces and of total internal reflection
_FEW = PRESETS["draft"].replace(
    "compile", design_rays=2**9, coarse_steps=1, fine_steps=2, evaluate_rays=2**14, photometry_rays=(2**12, 2**12),
    verify_rays=2**9, part={"mesh_rings": 24, "check_nodes": 61}, effort={
        "finest": 81, "steps": (1, 2), "rays": (2**8, 2**9), "validation_rays": 2**9, "step_gain": 0.5,
    },
)  # fmt: skip


@click.command("compile")
@click.argument("specs", metavar="[SPEC]...", nargs=-1, type=click.Path(path_type=Path))
@THREADS
@with_output
def compile_kernels(specs: tuple[Path, ...], threads: int | None, output: Output) -> None:
    """Compile what designs like SPEC need, ahead of the first of them on this machine.

    Each SPEC is taken through all stages by a few steps of few rays, and nothing of that is kept but the kernels.
    Without SPEC: lenses of two freeform faces, and for total internal reflection.
    """
    from lensforge.cli.progress import StageClock
    from lensforge.kernels.compiled import cache_folder

    paths = specs or tuple(shipped_specs()[name] for name in _USUAL)
    contents = [load_spec(path) for path in paths]  # all of them before the first is compiled
    with StageClock("compile", quiet=output.quiet), TemporaryDirectory(prefix="lensforge-") as folder:
        for number, content in enumerate(contents):
            few = content.replace({"evaluate.rays": _FEW.evaluate_rays})
            run = Path(folder) / str(number)
            pipeline.run(few, run, accuracy=_FEW, threads=threads, force=True, warn=lambda _: None)
    folders = [cache_folder(Path(*room.__path__)) for room in (kernels, proof)]
    files = [file for place in folders for file in place.glob("*.nbc")]
    mib = sum(file.stat().st_size for file in files) / MIB
    output.show(
        lambda: {"folders": [str(place) for place in folders], "kernels": len(files), "mib": mib},
        lambda: [Block(f"{len(files)} kernels, {mib:.1f} MiB", [("Folder", str(place)) for place in folders])],
    )
