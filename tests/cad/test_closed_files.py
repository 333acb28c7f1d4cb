"""Each file of the part is judged by its own closure: a torn one beside a whole one."""

from functools import cache

import numpy as np
import pytest
from geometry_lenses import make_lens

from lensforge.cad import part_export
from lensforge.cad.mesh import BodyMesh
from lensforge.cad.mesh_files import parse_stl, stl_bytes, threemf_bytes
from lensforge.cad.part import Part
from lensforge.cad.part_export import build_part


@cache
def part() -> Part:
    return build_part(make_lens(0.8, 2.45), rings=12)


def torn() -> BodyMesh:
    vertices, triangles = parse_stl(part().stl)
    kept = triangles[1:]
    return BodyMesh(vertices, kept, np.zeros(len(kept), dtype=int), ("ALL",), 1)


@pytest.mark.parametrize(("open_file", "closed"), [("threemf_bytes", (1.0, 0.0)), ("stl_bytes", (0.0, 1.0))])
def test_a_torn_file_is_said_to_be_open_and_the_whole_one_beside_it_is_not(
    monkeypatch: pytest.MonkeyPatch, open_file: str, closed: tuple[float, float]
) -> None:
    content = {"stl_bytes": stl_bytes(torn()), "threemf_bytes": threemf_bytes(torn(), "torn")}[open_file]
    monkeypatch.setattr(part_export, open_file, lambda *_: content)
    values = {criterion.key: criterion.value for criterion in build_part(make_lens(0.8, 2.45), rings=12).criteria}
    assert (values["watertight"], values["watertight_3mf"]) == closed
    whole = {criterion.key: criterion.value for criterion in part().criteria}
    assert (whole["watertight"], whole["watertight_3mf"]) == (1.0, 1.0)
