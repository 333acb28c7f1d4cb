"""``lensforge sweep``: the designs of a variation, each in its own folder, and ``sweep.json`` with their results.

``sweep.json`` is written after every design, so that an interrupted sweep continues after the last finished one, and
within a design from its checkpoint.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.pipeline import CHECKPOINT
from lensforge.results import load_results
from lensforge.spec import Accuracy, Spec
from lensforge.studies.sweep.page import sweep_page, sweep_png
from lensforge.studies.sweep.table import Sweep, sweep_of
from lensforge.studies.sweep.vary import Variation
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
    announce: Callable[[str], None] = lambda _: None,
) -> Sweep:
    """Make every design of ``variation`` in ``directory``; write sweep.json, .html and .png; return the sweep.

    ``accuracy`` and ``seed``: those that ``run_design`` uses. With ``resume`` designs that sweep.json lists are kept,
    whatever the values are now. A design that misses a criterion is listed with it, and the sweep continues. Raises
    :class:`InputError` before the first design for a value that the spec cannot have, and for a sweep.json of another
    sweep.
    """
    variants = variation.variants(spec)
    sweep = _finished(directory, spec, variation, accuracy, seed) if resume else None
    for number, variant in enumerate(variants, start=1):
        if sweep is not None and variant.value in sweep.values:
            continue
        announce(f"design {number} of {len(variants)}: {variation.field} = {variant.value:g}")
        folder = directory / variant.spec.name
        run_design(variant.spec, folder, resume and (folder / CHECKPOINT).exists())
        made = sweep_of(spec, variation, [(variant, load_results(folder))])
        sweep = made if sweep is None else sweep.joined(made)
        sweep.write(directory)
    assert sweep is not None, "a variation has values"
    _write_page(sweep, directory)
    return sweep


def _write_page(sweep: Sweep, directory: Path) -> None:
    results = [load_results(directory / row.folder) for row in sweep.designs]
    for name, content in ((PAGE, sweep_page(sweep, results).encode()), (PLOT, sweep_png(sweep))):
        with replacing(directory / name) as temporary:
            temporary.write_bytes(content)


def _finished(directory: Path, spec: Spec, variation: Variation, accuracy: Accuracy, seed: int) -> Sweep | None:
    """The designs that an earlier call finished, None without any. Only its values may differ from this call's.

    Raises :class:`InputError` where anything else differs.
    """
    if not (directory / f"{Sweep.stage}.json").exists():
        return None
    sweep = Sweep.read(directory)
    wanted: dict[str, object] = {
        "spec": spec,
        "vary": variation.field,
        "scale": variation.scaled,
        "accuracy": accuracy,
        "seed": seed,
        "version": __version__,
    }
    for name, value in wanted.items():
        if getattr(sweep, name) != value:
            raise InputError(f"{directory / 'sweep.json'}: a sweep with another {name!r}; start again without resume")
    return sweep
