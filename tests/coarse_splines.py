"""Splines of faces that begin with few nodes, as far as their form bears it: for tests of what is made of them."""

from collections.abc import Iterator

import pytest
from nightly import NIGHTLY

_NODES = 40  # where a command takes 72: a quarter of the poles to write, to read and to integrate over


@pytest.fixture(scope="module", autouse=True)
def coarse_splines() -> Iterator[None]:
    """By day faces of a smooth lens begin with half as many nodes; a fit still takes as many as its form needs."""
    with pytest.MonkeyPatch.context() as patch:
        if not NIGHTLY:
            patch.setattr("lensforge.cad.patch.MIN_NODES", _NODES)
        yield
