import numpy as np
import pytest
import trimesh
from geometry_lenses import make_lens, plan_of

from lensforge.cad.custom_base import join_mesh, read_custom_base
from lensforge.cad.mesh import build_mesh
from lensforge.cad.section import body_outlines

BASES = {
    "none": {"kind": "none"},
    "cylinder": {},
    "flat, step, flange": {"flat_mm": 11.5, "relief_step_mm": 0.7, "flange_diameter_mm": 32.0},
    "square, set back, pocket": {
        "kind": "square",
        "side_mm": 26.0,
        "relief_step_mm": 0.7,
        "relief_setback_mm": 0.4,
        "pocket_diameter_mm": 16.0,
    },
    "overhang": {"diameter_mm": 16.0},
    "overhang, set back": {"diameter_mm": 16.0, "relief_step_mm": 0.6, "relief_setback_mm": 0.4},
}


def area(outlines):
    x_z = (outline.T for outline in outlines)
    return sum(0.5 * abs(np.sum(x * np.roll(z, -1) - z * np.roll(x, -1))) for x, z in x_z)


def cut_area(mesh, azimuth_deg):
    """Area of the plane cut of a mesh: the oracle."""
    turn = np.radians(azimuth_deg)
    body = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    cut = body.section(plane_origin=[0.0, 0.0, 0.0], plane_normal=[-np.sin(turn), np.cos(turn), 0.0])
    across = np.array([np.cos(turn), np.sin(turn), 0.0])
    return area([np.column_stack([line @ across, line[:, 2]]) for line in cut.discrete])


@pytest.mark.parametrize("name", BASES)
def test_the_outline_is_the_cut_of_the_body(name):
    lens = make_lens(6.0, 10.2, 0.01, 3, base=BASES[name])
    mesh = build_mesh(plan_of(lens.inner, lens.outer, lens.spec.base), 64)
    for azimuth_deg in (0.0, 38.0, 90.0, 200.0):
        outlines = body_outlines(lens, azimuth_deg)
        assert area(outlines) == pytest.approx(cut_area(mesh, azimuth_deg), rel=1e-3)
        assert len(outlines) == 1


@pytest.mark.usefixtures("cad_read_here")
def test_a_base_from_a_file_is_cut_where_it_is(tmp_path):
    import cadquery as cq

    plate = cq.Workplane("XY").center(1.0, 0.0).rect(30.0, 24.0).extrude(-3.0)
    plate = plate.cut(cq.Workplane("XY").circle(7.0).extrude(-3.0))
    cq.exporters.export(plate, str(tmp_path / "clamp.step"))
    lens = make_lens(6.0, 10.2, 0.01, 3, base={"kind": "step", "file": str(tmp_path / "clamp.step")})
    plan = plan_of(lens.inner, lens.outer, lens.spec.base)
    mesh = join_mesh(build_mesh(plan, 64), read_custom_base(tmp_path / "clamp.step"), 1e-3)
    outlines = body_outlines(lens, 0.0)
    assert area(outlines) == pytest.approx(cut_area(mesh, 0.0), rel=1e-3)
    ends = np.concatenate(outlines)[:, 0]
    assert (ends.min(), ends.max()) == pytest.approx((-14.0, 16.0), abs=1e-9)
