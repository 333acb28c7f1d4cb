"""The one-way order of imports, held by walking the syntax trees."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest
from nightly import NIGHTLY

import lensforge

PACKAGE = Path(__file__).parents[1] / "lensforge"

# From the ground up: a module may import from its own room and from those before it in this list.
ORDER = [
    "version", "seeds", "public", "errors", "addon", "results", "kernels", "optics", "surfaces", "spec", "sources",
    "scene", "light", "cad", "search", "shop", "proof", "made", "report", "verbs", "cli", "addons", "__main__",
]  # fmt: skip
# What a module may load only when one of its functions is called: each takes a tenth of a second or more.
HEAVY = {
    "torch", "numba", "scipy", "cadquery", "OCP", "trimesh", "manifold3d", "lib3mf", "pyvista", "matplotlib",
    "skimage", "PIL", "tifffile", "imagecodecs", "jinja2", "rich", "mitsuba", "yaml", "dask", "distributed", "aiohttp",
    "tomlkit", "mcp",
}  # fmt: skip
# Rooms of many modules that few scripts need: together they would be a sixth of what importing the library takes.
SELDOM = (
    "lensforge.sources.rayfiles", "lensforge.sources.ray_file", "lensforge.sources.stored_rays",
    "lensforge.sources.model_of_file", "lensforge.report.sweep", "lensforge.report.tradeoff_study",
)  # fmt: skip
MODULES = sorted(PACKAGE.rglob("*.py"))


def _layer(dotted: str) -> str:
    return dotted.split(".")[1]


def _name(path: Path) -> str:
    return ".".join(("lensforge", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__")


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


_BODIES = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


@cache
def _walked(path: Path) -> list[tuple[ast.AST, bool]]:
    """Every import and every constant of a module, and whether it stands in a function or a class."""
    outer = [(node, isinstance(body, _BODIES)) for body in _tree(path).body for node in ast.walk(body)]
    return [pair for pair in outer if isinstance(pair[0], ast.Import | ast.ImportFrom | ast.Constant)]


@cache
def _imports(path: Path) -> list[str]:
    """Every module that is imported anywhere in it, inside functions too."""
    return _named(node for node, _ in _walked(path))


def _named(nodes: Iterable[ast.AST]) -> list[str]:
    names = []
    for node in nodes:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the order"
            module = node.module or ""
            submodules = [f"{module}.{alias.name}" for alias in node.names if f"{module}.{alias.name}" in NAMES]
            names += submodules or [module]
    return names


NAMES = {_name(path) for path in MODULES}


def _own(path: Path) -> list[str]:
    return [name for name in _imports(path) if name.startswith("lensforge.")]


@cache
def _at_the_top(name: str) -> list[str]:
    """Modules that are imported as the module loads."""
    path = PACKAGE.joinpath(*name.split(".")[1:])
    return _named(_tree(path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).body)


@cache
def _loaded_by(name: str) -> set[str]:
    """All that loads with a module of ours, by the imports at the top of it and of what it imports."""
    loaded, waiting = set(), [name]
    while waiting:
        new = set(_at_the_top(waiting.pop())) - loaded
        loaded |= new
        waiting += new & NAMES
    return loaded


def test_imports_run_one_way() -> None:
    wrong = []
    for path in MODULES:
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts == ("__init__",):
            continue  # it offers what the rooms have, and nothing imports from it
        layer = parts[0]
        assert layer in ORDER, f"{layer} has no place in the order yet"
        later = [name for name in _own(path) if ORDER.index(_layer(name)) > ORDER.index(layer)]
        wrong += [f"{_name(path)} imports {name}" for name in later]
    assert wrong == []


DECLARED = sorted(PACKAGE.glob("addons/*/__init__.py"))  # what each add-on adds: a room takes what is of its kind


def test_the_core_imports_no_add_on_and_no_add_on_another() -> None:
    wrong = []
    for path in MODULES:
        addon = PACKAGE / "addons" in path.parents and _name(path).split(".")[2:3]
        added = [name.split(".") for name in _own(path) if name.startswith("lensforge.addons.")]
        wrong += [f"{_name(path)} imports {'.'.join(name)}" for name in added if path != NAMED and name[2:3] != addon]
    assert wrong == []
    assert all(isinstance(node, ast.If | ast.Expr | ast.ImportFrom) for node in _tree(NAMED).body)
    assert _at_the_top("lensforge.addons") == ["typing"], "only for those who check types"


NAMED = PACKAGE / "addons/__init__.py"


@pytest.mark.parametrize("room", ["rayfiles", "photometric"])
def test_a_room_of_file_formats_takes_no_more_than_errors_and_text_tables(room: str) -> None:
    allowed = {
        "errors",
        "version",
        "results.files",
        "results.table_names",
        "results.text_dialect",
        "results.text_table",
    }
    taken = {name for path in (PACKAGE / "sources" / room).rglob("*.py") for name in _own(path)}
    others = {name for name in taken if not name.startswith(f"lensforge.sources.{room}")}
    assert others <= {f"lensforge.{name}" for name in allowed}


def test_own_imports_inside_functions_put_off_something_heavy() -> None:
    at_the_top = []
    for path in sorted({*MODULES} - {*DECLARED}):
        for name in _named(node for node, inside in _walked(path) if inside):
            if name.startswith("lensforge."):
                loaded = {module.split(".")[0] for module in _loaded_by(name)}
                seldom = name.startswith(SELDOM) and not _name(path).startswith(SELDOM)
                if not (loaded & HEAVY or seldom):
                    at_the_top.append(f"{_name(path)}: {name} loads nothing heavy")
    assert at_the_top == []


# Those whose folder is a list: each module there is a format, each package an add-on.
LOADS_ITS_FOLDER = (PACKAGE / "sources/rayfiles/formats/__init__.py", PACKAGE / "addon.py")


def test_no_module_is_named_in_a_string() -> None:
    for path in MODULES:
        if path in LOADS_ITS_FOLDER:
            continue
        for node, _ in _walked(path):
            if isinstance(node, ast.ImportFrom) and node.module == "importlib":
                assert all(alias.name != "import_module" for alias in node.names), path
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value not in ALLOWED:
                assert node.value not in NAMES, f"{path}: {node.value!r}"
        assert "importlib.import_module" not in path.read_text(encoding="utf-8"), path


ALLOWED = {"lensforge", "lensforge.verbs", "lensforge.addons"}  # names of the program, in an error, of a group


def test_no_verb_has_the_name_of_a_module() -> None:
    """The import of a module would put it in the verb's place."""
    modules = {name.split(".")[1] for name in NAMES if name.count(".") == 1}
    assert not modules & set(lensforge.__all__)


def test_there_are_no_cycles() -> None:
    graph = {_name(path): _own(path) for path in MODULES}
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join((*trail, name))
        if name not in done:
            for following in graph.get(name, []):
                visit(following, (*trail, name))
            done.add(name)

    for name in graph:
        visit(name, ())


# What is absent after the import of a part and of those before it: one process answers for each list.
ABSENT = [
    {
        "lensforge": sorted({*HEAVY, "numpy", "pydantic"}),
        "lensforge.verbs": sorted(HEAVY),
        "lensforge.cli.cli": sorted(HEAVY),
        "lensforge.cad.part_export": ["torch", "numba", "cadquery", "trimesh"],
        "lensforge.shop.check": ["torch", "numba", "cadquery"],
        "lensforge.proof.verification": ["torch", "numba", "cadquery", "embreex"],
    },
    {"lensforge.report.lens_page": ["torch", "cadquery", "trimesh", "pyvista"]},
    {
        "lensforge.search.optimiser": [
            "cadquery", "trimesh", "pyvista", "matplotlib", "skimage", "scipy.stats", "lensforge.sources.rayfiles",
        ],
    },
]  # fmt: skip


@cache
def _loaded_too_early(group: int) -> dict[str, list[str]]:
    """What is there of a list of ``ABSENT`` after each import, in a process of its own."""
    code = (
        "import importlib, json, sys; absent = json.loads(sys.argv[1]); found = {}\n"
        "for module, names in absent.items():\n"
        "    importlib.import_module(module)\n"
        "    found[module] = [name for name in names if name in sys.modules]\n"
        "print(json.dumps(found))"
    )
    command = [sys.executable, "-c", code, json.dumps(ABSENT[group])]
    loaded: dict[str, list[str]] = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    return loaded


@pytest.mark.parametrize(
    ("group", "module"), [(k, module) for k, group in enumerate(ABSENT[: 3 if NIGHTLY else 2]) for module in group]
)
def test_a_part_loads_only_what_it_needs(group: int, module: str) -> None:
    assert _loaded_too_early(group)[module] == []


def test_cadquery_is_loaded_for_the_user_s_own_solids_alone() -> None:
    """With all that it loads it takes 1.6 s more than the CAD kernel."""
    users = {_name(path) for path in MODULES if "cadquery" in _imports(path)}
    assert users == {"lensforge.cad.part", "lensforge.cad.custom_base"}


def test_verification_shares_nothing_with_the_design() -> None:
    allowed = {"public", "errors", "results", "kernels", "sources", "optics", "proof"}
    modules = {
        "sources": {"lensforge.sources.ray_bundle"},
        "optics": {"lensforge.optics.media", "lensforge.optics.face_roles"},  # what is where, no light
        "kernels": {"lensforge.kernels.compiled"},  # the compiler, no kernel
    }
    for path in (PACKAGE / "proof").rglob("*.py"):
        if path.name in ("proof_inputs.py", "form_inputs.py", "casts.py", "export_trial.py"):
            continue  # what the others are given of the spec, the verbs, and the export that looks ahead
        for name in _own(path):
            assert _layer(name) in allowed, f"{path.name} imports {name}"
            assert name in modules.get(_layer(name), {name}), f"{path.name} imports {name}"


def test_rays_that_verification_draws_use_no_code_of_the_design_s_sampler() -> None:
    samplers = {"emitting_area", "planar_emitter", "radiance_emitter", "intensity", "inverse_cdf", "build_source"}
    for name in ("proof_inputs.py", "independent_draws.py"):
        nodes = [node for node, _ in _walked(PACKAGE / "proof" / name)]
        for node in filter(lambda node: isinstance(node, ast.ImportFrom), nodes):
            taken = {alias.name for alias in node.names} - {"read_radiance"}  # the table of a file
            assert (node.module or "").removeprefix("lensforge.sources.") not in samplers or not taken, name
