"""Array shapes and dtypes in signatures are checked while the tests run."""

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

import lensforge

_PACKAGES = [
    "surfaces", "optics", "sources", "tracing", "receiver", "evaluation", "photometry", "design", "geometry",
    "manufacturing", "verification", "measurement",
]  # fmt: skip
# Kernels are compiled by numba and cannot be wrapped; what takes arrays elsewhere is checked. (The hook takes a name
# for all that begins with it, so a package that holds kernels is named module by module.)
_FOLDER = Path(lensforge.__file__).parent
_CHECKED = [
    ".".join(module.relative_to(_FOLDER.parent).with_suffix("").parts)
    for package in _PACKAGES
    for module in sorted((_FOLDER / package).rglob("*.py"))
    if not module.stem.endswith(("__", "_kernel"))
]
install_import_hook(_CHECKED, "beartype.beartype")


@pytest.fixture
def examples() -> Path:
    return Path(__file__).parents[1] / "examples"
