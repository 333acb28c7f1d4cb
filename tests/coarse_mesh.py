"""Parts of few triangles: for tests that read what is said of a part, and not how good its mesh is."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from lensforge.geometry import export

_RINGS = 24  # 8,000 triangles where a command makes 115,000; such a part passes its verification, too


@contextmanager
def coarse_mesh() -> Iterator[None]:
    """Parts are built with a mesh of 24 equal rings, whatever chord is asked for."""
    built = export.build_mesh

    def coarse(plan: Any, rings: int, chord_mm: float | None = None) -> Any:
        return built(plan, _RINGS)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "build_mesh", coarse)
        yield
