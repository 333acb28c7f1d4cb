"""Array shapes and dtypes in signatures are checked while the tests run."""

import shutil
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

import lensforge

_PACKAGES = [
    "surfaces", "optics", "sources", "tracing", "receivers", "evaluation", "far_field", "optimisation", "geometry",
    "manufacturing", "verification", "measurement",
]  # fmt: skip
# Kernels are compiled by numba and cannot be wrapped; they have a folder of their own.
install_import_hook([f"lensforge.{package}" for package in _PACKAGES], "beartype.beartype")


@pytest.fixture
def examples() -> Path:
    return Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> lensforge.Run:
    """A small lens, the whole way: what ``run`` returned, and its folder as it left it."""
    from scenes import small_spec  # not before the import hook is there

    folder = tmp_path_factory.mktemp("small_run") / "small"
    return lensforge.run(small_spec(optimise__steps_per_level=[40, 40]), folder, accuracy="draft")


@pytest.fixture(scope="session")
def whole_run(small_run: lensforge.Run, tmp_path_factory: pytest.TempPathFactory) -> lensforge.Run:
    """The same in a folder of its own, with all that can be asked for besides."""
    from lensforge.pipeline import run_photometry, run_sensitivity, run_stray

    folder = tmp_path_factory.mktemp("whole_run") / "small"
    shutil.copytree(small_run.folder, folder)
    run_stray(folder, rays=512)
    run_sensitivity(folder, rays=512)
    run_photometry(folder, rays=4096)
    return lensforge.load(folder)
