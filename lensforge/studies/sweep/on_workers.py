"""Designs of a sweep on the workers of a cluster: each is a whole run there, whose files come back."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from lensforge import pipeline
from lensforge.files import replacing
from lensforge.folder_lock import locked
from lensforge.spec import Accuracy, Spec
from lensforge.workers.connection import connected

Files = Mapping[str, bytes]


def runs_on_workers(
    specs: Sequence[Spec], accuracy: Accuracy, seed: int, scheduler: str
) -> Iterator[tuple[int, Files]]:
    """Make every design, in any order: its number, and the files of its result folder, by name."""
    with connected(scheduler) as cluster:
        yield from cluster.map(files_of_run, (accuracy, seed), specs)


def files_of_run(settings: tuple[Accuracy, int], spec: Spec) -> Files:
    """Make one design in a folder of the worker, and return what is in it."""
    accuracy, seed = settings
    with TemporaryDirectory(prefix="lensforge_") as name:
        folder = Path(name) / spec.name
        pipeline.run(spec, folder, accuracy=accuracy, seed=seed, warn=lambda _: None)
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if not path.name.startswith(".")}


def write_run(files: Files, folder: Path) -> None:
    """Write the files of a run into its folder, those last that name the hashes of others."""
    with locked(folder, create=True):
        for name in sorted(files, key=lambda each: (each == "run.json", each.endswith(".json"))):
            with replacing(folder / name) as temporary:
                temporary.write_bytes(files[name])
