"""``lensforge sweep``: the designs of a variation, each in its own folder, and ``sweep.json`` with their results.

``sweep.json`` is written after every design, so that an interrupted sweep continues after the last finished one, and
within a design from its checkpoint.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.folder_lock import locked
from lensforge.given_faces.lens_face import LENS_FILE
from lensforge.lens import load_lens
from lensforge.optimisation.checkpoint import CHECKPOINT, is_checkpoint
from lensforge.report.ownership import require_own
from lensforge.report.page import write_page
from lensforge.results import load_results
from lensforge.spec import Accuracy, Spec
from lensforge.spec.files import section_sha256
from lensforge.studies.sweep import on_workers
from lensforge.studies.sweep.page import sweep_page, sweep_png
from lensforge.studies.sweep.table import Sweep, sweep_of
from lensforge.studies.sweep.vary import Variant, Variation
from lensforge.version import __version__

PAGE, PLOT = "sweep.html", "sweep.png"


class RunDesign(Protocol):
    """A run of every stage for one design, with the accuracy and the seed of the sweep."""

    def __call__(self, spec: Spec, folder: Path, resume: bool) -> object:
        """Write a finished result folder; with ``resume`` continue from the checkpoint there."""
        ...


def run_sweep(
    spec: Spec,
    variation: Variation,
    directory: Path,
    run_design: RunDesign,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    resume: bool = False,
    scheduler: str | None = None,
    announce: Callable[[str], None] = lambda _: None,
) -> Sweep:
    """Make every design of ``variation`` in ``directory``; write sweep.json, .html and .png; return the sweep.

    ``accuracy`` and ``seed``: those that ``run_design`` uses. ``scheduler``: a Dask cluster, whose workers then make
    whole runs in its place, several at once, without checkpoints. With ``resume`` designs that sweep.json lists are
    kept, whatever the values are now. A design that misses a criterion is listed with it, and the sweep continues.
    Raises :class:`InputError` before the first design for a value that the spec cannot have, for a sweep.json of
    another sweep, for a page of another program, and where another process writes in ``directory``.
    """
    variants = variation.variants(spec)
    require_own(directory / PAGE)
    with locked(directory, create=True):
        sweep = _finished(directory, spec, variation, accuracy, seed) if resume else None
        wanted = [variant for variant in variants if sweep is None or variant.value not in sweep.values]
        if scheduler is None:
            made = _one_by_one(wanted, variation, directory, run_design, resume, announce)
        else:
            made = _at_once(wanted, variation, directory, accuracy, seed, scheduler, announce)
        return _joined(spec, variation, made, directory, sweep)


def resumable(directory: Path) -> bool:
    """True where an interrupted sweep in ``directory`` can be resumed: a design is finished, or was begun."""
    if (directory / f"{Sweep.stage}.json").is_file():
        return True
    return any(is_checkpoint(checkpoint) for checkpoint in directory.glob(f"*/{CHECKPOINT}"))


def _one_by_one(
    wanted: Sequence[Variant],
    variation: Variation,
    directory: Path,
    run_design: RunDesign,
    resume: bool,
    announce: Callable[[str], None],
) -> Iterator[Variant]:
    """Make every design here; each as soon as its folder is finished."""
    for number, variant in enumerate(wanted, start=1):
        announce(f"design {number} of {len(wanted)}: {variation.field} = {variant.value:g}")
        folder = directory / variant.spec.name
        run_design(variant.spec, folder, resume and (folder / CHECKPOINT).exists())
        yield variant


def _at_once(
    wanted: Sequence[Variant],
    variation: Variation,
    directory: Path,
    accuracy: Accuracy,
    seed: int,
    scheduler: str,
    announce: Callable[[str], None],
) -> Iterator[Variant]:
    """Make the designs on the workers of a cluster, and write the folder of each as it comes."""
    found = on_workers.runs_on_workers([variant.spec for variant in wanted], accuracy, seed, scheduler)
    for done, (number, files) in enumerate(found, start=1):
        variant = wanted[number]
        on_workers.write_run(files, directory / variant.spec.name)
        announce(f"design {done} of {len(wanted)}: {variation.field} = {variant.value:g}")
        yield variant


def _joined(spec: Spec, variation: Variation, made: Iterator[Variant], directory: Path, sweep: Sweep | None) -> Sweep:
    """The sweep with every design that is ``made``, written after each."""
    for variant in made:
        one = sweep_of(spec, variation, [(variant, load_results(directory / variant.spec.name))])
        sweep = one if sweep is None else sweep.joined(one)
        sweep.write(directory)
    assert sweep is not None, "a variation has values"
    _write_page(sweep, directory)
    return sweep


def _write_page(sweep: Sweep, directory: Path) -> None:
    results = [load_results(directory / row.folder) for row in sweep.designs]
    write_page(sweep_page(sweep, results), directory / PAGE)
    with replacing(directory / PLOT) as temporary:
        temporary.write_bytes(sweep_png(sweep))


def _finished(directory: Path, spec: Spec, variation: Variation, accuracy: Accuracy, seed: int) -> Sweep | None:
    """The designs that an earlier call finished, None without any. Only its values may differ from this call's.

    Raises :class:`InputError` where anything else differs, the content of a file too, and where the folder of one of
    the designs holds another lens now.
    """
    path = directory / f"{Sweep.stage}.json"
    if not path.exists():
        return None
    sweep = Sweep.read(directory)
    for words, found, wanted in (
        ("spec, or file that it names", sweep.spec_sha256, section_sha256(spec)),
        ("field", sweep.vary, variation.field),
        ("scaled fields", sweep.scale, variation.scaled),
        ("accuracy", sweep.accuracy, accuracy),
        ("seed", sweep.seed, seed),
        ("version of lensforge", sweep.version, __version__),
    ):
        if found != wanted:
            raise InputError(f"{path}: a sweep with another {words}; start again without resume")
    for row in sweep.designs:
        folder = directory / row.folder
        if load_lens(folder / LENS_FILE).sha256 != sweep.inputs[row.folder]:
            raise InputError(f"{folder}: not the design that {path.name} lists; start again without resume")
    return sweep
