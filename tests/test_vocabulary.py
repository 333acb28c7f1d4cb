"""Names and docstrings, held by walking the syntax trees: a name for each class, modules that fit on a few screens."""

import ast
import builtins
import re
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "lensforge"
MODULES = sorted(PACKAGE.rglob("*.py"))
MOST_LINES = 400
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
    known, said = {*dir(builtins), "js", "json", "html", "ies", "lens_x", "photometry_x", "_deBoor_D"}, []
    for path in MODULES:
        nodes = list(ast.walk(_tree(path)))
        words = {node.value for node in nodes if isinstance(node, ast.Expr)}  # docstrings, and of fields
        for node in nodes:
            names = [getattr(node, kind, "") for kind in ("id", "attr", "arg", "name", "asname")]
            text = str(node.value) if isinstance(node, ast.Constant) else ""
            known |= set(re.findall(r"\w+", f"{path} {names} {'' if node in words else text}"))
            said += [(path, one or other) for one, other in _SPAN.findall(text if node in words else "")]
    stale = []
    for path, name in said:
        first, *rest = name.removeprefix("lensforge.").split(".")
        room = PACKAGE.joinpath(first, *rest[:1])
        gone = bool(rest) and first in _ROOMS and not (room.is_dir() or room.with_suffix(".py").is_file())
        if first not in _OF_OTHERS and (gone or not {first, *rest} <= known):
            stale.append(f"{path.relative_to(PACKAGE)}: {name}")
    assert stale == []


@pytest.mark.parametrize("room", sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py")))
def test_a_room_asks_its_question_and_names_its_public_things(room: str) -> None:
    """Each name is ``module`` or ``module.name`` of the room; the specification's are those that it exports."""
    tree = _tree(PACKAGE / room / "__init__.py")
    words = ast.get_docstring(tree) or ""
    assert "?" in words.split("\n\n")[0]
    named = re.findall(r"^- ``([\w.]+)``: \w", words, re.MULTILINE)
    assert 5 <= len(named) <= 15 or any(isinstance(node, ast.Assign) for node in tree.body)
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
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_no_module_is_long() -> None:
    lines = {str(path.relative_to(PACKAGE)): len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}


def test_the_house_does_not_grow() -> None:
    """Its size, as it is: a change that needs more says in its message why, and changes the design first."""
    texts = [path.read_text(encoding="utf-8") for path in MODULES]
    rooms = [path for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()]
    tests = [path.read_text(encoding="utf-8") for path in (PACKAGE.parent / "tests").rglob("*.py")]
    assert sum(text.count("\n") for text in texts) <= 86_784
    assert len(MODULES) <= 435
    assert len(rooms) <= 16
    assert len(list(PACKAGE.glob("*.py"))) <= 6
    assert sum(text.count("dict[str, Any]") for text in texts) <= 32
    assert sum(text.count("# fmt: skip") for text in texts) <= 20
    assert sum(text.count("\n") for text in tests) <= 64_590


def _fields(node: ast.ClassDef) -> set[str]:
    lines = (each.target for each in node.body if isinstance(each, ast.AnnAssign))
    return {target.id for target in lines if isinstance(target, ast.Name)}


def test_concepts_stand_once() -> None:
    """Loops over the events of light: the kernels', their adjoint's, the readable tracer's; the proof has its own.

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
        "kernels/adjoint.py", "kernels/trace.py", "light/reference_trace.py",
    }  # fmt: skip


def test_functions_take_few_parameters() -> None:
    counts = [
        len(node.args.args) + len(node.args.kwonlyargs) - (node.args.args[:1] != [] and node.args.args[0].arg == "self")
        for path in MODULES
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.FunctionDef)
    ]
    assert max(counts) <= 12
    assert sum(count > 8 for count in counts) <= 12


def test_copies_validate_what_they_are_given() -> None:
    """By ``changed`` of records and sections; pydantic's own copy takes anything, and any field."""
    copies = Counter(
        {str(path.relative_to(PACKAGE)): path.read_text(encoding="utf-8").count(".model_copy(") for path in MODULES}
    )
    assert +copies == Counter({"results/validation.py": 1, "results/stage_result.py": 1})  # its base, and what it drops


def test_tests_replace_little() -> None:
    """Places where a test, fixture or context replaces something as it runs; those where that is a constant."""
    tests = [path.read_text(encoding="utf-8") for path in (PACKAGE.parent / "tests").rglob("*.py")]
    replaced = [each for text in tests for each in re.findall(r"\.(?:setattr|setitem|delattr)\((.*)", text)]
    assert len(replaced) <= 112
    assert sum(bool(re.search(r"\b_?[A-Z][A-Z_]{2,}\b", each)) for each in replaced) <= 17


def test_every_file_has_a_name_of_its_own() -> None:
    """One name, one module, in an editor's tabs; formats of files have a folder of their own."""
    names = Counter(path.name for path in MODULES if path.name != "__init__.py")
    assert {name: count for name, count in names.items() if count > 1} == {}
