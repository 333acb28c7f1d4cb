"""Names and docstrings, held by walking the syntax trees: a name for each class, modules that fit on a few screens."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "lensforge"
MODULES = sorted(PACKAGE.rglob("*.py"))
MOST_LINES = 260
# A docstring begins with a noun or a verb: the thing, or what it does.
NO_BEGINNING = {
    "What", "Whether", "Where", "Of", "That", "How", "Why", "Which", "As", "By", "From", "In", "Those",
}  # fmt: skip
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_docstrings_begin_with_a_noun_or_a_verb(path: Path) -> None:
    for node in ast.walk(_tree(path)):
        if isinstance(node, _DOCUMENTED) and (text := ast.get_docstring(node)):
            first = text.split()[0].rstrip(",:;")
            assert first not in NO_BEGINNING, f"{getattr(node, 'name', 'module')}: {text.splitlines()[0]}"


def test_every_class_has_a_name_of_its_own() -> None:
    places = defaultdict(list)
    for path in MODULES:
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(str(path.relative_to(PACKAGE)))
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_no_module_is_long() -> None:
    lines = {str(path.relative_to(PACKAGE)): len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}
