"""All kinds of file that are fuzzed, by name, and how many cases each gets.

The module of a kind is imported when that kind is used: a worker loads only what its own cases need.
"""

import importlib
from collections.abc import Sequence
from functools import cache

from fuzzing.kind import Kind
from fuzzing.samples import result_folder

_MODULES = {
    "spec_texts": ("spec", "first_step"),
    "ray_files": (
        "tm25", "zemax_binary", "zemax_text", "lighttools_binary", "lighttools_text", "speos", "speos_text", "asap",
        "csv",
    ),
    "photometric_files": ("ies", "ldt", "tm33", "spectrum", "points"),
    "material_files": ("agf", "yaml", "index"),
    "records": (
        "lens", "run", "design", "evaluate", "export", "check", "verify", "stray", "sensitivity", "yield",
        "photometry",
        "compare",
        "compare_inner", "compare_outer", "correct_inner", "correct_outer", "sweep", "level-0",
    ),
    "folders": ("load", "report", "handover"),
    "archives": ("arrays", "radiance"),
    "stl_files": ("stl",),
    "part_files": ("step", "base", "threemf"),
    "checkpoints": ("checkpoint",),
    "picture_files": ("png", "tiff", "jpeg", "bmp", "no_picture"),
}  # fmt: skip
OPTIONAL = (  # records that a folder need not have
    "compare", "compare_inner", "compare_outer", "correct_inner", "correct_outer", "sweep", "level-0",
)  # fmt: skip
NAMES = tuple(name for names in _MODULES.values() for name in names)


@cache
def kind_named(name: str) -> Kind:
    """The kind of this name. Raises :class:`KeyError` for one that is not known."""
    module = next((module for module, names in _MODULES.items() if name in names), None)
    if module is None:
        raise KeyError(name)
    kinds: list[Kind] = importlib.import_module(f"fuzzing.{module}").KINDS
    return next(kind for kind in kinds if kind.name == name)


def chosen(names: Sequence[str]) -> list[Kind]:
    """The kinds of these names; all of them where none is named. Ends the program for a name that is not known."""
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        raise SystemExit(f"--kind {unknown[0]}: one of {', '.join(NAMES)}")
    there = [name for name in NAMES if name not in OPTIONAL or (result_folder() / f"{name}.json").exists()]
    return [kind_named(name) for name in names or there]


def counts_of(kinds: Sequence[Kind], in_process: int, foreign: int) -> list[int]:
    """Cases of each kind: the two totals, shared out by the kinds' shares."""
    sums = {group: sum(kind.share for kind in kinds if kind.foreign == group) for group in (False, True)}
    totals = {False: in_process, True: foreign}
    return [round(totals[kind.foreign] * kind.share / sums[kind.foreign]) for kind in kinds]
