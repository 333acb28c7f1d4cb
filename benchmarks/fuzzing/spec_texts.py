"""Specs as TOML: the shipped ones, and one for each kind of source, surface and target, with all their fields."""

import copy
import json
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import lensforge as lf
from fuzzing.chance import Chance
from fuzzing.kind import Files, Kind
from fuzzing.trees import as_toml, changed_tree, damaged_text
from lensforge.spec import parse_spec
from lensforge.spec.feasible import require_base_around_cavity
from lensforge.spec.spec_files import resolve_files

FILE = "spec.toml"
EXAMPLES = Path(__file__).parents[2] / "examples"
_DOTTED_PARTS = (2, 50, 1000, 100_000)
_ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037")


@cache
def _samples() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_name("spec_samples.toml").read_text(encoding="utf-8"))


def small() -> dict[str, Any]:
    """A spec whose search begins at once."""
    found: dict[str, Any] = copy.deepcopy(_samples()["small"])
    return found


@cache
def _texts(every_example: bool = True) -> list[str]:
    """The specs as JSON: short ones as a user writes them, and each again with all of its fields."""
    written = [_with(changes) for changes in ({}, *_samples()["other"])]
    if every_example:
        written += [_example(path) for path in sorted(EXAMPLES.glob("*.toml"))]
    whole = [_without_none(parse_spec(content, "sample").model_dump(mode="json")) for content in written]
    return [json.dumps(content) for content in (*written, *whole)]


def _example(path: Path) -> dict[str, Any]:
    """A shipped spec, with the files that it names where they lie."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    resolve_files(content, EXAMPLES)
    return content


def _with(changes: dict[str, Any]) -> Any:
    """The small spec with other sections; receivers stand in place of its target."""
    kept = {name: value for name, value in small().items() if not (name == "target" and "receivers" in changes)}
    return _without_none({**kept, **changes})


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(entry) for key, entry in value.items() if entry is not None}
    return [_without_none(entry) for entry in value] if isinstance(value, list) else value


def _toml_of(text: str) -> bytes:
    return as_toml(json.loads(text), []).encode()


@cache
def _contents() -> list[bytes]:
    return [_toml_of(text) for text in _texts()]


def _make(chance: Chance) -> Files:
    tree, raw = changed_tree(chance, json.loads(chance.pick(_texts())))
    content = damaged_text(chance, as_toml(tree, raw), _contents())
    if chance.share(0.03):
        parts = chance.pick(_DOTTED_PARTS) if chance.share(0.1) else chance.below(50)
        content = b".".join([b"a"] * (parts + 1)) + b" = 1\n" + content
    if chance.share(0.03):
        content = content.decode("utf-8", "replace").encode(chance.pick(_ENCODINGS), "replace")
    return {FILE: content}


def _read(folder: Path) -> object:
    """Load the spec; what is accepted must be written as TOML and read back equal."""
    spec = lf.load_spec(folder / FILE)
    if parse_spec(tomllib.loads(spec.to_toml()), "again") != spec:
        raise ValueError("accepted, but written as TOML it is another spec")
    require_base_around_cavity(spec.lens, spec.constraints, spec.base)
    return spec


def _make_small(chance: Chance) -> Files:
    tree, raw = changed_tree(chance, json.loads(chance.pick(_texts(every_example=False))))
    return {FILE: as_toml(tree, raw).encode("utf-8", "replace")}


def _read_to_first_step(folder: Path) -> object:
    """Load the spec and begin its search; the first step ends it."""
    spec = lf.load_spec(folder / FILE)
    try:
        return lf.design(spec, accuracy="draft", threads=1, progress=lambda _: False, warn=lambda _: None)
    except lf.Cancelled:
        return spec


KINDS = [
    Kind("spec", _make, _read, lambda: [{FILE: _toml_of(text)} for text in _texts()], share=10.0),
    Kind(
        "first_step", _make_small, _read_to_first_step,
        lambda: [{FILE: _toml_of(text)} for text in _texts(every_example=False)[:2]], share=0.02,
    ),
]  # fmt: skip
