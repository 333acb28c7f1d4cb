"""Tests that state the truth of a module: the test files that import from it, those of its own room first."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = (
    "light",
    "scene",
    "search",
    "shop",
    "sources",
)  # NumPy and torch; a change of what numba compiles takes minutes
SOURCES_OF_FILES = ("sources/rayfiles/", "sources/photometric/")  # the fuzzer's


def modules() -> list[str]:
    """The measured modules, as paths below ``lensforge``: those that some test imports."""
    found = [
        path.relative_to(ROOT / "lensforge").as_posix()
        for room in ROOMS
        for path in sorted((ROOT / "lensforge" / room).rglob("*.py"))
    ]
    return [name for name in found if not name.startswith(SOURCES_OF_FILES) and files_of(name)]


@cache
def files_of(module: str) -> tuple[str, ...]:
    """Test files of ``module``, without ending, as paths below ``tests``."""
    dotted, room = "lensforge." + module.removesuffix(".py").replace("/", "."), module.split("/")[0]
    found = [name for name, imported in _imports().items() if dotted in imported]
    return tuple(sorted(found, key=lambda name: (not name.startswith(room + "/"), name)))


@cache
def _imports() -> dict[str, set[str]]:
    """Modules that each test file imports."""
    return {
        path.relative_to(ROOT / "tests").with_suffix("").as_posix(): _imported(path)
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
    }


def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names
