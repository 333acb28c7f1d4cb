"""A small lens with any base, for the tests of drawing and handover."""

import re
from functools import cache
from itertools import combinations

import numpy as np
from presets import CHECKED
from scenes import random_surface, small_spec

from lensforge.cad.part_export import build_part
from lensforge.scene.lens import Lens
from lensforge.shop.check import check_lens
from lensforge.shop.point_tables import COLUMNS
from lensforge.shop.sheet import box_of
from lensforge.shop.sheet_marks import dimension_text

BASE = {"diameter_mm": 16.0, "relief_step_mm": 0.4, "flange_diameter_mm": 20.0, "pocket_diameter_mm": 7.0}


def small_lens(base=BASE, manufacture=None, **sections):
    inner, outer = (random_surface(height, float(height), 0.01, (9, 25)) for height in (3, 6))
    fields = {"source__side_mm": 0.5, "lens__refractive_index": 1.49, "lens__material": "<PMMA> & co"}
    fields |= {
        "constraints__cavity_radius_mm": 0.5,
        "constraints__min_thickness_mm": 0.1,
        "constraints__max_radius_mm": 8,
    }
    spec = small_spec(
        name="shop", **fields, base=base, manufacture={"required": False} | (manufacture or {}), **sections
    )
    return Lens.double(inner, outer, spec, 0, CHECKED)


class OfSpheres(Lens):
    """A lens that is told from others by itself: no lens file holds its surfaces."""

    __hash__ = object.__hash__
    sha256 = "0" * 64


@cache
def bare_part():
    """The part of one lens without a base, and its check."""
    part = build_part(small_lens({"kind": "none"}), rings=16)
    return part, check_lens(part.lens, part.nodes)


def rows_of(grid):
    """Lines of the head of a dense table as one text, its columns, and its rows, as a reader of the file has them."""
    lines = grid.content.decode().splitlines()
    head = [line for line in lines if line.startswith("#")]
    rows = np.array([[float(value) for value in line.split(",")] for line in lines[len(head) + 1 :]])
    assert len(rows) == grid.points and lines[len(head)] == COLUMNS and grid.file == f"grid_{grid.face}.csv"
    return "\n".join(head), rows


def between_nodes(head, rows, count):
    """Points at 400 places of a face by the polynomials through ``count`` nodes of its dense table, as its head says.

    Its rings on the face are returned, too: [ring, azimuth, column], of a face at the axis without the apex.
    """
    turns, rim = (
        int(re.search(pattern, head).group(1))
        for pattern in (r"; (\d+) azimuths", r"ring (\d+) (?:is|reaches its crease,)")
    )
    begin = int(match.group(1)) if (match := re.search(r"from ring (\d+),", head)) else 0
    rings = (rows if begin else rows[1:]).reshape(-1, turns, 8)
    shift = 0 if begin else 1
    on_face = rings[begin : rim + 1 - shift]
    if not begin:  # the apex, and the first ring from the other side before it
        rings = np.concatenate([np.roll(rings[:1], turns // 2, axis=1), np.tile(rows[0], (1, turns, 1)), rings])
    values = np.stack([np.linalg.norm(rings[..., :2], axis=-1), rings[..., 2]], axis=-1)
    values[0] *= 1.0 if begin else np.array([-1.0, 1.0])
    rng = np.random.default_rng(4)
    around = np.arange(count) - (count // 2 - 1)
    t = begin + (rim - begin) * rng.random(400) ** 0.5
    turn = turns * rng.random(400)
    cell = np.minimum(np.floor(t).astype(int), rim - 1)
    sector = np.floor(turn).astype(int)
    near = values[(cell[:, None] + around + shift)[:, :, None], ((sector[:, None] + around) % turns)[:, None, :]]
    r, z = np.einsum("nabc,na,nb->cn", near, _lagrange(t - cell, count), _lagrange(turn - sector, count))
    azimuth = 2.0 * np.pi / turns * turn
    return np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth), z]), on_face


def _lagrange(fraction, count):
    """Weights of the polynomial through ``count`` nodes at -1, 0, 1, 2 (or 0, 1), written out by its definition."""
    nodes = np.arange(count) - (count // 2 - 1)
    return np.stack([np.prod([(fraction - o) / (n - o) for o in nodes if o != n], axis=0) for n in nodes], axis=-1)


def all_words(sheet):
    return [*sheet.marks.texts, *(dimension_text(dimension) for dimension in sheet.marks.dimensions)]


def boxes_of(sheet):
    """The box of each text, all of them apart and within the frame."""
    boxes = [box_of(label) for label in all_words(sheet)]
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    assert min(box[0] for box in boxes) > 20.0 and max(box[2] for box in boxes) < sheet.size_mm[0] - 10.0
    assert min(box[1] for box in boxes) > 10.0 and max(box[3] for box in boxes) < sheet.size_mm[1] - 10.0
    return boxes
