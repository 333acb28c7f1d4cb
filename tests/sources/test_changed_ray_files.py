"""Ray files that another program writes to, replaces or deletes while their rays are in use."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.sources import stored_rays
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import read_rayfile, write_rayfile
from lensforge.sources.stored_rays import StoredRays

FIRST = slice(0, 50)


def write(path: Path, seed: int) -> None:
    sample = SquareEmitter(1.0).sample(500, seed)
    rays = (array.astype(np.float32) for array in (sample.origins, sample.directions, sample.flux))
    write_rayfile(path, RayFile(*rays, "W"), "tm25")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "led.tm25ray"
    write(path, seed=1)
    return path


@pytest.fixture
def rays(path: Path, monkeypatch: pytest.MonkeyPatch) -> StoredRays:
    """Rays that stay in their file."""
    monkeypatch.setattr(stored_rays, "LOADED_RAYS", 100)
    stored = StoredRays.of(read_rayfile(path))
    assert stored.loaded() is stored
    return stored


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:3000]), r" to 3000 bytes\)"),
        (lambda path: path.write_bytes(path.read_bytes()[::-1]), r"bytes as before\)"),
    ],
    ids=["truncated", "overwritten"],
)
def test_a_file_that_is_written_to_is_refused_in_one_line(
    path: Path, rays: StoredRays, change: Callable[[Path], object], told: str
) -> None:
    """Beyond the end of a mapped file the system would end the process without a word."""
    rays.take(FIRST)
    change(path)
    with pytest.raises(InputError, match=f"led.tm25ray: was written to while its rays were in use .*{told}; start"):
        rays.take(FIRST)


def test_a_file_that_is_replaced_or_deleted_keeps_its_rays(path: Path, rays: StoredRays) -> None:
    before = rays.take(FIRST).flux
    other = path.with_name("other.tm25ray")
    write(other, seed=2)
    other.replace(path)
    np.testing.assert_array_equal(rays.take(FIRST).flux, before)
    path.unlink()
    np.testing.assert_array_equal(rays.take(FIRST).flux, before)
