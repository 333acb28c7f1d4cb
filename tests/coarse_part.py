"""Parts of few triangles, checked at few points: for tests that read what is said of a part, and not how good it is."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest

from lensforge.cad import body_export
from lensforge.shop import check
from lensforge.shop.face_check import check_face

RINGS = 24  # 8,000 triangles where a command makes 115,000; such a part passes its verification, too
_NODES = 61  # across a face, where a command takes 161: of three seconds a quarter


@contextmanager
def coarse_part() -> Iterator[None]:
    """Parts are built with a mesh of 24 equal rings, whatever chord is asked for, and checked on 61 x 61 nodes."""
    built = body_export.build_mesh

    def coarse(plan: Any, rings: int, chord_mm: float | None = None) -> Any:
        return built(plan, RINGS)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(body_export, "build_mesh", coarse)
        patch.setattr(check, "check_face", partial(check_face, nodes=_NODES))
        yield
