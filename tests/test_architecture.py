"""The one-way order of imports, held by walking the syntax trees."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "lensforge"

# From the ground up: a module may import from its own layer's package and from the layers above it in this list.
ORDER = [
    "version", "errors", "files", "gates", "surfaces", "optics", "spec", "accuracy", "lens", "sources",
    "tracing", "receiver", "design", "evaluation", "tolerancing", "photometry", "geometry", "manufacturing",
    "verification", "measurement", "report", "handover", "progress", "pipeline", "tradeoff", "sweep", "commands", "cli",
    "__main__",
]  # fmt: skip
MODULES = sorted(PACKAGE.rglob("*.py"))


def _layer(dotted: str) -> str:
    return dotted.split(".")[1]


def _imports(tree: ast.AST) -> list[str]:
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the order"
            names.append(node.module or "")
    return names


def _own(tree: ast.AST) -> list[str]:
    return [name for name in _imports(tree) if name.startswith("lensforge.")]


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_one_way(path: Path) -> None:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    if parts == ("__init__",):
        return
    layer = parts[0]
    assert layer in ORDER, f"{layer} has no place in the order yet"
    for name in _own(ast.parse(path.read_text(encoding="utf-8"))):
        assert ORDER.index(_layer(name)) <= ORDER.index(layer), f"{layer} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_own_imports_stand_at_the_top(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inner = [
        node for outer in tree.body if not isinstance(outer, ast.Import | ast.ImportFrom) for node in ast.walk(outer)
    ]
    hidden = [name for node in inner if isinstance(node, ast.Import | ast.ImportFrom) for name in _own(node)]
    assert not hidden


def test_there_are_no_cycles() -> None:
    graph = {
        ".".join(("lensforge", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): _own(
            ast.parse(path.read_text(encoding="utf-8"))
        )
        for path in MODULES
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join((*trail, name))
        if name not in done:
            for following in graph.get(name, []):
                visit(following, (*trail, name))
            done.add(name)

    for name in graph:
        visit(name, ())


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("lensforge.cli", ["torch", "numpy", "numba", "cadquery", "pydantic"]),
        ("lensforge.geometry.export", ["torch", "numba", "cadquery", "trimesh"]),
        ("lensforge.manufacturing.check", ["torch", "numba", "cadquery"]),
        ("lensforge.verification.verify", ["torch", "numba", "cadquery", "embreex"]),
        (
            "lensforge.pipeline",
            ["cadquery", "trimesh", "pyvista", "matplotlib", "skimage", "lensforge.sources.rayfiles"],
        ),
    ],
)
def test_a_part_loads_only_what_it_needs(module: str, absent: list[str]) -> None:
    code = f"import sys, {module}; print([name for name in {absent!r} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(("given", "kept"), [(None, "PASSIVE"), ("ACTIVE", "ACTIVE")])
def test_threads_of_torch_sleep_unless_the_user_has_said_otherwise(given: str | None, kept: str) -> None:
    others = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
    code = "import lensforge, os; print(os.environ['OMP_WAIT_POLICY'])"
    environment = others if given is None else others | {"OMP_WAIT_POLICY": given}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, encoding="utf-8", env=environment, check=True
    )
    assert run.stdout.strip() == kept


def test_verification_shares_nothing_with_the_design() -> None:
    allowed = {"errors", "files", "gates", "sources", "verification"}
    for path in (PACKAGE / "verification").glob("*.py"):
        for name in _own(ast.parse(path.read_text(encoding="utf-8"))):
            assert _layer(name) in allowed, f"{path.name} imports {name}"
            assert _layer(name) != "sources" or name == "lensforge.sources.bundle"
