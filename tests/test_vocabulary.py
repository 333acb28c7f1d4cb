"""Names and docstrings, held by walking the syntax trees: a name for each class, concepts that stand once."""

import ast
import builtins
import re
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "lensforge"
MODULES = sorted(PACKAGE.rglob("*.py"))
# A docstring begins with a noun or a verb: the thing, or what it does.
NO_BEGINNING = {
    "What", "Whether", "Where", "Of", "That", "How", "Why", "Which", "As", "By", "From", "In", "Those",
}  # fmt: skip
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def _documented() -> list[tuple[Path, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Modules, classes and functions, each with its path."""
    return [(path, node) for path in MODULES for node in ast.walk(_tree(path)) if isinstance(node, _DOCUMENTED)]


def test_docstrings_begin_with_a_noun_or_a_verb() -> None:
    texts = [
        (path.relative_to(PACKAGE), ast.get_docstring(node) or "It")
        for path, node in _documented()
        if not (path.name == "__init__.py" and isinstance(node, ast.Module))  # a room asks a question
    ]
    assert [f"{path}: {text}" for path, text in texts if text.split()[0].rstrip(",:;") in NO_BEGINNING] == []


_SPAN = re.compile(r"``([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)``|:(?:class|func|meth|data):`~?\.?([\w.]+)`")
_OF_OTHERS = {"scipy", "skimage", "lib3mf", "dataclasses", "use_attribute_docstrings", "finally", "Symm", "dc", "c_j"}
_ROOMS = {"surfaces", "optics", "scene", "kernels", "sources", "search", "cad", "shop"}  # no name of a section, a value


def test_docstrings_name_what_there_is() -> None:
    """Modules, classes, functions and fields by names that the code has, in itself or in its texts, such as a key."""
    known, mentions = {*dir(builtins), "js", "json", "html", "ies", "lens_x", "photometry_x", "_deBoor_D"}, []
    for path in MODULES:
        nodes = list(ast.walk(_tree(path)))
        docstrings = {node.value for node in nodes if isinstance(node, ast.Expr)}  # docstrings, and of fields
        names = [getattr(node, kind, "") for node in nodes for kind in ("id", "attr", "arg", "name", "asname")]
        constants = {node: str(node.value) for node in nodes if isinstance(node, ast.Constant)}
        texts = [text for node, text in constants.items() if node not in docstrings]
        known |= set(re.findall(r"\w+", f"{path} {' '.join(map(str, names))} {' '.join(texts)}"))
        for node in docstrings & constants.keys():
            mentions += [(path, span or role) for span, role in _SPAN.findall(constants[node])]
    stale = []
    for path, name in mentions:
        first, *rest = name.removeprefix("lensforge.").split(".")
        room = PACKAGE.joinpath(first, *rest[:1])
        gone = bool(rest) and first in _ROOMS and not (room.is_dir() or room.with_suffix(".py").is_file())
        if first not in _OF_OTHERS and (gone or not {first, *rest} <= known):
            stale.append(f"{path.relative_to(PACKAGE)}: {name}")
    assert stale == []


ROOMS = sorted(str(path.parent.relative_to(PACKAGE)) for path in PACKAGE.glob("**/__init__.py"))


@pytest.mark.parametrize("room", [room for room in ROOMS if "/" not in room or room.startswith("addons/")][1:])
def test_a_room_asks_its_question_and_names_its_public_things(room: str) -> None:
    """Each name is ``module`` or ``module.name`` of the room; the specification's are those that it exports."""
    tree = _tree(PACKAGE / room / "__init__.py")
    docstring = ast.get_docstring(tree) or ""
    assert "?" in docstring.split("\n\n")[0]
    named = re.findall(r"^- ``([\w.]+)``: \w", docstring, re.MULTILINE)
    assert room == "addons" or 5 <= len(named) <= 15 or any(isinstance(node, ast.Assign) for node in tree.body)
    for name in named:
        module, _, member = name.rpartition(".") if "." in name else (name, "", "")
        path = PACKAGE.joinpath(room, *module.split("."))
        text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
        assert re.search(rf"^(class |def |from .* import .*|){member}\b", text, re.MULTILINE), name


def test_every_class_has_a_name_of_its_own() -> None:
    places = defaultdict(list)
    for path, node in _documented():
        if isinstance(node, ast.ClassDef):
            places[node.name].append(str(path.relative_to(PACKAGE)))
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == {}


def _fields(node: ast.ClassDef) -> set[str]:
    lines = (statement.target for statement in node.body if isinstance(statement, ast.AnnAssign))
    return {target.id for target in lines if isinstance(target, ast.Name)}


def test_concepts_stand_once() -> None:
    """Loops over events: the kernels', their adjoint's, the readable tracer's, a scene's; the proof has its own.

    A value is judged by one type, and a thing stands in its place by one: sections of the spec and lamps make it of the
    numbers that are stated, the proof has its own. A kind of lens is asked for as ``tests/test_lens_kinds.py`` says.
    """
    judged = {
        node.name
        for path in MODULES
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.ClassDef) and _fields(node) & {"limit", "bound"} and _fields(node) & {"state", "passed"}
    }
    assert judged == {"Fact"}
    origins, turns = {"origin_mm", "centre_mm", "place_mm", "position_mm"}, {"axes", "turn", "rotation", "turn_deg"}
    posed = {
        node.name
        for path in MODULES
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.ClassDef) and _fields(node) & origins and _fields(node) & turns
    }
    assert posed == {"Pose", "Lamp"}
    loops = {
        str(path.relative_to(PACKAGE))
        for path in MODULES
        if re.search(r"^ *for event in range\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert {path for path in loops if not path.startswith("proof/")} == {
        "kernels/adjoint.py", "kernels/trace.py", "light/reference_trace.py", "scene/housing_walk.py",
    }  # fmt: skip


def test_copies_validate_what_they_are_given() -> None:
    """By ``changed`` of records and sections; pydantic's own copy takes anything, and any field."""
    copies = Counter(
        {str(path.relative_to(PACKAGE)): path.read_text(encoding="utf-8").count(".model_copy(") for path in MODULES}
    )
    assert +copies == Counter({"results/validation.py": 1, "results/stage_result.py": 1})  # its base, and what it drops


def test_every_file_has_a_name_of_its_own() -> None:
    """One name, one module, in an editor's tabs; formats of files have a folder of their own."""
    names = Counter(path.name for path in MODULES if path.name != "__init__.py")
    assert {name: count for name, count in names.items() if count > 1} == {}
