"""``lensforge sweep``: the designs of a variation, each in a folder of its own, and ``sweep.json`` with what came out.

``sweep.json`` is written after every design, so that an interrupted sweep goes on behind the last finished one, and
within a design from its checkpoint.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from lensforge.optimisation.checkpoint import FILE_NAME as CHECKPOINT
from lensforge.errors import InputError
from lensforge.files import read_json, write_json
from lensforge.gates import Gate
from lensforge.pipeline import gates_of
from lensforge.spec import Accuracy, Spec
from lensforge.studies.sweep.page import build_page
from lensforge.studies.sweep.vary import Variant, Variation
from lensforge.version import __version__

FILE_NAME = "sweep.json"
_JUDGED = ("nmse", "uniformity", "rsd", "efficiency")
_DESIGNED = ("max_radius_mm", "height_mm", "steps", "seconds", "constraints")


@dataclass(frozen=True)
class Settings:
    """What all designs of a sweep share besides the spec."""

    accuracy: Accuracy = "standard"
    seed: int = 0
    rays: int | None = None


class Design(Protocol):
    """The whole way for one design; ``pipeline.run`` with its observers."""

    def __call__(self, spec: Spec, directory: Path, settings: Settings, resume: bool) -> object:
        """Leave a finished result folder; with ``resume`` go on from the checkpoint there."""
        ...


def run_sweep(
    spec: Spec,
    variation: Variation,
    directory: Path,
    design: Design,
    *,
    settings: Settings | None = None,
    resume: bool = False,
    announce: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Make every design of ``variation`` in ``directory``; write sweep.json, .html and .png; return the first.

    With ``resume`` designs that sweep.json lists are kept, whatever values are asked for now. A design that fails a
    gate is listed with it, and the sweep goes on. Raises :class:`InputError` before the first design for a value that
    the spec cannot have, and for a sweep.json of another sweep.
    """
    variants = variation.variants(spec)
    content = _head(spec, variation, settings := settings or Settings())
    rows = {row["value"]: row for row in (_finished(directory / FILE_NAME, content) if resume else [])}
    for number, variant in enumerate(variants, start=1):
        if variant.value not in rows:
            announce(f"design {number} of {len(variants)}: {variation.field} = {variant.value:g}")
            folder = directory / variant.spec.name
            design(variant.spec, folder, settings, resume and (folder / CHECKPOINT).exists())
            rows[variant.value] = _row(variant, folder)
            content["designs"] = [rows[value] for value in sorted(rows)]
            write_json(directory / FILE_NAME, content)
    content["designs"] = [rows[value] for value in sorted(rows)]
    write_json(directory / FILE_NAME, content)
    build_page(content, directory)
    return content


def _head(spec: Spec, variation: Variation, settings: Settings) -> dict[str, Any]:
    """What must be the same for a design to belong to the sweep; the list of values may grow."""
    return {
        "spec": spec.model_dump(mode="json"),
        "vary": variation.field,
        "scale": list(variation.scaled),
        **vars(settings),
        "version": __version__,
        "designs": [],
    }


def _finished(path: Path, head: dict[str, Any]) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("designs"), list):
        raise InputError(f"{path}: not a sweep; run without --resume")
    for key, value in head.items():
        if key != "designs" and content.get(key) != value:
            raise InputError(f"{path}: belongs to a sweep with another {key!r}; run without --resume")
    designs: list[dict[str, Any]] = content["designs"]
    return designs


def _row(variant: Variant, folder: Path) -> dict[str, Any]:
    """The figures of a finished result folder that a sweep compares."""
    judged, designed = read_json(folder / "evaluate.json"), read_json(folder / "design.json")
    return {
        "value": variant.value,
        "folder": folder.name,
        "changes": variant.changes,
        **{key: judged[key] for name in _JUDGED for key in (name, f"{name}_standard_error")},
        **{key: designed[key] for key in _DESIGNED},
        "gates": [gate.to_json() for gate in gates_of(folder)],
    }


def gates_of_sweep(content: dict[str, Any]) -> list[Gate]:
    """The gates of all designs, each named by its folder too."""
    found = []
    for row in content["designs"]:
        gates = (Gate.from_json(entry) for entry in row["gates"])
        found += [replace(gate, name=f"{row['folder']}: {gate.name}") for gate in gates]
    return found
