"""Array shapes and dtypes in signatures are checked while the tests run."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import install_import_hook

import lensforge

_PACKAGES = [
    "surfaces", "optics", "sources", "tracing", "receivers", "evaluation", "far_field", "optimisation", "geometry",
    "manufacturing", "verification", "measurement", "pictures",
]  # fmt: skip
# Kernels are compiled by numba and cannot be wrapped; they have a folder of their own.
install_import_hook([f"lensforge.{package}" for package in _PACKAGES], "beartype.beartype")


@pytest.fixture
def examples() -> Path:
    return Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> lensforge.Run:
    """A run of a small lens: the object that ``run`` returned, and its folder as it left it."""
    from scenes import small_spec  # not before the import hook is there

    folder = tmp_path_factory.mktemp("small_run") / "small"
    return lensforge.run(small_spec(optimise__steps_per_level=[40, 40]), folder, accuracy="draft")


@pytest.fixture(scope="session")
def whole_run(small_run: lensforge.Run, tmp_path_factory: pytest.TempPathFactory) -> lensforge.Run:
    """The same in a folder of its own, with every result that can be added: studies of the lens, a measured part."""
    from lensforge.pipeline import run_photometry, run_sensitivity, run_stray

    folder = tmp_path_factory.mktemp("whole_run") / "small"
    shutil.copytree(small_run.folder, folder)
    with pytest.MonkeyPatch.context() as patch:  # as few rays as tests need, and yet the lens's own conditions
        patch.setattr("lensforge.stages._STRAY_RAYS", 512)
        patch.setattr("lensforge.tolerancing.sensitivity.RAYS", 512)
        run_stray(folder)
        run_sensitivity(folder)
    run_photometry(folder)
    _measure_part(small_run, folder)
    return lensforge.load(folder)


def _measure_part(run: lensforge.Run, folder: Path) -> None:
    """Compare with a photograph of the simulated light itself, and with points of the design's own inner surface."""
    from PIL import Image
    from scenes import hemisphere_directions

    from lensforge.compared_folder import run_compare_photo, run_compare_surface

    light = run.light.map
    seen = np.kron(light[::-1] / light.max(), np.ones((8, 8)))  # 8 pixels of the camera for each, row 0 on top
    photo, cloud = folder.with_name("on.png"), folder.with_name("cloud.csv")
    Image.fromarray(np.round(60000 * np.pad(seen, 10)).astype(np.uint16)).save(photo)
    low, high = 9.5, 9.5 + 8 * len(light)
    run_compare_photo(folder, on=photo, off=None, corners=[(low, low), (high, low), (high, high), (low, high)])
    u = hemisphere_directions(2000)
    np.savetxt(cloud, u * run.lens.inner.radius(u)[:, None], delimiter=",")
    run_compare_surface(folder, points=cloud, surface="inner")
