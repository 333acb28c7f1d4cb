"""The handover of a lens for total internal reflection: tables up to the creases, sizes, section and sheet.

The part and the check are those of a lens of two faces under the names of four: drawing and tables are of the lens.
"""

import io
import re

import ezdxf
import numpy as np
import pytest
from known_shapes import sphere
from presets import CHECKED
from shop_lenses import OfSpheres, bare_part, between_nodes, rows_of
from tir_lenses import TIR, spot, spot_lens

from lensforge.shop.dimensions import dimensions
from lensforge.shop.shop_files import make_handover
from lensforge.shop.view_lines import section_view

# Spheres by radius and height of their centre. Cap and side meet where 4 - (z + 0.5)^2 = 1.8^2 - z^2, wall and exit
# where 25 - (z - 2)^2 = 144 - (z + 6)^2.
SPHERES = dict(zip(TIR, ((2.0, -0.5), (1.8, 0.0), (5.0, 2.0), (12.0, -6.0)), strict=True))
MET = {"cap and side": 0.51, "exit and wall": 87.0 / 16.0}
WIDTH = {
    "cap and side": 2.0 * np.sqrt(1.8**2 - 0.51**2),
    "exit and wall": 2.0 * np.sqrt(25.0 - (87.0 / 16.0 - 2.0) ** 2),
}


@pytest.fixture(scope="module")
def handed():
    """The lens and its files."""
    (part, record) = bare_part()
    lens = spot_lens()
    twice = {name: record.faces["inner" if name in ("cap", "side") else "outer"] for name in TIR}
    fields = {name: getattr(record, name) for name in type(record).model_fields}
    check = type(record).model_construct(**{**fields, **twice, "lens": lens})
    return lens, make_handover(part.model_copy(update={"lens": lens}), check, [])


def domain_of(lens, name, polar):
    """True where the face of that name bounds its medium in the directions of the meridian at azimuth 0."""
    beside = TIR[:2] if name in TIR[:2] else TIR[2:]
    u = np.column_stack([np.sin(polar), np.zeros_like(polar), np.cos(polar)])
    radii = {face: lens.surfaces[face].radius(u) for face in beside}
    return radii[name] <= np.min(list(radii.values()), axis=0) + 1e-9


def test_a_table_from_crease_to_rim_read_back_and_interpolated_is_within_its_stated_error(handed):
    lens, made = handed
    for name, grid in zip(TIR, made.grids, strict=True):
        (head, rows) = rows_of(grid)
        surface = lens.surfaces[name]
        between, rings = between_nodes(head, rows, 4)
        begin, rim = np.radians(rings[[0, -1], 0, 6])
        domain = domain_of(lens, name, np.linspace(begin if name in ("side", "wall") else 0.0, rim, 400))
        assert domain[1:-1].all() and (("from ring" in head) == (name in ("side", "wall")) == (rim > 1.5))
        radius = np.linalg.norm(between, axis=1, keepdims=True)
        u = between / radius
        off = (radius[:, 0] - surface.radius(u)) * np.sum(surface.normal(u) * u, axis=1)
        assert 1e6 * np.abs(off).max() <= 1.05 * grid.error_nm + 2e-3 <= 11.0


def test_the_sizes_of_creases_are_those_of_spheres_that_meet():
    faces = {name: sphere(radius, (0.0, 0.0, height)) for name, (radius, height) in SPHERES.items()}
    spec = spot(exit={"gap_mm": 0.07}).replace(base={"kind": "none"})
    lens = OfSpheres(faces, spec, 0, CHECKED)
    by_name = {dimension.name: dimension for dimension in dimensions(lens)}
    for name, height in MET.items():
        radius = 0.5 * WIDTH[name]
        width, above = (by_name[f"crease of {name}, along x{more}"] for more in ("", ", above z = 0"))
        assert width.value_mm == pytest.approx(2.0 * radius, abs=1e-9)
        assert above.value_mm == pytest.approx(height, abs=1e-9)
        assert width.ends == (pytest.approx((height, -radius)), pytest.approx((height, radius)))
        assert width.tolerance == above.tolerance == "auxiliary"
    assert by_name["thickness on the axis"].tolerance_mm == 0.07
    lens = OfSpheres(
        {**faces, "wall": sphere(12.0, (0.0, 0.0, 6.0)), "exit": sphere(40.0, (0.0, 0.0, -35.0))}, spec, 0, ""
    )
    by_name = {dimension.name: dimension.value_mm for dimension in dimensions(lens)}
    rim = 2.0 * np.sqrt(144.0 - (267.0 / 82.0 - 6.0) ** 2)
    assert by_name["width of the lens"] == pytest.approx(rim, abs=1e-9), "widest at its crease"
    lens = OfSpheres(faces, spec, 0, CHECKED)
    (seen,) = (
        line.points for line in section_view(lens, "S", 0.0).lines if np.abs(line.points[:, 0] - 0.51).max() < 1e-9
    )
    assert np.ptp(seen[:, 1]) == pytest.approx(WIDTH["cap and side"], abs=1e-3), "the crease in the open cavity"


def test_the_section_and_the_sheet_show_every_face(handed):
    lens, made = handed
    (outline,) = section_view(lens, "S", 0.0).outlines
    z, x = outline[outline[:, 0] > 1e-6].T
    distance = np.hypot(x, z)
    u = np.column_stack([x / distance, np.zeros_like(x), z / distance])
    off = {name: np.abs(lens.surfaces[name].radius(u) - distance) for name in TIR}
    assert np.min(list(off.values()), axis=0).max() < 1e-9
    assert all((gaps < 1e-9).sum() > 20 for gaps in off.values()), "of all four faces"
    page = made.html.decode("utf-8")
    for name in TIR:  # as far as it bounds its medium
        polar = np.radians(np.linspace(0.0, 90.0, 90_001))
        domain = domain_of(lens, name, polar)
        ways = np.column_stack([np.sin(polar), 0.0 * polar, np.cos(polar)])[domain]
        widest = 2.0 * float((lens.surfaces[name].radius(ways) * ways[:, 0]).max())
        stated = re.findall("Effective aperture: ⌀([0-9.]+)", page)[("exit", "wall", "side", "cap").index(name)]
        assert float(stated) == pytest.approx(widest, abs=2e-3)
    document = ezdxf.read(io.StringIO(made.dxf.decode("utf-8")))
    assert not document.audit().errors
    measured = np.array([entity.get_measurement() for entity in document.modelspace().query("DIMENSION")])
    for dimension in dimensions(lens):
        assert dimension.ends is None or np.abs(measured - dimension.value_mm).min() < 1e-9, dimension.name
    page = made.html.decode("utf-8")
    for name in TIR:
        assert f"OPTICAL_{name.upper()}" in page and f"form, {name} face" in page
    assert "wall face against cap, tilt" in page and "exit face against cap, gap" in page
    scale = next(text for text in re.findall(r"scale ([\d :]+)", page))
    assert scale.strip() in ("2 : 1", "5 : 1")
