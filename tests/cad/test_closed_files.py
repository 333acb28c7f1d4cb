"""Each file of the part is judged by its own closure: a torn one beside a whole one."""

from functools import cache

import numpy as np
from geometry_lenses import make_lens

from lensforge.cad.body_export import figures_as_read
from lensforge.cad.mesh import BodyMesh, check_closed
from lensforge.cad.mesh_files import parse_3mf, parse_stl, stl_bytes, threemf_bytes
from lensforge.cad.part import Part
from lensforge.cad.part_export import build_part
from lensforge.cad.step import parse_step


@cache
def part() -> Part:
    return build_part(make_lens(0.8, 2.45), rings=12)


def torn() -> BodyMesh:
    vertices, triangles = parse_stl(part().stl)
    kept = triangles[1:]
    return BodyMesh(vertices, kept, np.zeros(len(kept), dtype=int), ("ALL",), 1)


def test_a_torn_file_is_said_to_be_open_and_the_whole_one_beside_it_is_not() -> None:
    solid, whole_stl, whole_3mf = parse_step(part().step), part().stl, part().threemf
    open_stl, open_3mf = stl_bytes(torn()), threemf_bytes(torn(), "torn")
    for stl, threemf, closed in (
        (whole_stl, whole_3mf, (1.0, 1.0)),
        (whole_stl, open_3mf, (1.0, 0.0)),
        (open_stl, whole_3mf, (0.0, 1.0)),
    ):
        found = figures_as_read(solid, check_closed(*parse_stl(stl)), check_closed(*parse_3mf(threemf)), 1.0)
        assert (found["watertight"], found["watertight_3mf"]) == closed
