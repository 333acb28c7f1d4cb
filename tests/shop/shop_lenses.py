"""A small lens with any base, for the tests of drawing and handover."""

from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from scenes import random_surface, small_spec

from lensforge.scene.lens import Lens
from lensforge.shop.check import check_part
from lensforge.shop.face_check import check_face

BASE = {"diameter_mm": 16.0, "relief_step_mm": 0.4, "flange_diameter_mm": 20.0, "pocket_diameter_mm": 7.0}


def small_lens(base=BASE, manufacture=None, **sections):
    inner, outer = (random_surface(height, float(height), 0.01, (9, 25)) for height in (3, 6))
    own = {"source__side_mm": 0.5, "lens__refractive_index": 1.49, "lens__material": "<PMMA> & co"}
    own |= {"constraints__cavity_radius_mm": 0.5, "constraints__min_thickness_mm": 0.1, "constraints__max_radius_mm": 8}
    spec = small_spec(name="shop", **own, base=base, manufacture=manufacture or {}, **sections)
    return Lens.double(inner, outer, spec, 0, "draft")


class OfSpheres(Lens):
    """A lens that is told from others by itself: no lens file holds its surfaces."""

    __hash__ = object.__hash__
    sha256 = "0" * 64


@contextmanager
def few_nodes(nodes):
    """Checks on grids of ``nodes`` x ``nodes``, where a command takes 161."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lensforge.shop.check.check_face", partial(check_face, nodes=nodes))
        yield


def quick_check(part):
    """The check on a grid a quarter as dense: the same findings in a tenth of the time."""
    with few_nodes(81):
        return check_part(part)


def lagrange(fraction, count):
    """Weights of the polynomial through ``count`` nodes at -1, 0, 1, 2 (or 0, 1), written out by its definition."""
    nodes = np.arange(count) - (count // 2 - 1)
    return np.stack([np.prod([(fraction - o) / (n - o) for o in nodes if o != n], axis=0) for n in nodes], axis=-1)
