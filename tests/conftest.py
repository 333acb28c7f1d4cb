"""Array shapes and dtypes in signatures are checked while the tests run."""

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

# Kernels are compiled by numba and cannot be wrapped; what takes arrays elsewhere is checked.
_CHECKED = [
    "lensforge.surfaces",
    "lensforge.optics",
    "lensforge.receiver.plane",
    "lensforge.receiver.bins",
    "lensforge.receiver.filter",
    "lensforge.receiver.losses",
    "lensforge.receiver.targets",
    "lensforge.sources",
    "lensforge.evaluation",
    "lensforge.photometry",
    "lensforge.design",
    "lensforge.geometry",
    "lensforge.manufacturing",
    "lensforge.verification",
    "lensforge.measurement",
]
install_import_hook(_CHECKED, "beartype.beartype")


@pytest.fixture
def examples() -> Path:
    return Path(__file__).parents[1] / "examples"
