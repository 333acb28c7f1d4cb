"""TOML blocks are valid specs, or valid parts of one; Python blocks name what there is, and small ones run."""

import ast
import inspect
import tomllib
from pathlib import Path

import pytest
from page_sources import ROOT, Block, blocks

import lensforge as lf
from lensforge.spec import parse_spec

# Verbs that search, trace or read a folder: their blocks are compiled, their names and arguments checked.
SLOW = {"design", "best_design", "evaluate", "build", "check", "verify", "run", "load", "sweep", "tradeoff",
        "tolerance", "photometry", "compare", "correct", "handover", "sensitivity", "stray_light"}  # fmt: skip
EITHER = ("target", "receivers")


def whole(part: dict[str, object]) -> dict[str, object]:
    """A spec with the sections of ``part`` in the place of a plain one's."""
    plain = tomllib.loads((ROOT / "examples" / "quickstart.toml").read_text(encoding="utf-8"))
    plain["lens"].pop("symmetry")
    limits = part.get("limits", [])
    if set(part) & {"roads", "offices", "routes", "sports"} or any(
        "_deg" in name for limit in limits for name in limit
    ):
        plain["target"] = {"kind": "beam", "fwhm_deg": 40.0, "half_angle_deg": 90.0}
    if set(part) & set(EITHER):
        plain = {name: section for name, section in plain.items() if name not in EITHER}
    if "sources" in part:
        plain.pop("source")
    return {**plain, **part}


@pytest.mark.parametrize("block", blocks("toml"), ids=lambda block: block.place)
def test_a_toml_block_is_a_spec_or_a_part_of_one(block: Block) -> None:
    content = tomllib.loads(block.text)
    assert content, "all of it is a comment"
    parse_spec(whole(content), block.place)


def library_names(tree: ast.AST) -> list[ast.Attribute]:
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "lf"
    ]


def _check_call(node: ast.Call, place: str) -> None:
    """Arguments of a verb are those that it takes."""
    if not (isinstance(node.func, ast.Attribute) and node.func in library_names(node)):
        return
    named = getattr(lf, node.func.attr)
    known = set(named.model_fields if hasattr(named, "model_fields") else inspect.signature(named).parameters)
    for keyword in node.keywords:
        assert keyword.arg is None or keyword.arg in known, f"{place}: lf.{node.func.attr}({keyword.arg}=...)"


@pytest.mark.parametrize("block", blocks("python"), ids=lambda block: block.place)
def test_a_python_block_names_what_the_library_has(block: Block) -> None:
    tree = ast.parse(block.text)
    for name in library_names(tree):
        assert hasattr(lf, name.attr), f"{block.place}: lf.{name.attr}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            _check_call(node, block.place)


def _is_quick(block: Block) -> bool:
    """True where a block uses the library, and nothing slow of it."""
    names = {name.attr for name in library_names(ast.parse(block.text))}
    return bool(names) and not SLOW & names


QUICK = [block for block in blocks("python") if _is_quick(block)]


@pytest.mark.parametrize("block", QUICK, ids=lambda block: block.place)
def test_a_quick_python_block_runs(block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plain = lf.load_spec(ROOT / "examples" / "quickstart.toml")
    names = {"lf": lf, "spec": plain, "source": plain.source, "lens": plain.lens, "limits": plain.constraints}
    exec(compile(block.text, block.place, "exec"), names)


def test_the_api_page_has_every_public_name() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    shown = {line.rpartition(".")[2] for line in page.splitlines() if line.startswith(".. auto")}
    assert shown == set(lf.__all__) - {"__version__"}
