"""Sizes of files against closed forms: what a rewrite changes is allowed, what a shop would see is not."""

import cadquery as cq
import numpy as np
import pytest
import trimesh
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
from OCP.BRepLib import BRepLib
from OCP.Geom2d import Geom2d_Circle
from OCP.gp import gp_Ax2d, gp_Dir2d, gp_Pnt2d
from scipy.interpolate import make_interp_spline

from lensforge.cad.edges import geom_surface
from lensforge.cad.patch import Patch
from lensforge.proof.acceptance import size_criteria
from lensforge.proof.cast_results import SizedFile, Sizes
from lensforge.proof.part_mesh import sized_mesh
from lensforge.proof.step_body import StepBody, bounds_mm
from lensforge.results import BodySize

RADIUS = 13.0
BASE = 16.0
HEIGHT = 2.0


def dome(height=HEIGHT, radius=RADIUS, scale=1.0):
    """A dome on a cylindrical base, by the kernel's booleans."""
    below = cq.Workplane().box(100.0, 100.0, 50.0).translate((0.0, 0.0, -25.0))
    body = cq.Workplane().sphere(radius).cut(below).union(cq.Workplane().circle(BASE).extrude(-height))
    return cq.Workplane(body.val().scale(scale))


def exact(height=HEIGHT, radius=RADIUS):
    volume = 2.0 / 3.0 * np.pi * radius**3 + np.pi * BASE**2 * height
    area = 2.0 * np.pi * radius**2 + np.pi * (BASE**2 - radius**2) + 2.0 * np.pi * BASE * height + np.pi * BASE**2
    return BodySize(volume_mm3=volume, area_mm2=area, bounds_mm=((-BASE, -BASE, -height), (BASE, BASE, radius)))


def step_of(shape, path):
    cq.exporters.export(shape, str(path))
    return StepBody(path.read_bytes()).size()


def mesh_of(shape, path, tolerance=0.001):
    cq.exporters.export(shape, str(path), tolerance=tolerance, angularTolerance=0.1)
    return trimesh.load(path)


def failed(mesh=None, step=None):
    mesh = SizedFile(size=exact()) if mesh is None else sized_mesh(mesh)
    sizes = Sizes(exported=exact(), chord_mm=0.001, mesh=mesh, step=None if step is None else SizedFile(size=step))
    return {criterion.key: criterion.remedy for criterion in size_criteria(sizes) if not criterion.holds}


def test_the_size_of_a_step_is_that_of_the_closed_form(tmp_path):
    size = step_of(dome(), tmp_path / "dome.step")
    wanted = exact()
    assert size.volume_mm3 == pytest.approx(wanted.volume_mm3, rel=1e-7)
    assert size.area_mm2 == pytest.approx(wanted.area_mm2, rel=1e-7)
    np.testing.assert_allclose(size.bounds_mm, wanted.bounds_mm, rtol=0.0, atol=1e-5)


def wavy(x, y):
    """Height of a crown off the middle, with bumps an eighth wide."""
    return 3.0 - 0.2 * (x - 0.4) ** 2 - 0.3 * (y + 0.1) ** 2 + 0.1 * np.cos(51.0 * x + 2.1) * np.cos(49.0 * y - 0.9)


@pytest.mark.nightly("three seconds")
def test_the_top_of_a_wavy_face_is_that_of_its_highest_bump():
    middle = (0.15, -0.2)
    radius = 0.7
    along = np.linspace(-1.02, 1.02, 180)
    x, y = np.meshgrid(along, along, indexing="ij")
    lines = make_interp_spline(along, np.stack([x, y, wavy(x, y)], axis=-1), k=5)
    columns = make_interp_spline(along, lines.c.transpose(1, 0, 2), k=5)
    surface = geom_surface(Patch(np.ascontiguousarray(columns.c.transpose(1, 0, 2)), lines.t))
    rim = Geom2d_Circle(gp_Ax2d(gp_Pnt2d(*middle), gp_Dir2d(1.0, 0.0)), radius)
    edge = BRepBuilderAPI_MakeEdge(rim, surface).Edge()
    BRepLib.BuildCurves3d_s(edge)
    face = BRepBuilderAPI_MakeFace(surface, BRepBuilderAPI_MakeWire(edge).Wire(), True).Face()
    reach = radius * np.linspace(0.0, 1.0, 1500)[:, None]
    azimuths = np.linspace(0.0, 2.0 * np.pi, 3001)
    heights = wavy(middle[0] + reach * np.cos(azimuths), middle[1] + reach * np.sin(azimuths))
    low, high = bounds_mm(face, [face])
    np.testing.assert_allclose([*low, *high], [-0.55, -0.9, heights.min(), 0.85, 0.5, heights.max()], rtol=0, atol=2e-4)


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_facets_of_a_sphere_change_no_more_than_their_angles_say(rows):
    mesh = trimesh.creation.icosphere(subdivisions=rows, radius=10.0).apply_translation([0.0, 0.0, 20.0])
    bounds = sized_mesh(mesh)
    volume = 4.0 / 3.0 * np.pi * 1e3 - mesh.volume
    area = 400.0 * np.pi - mesh.area
    assert volume <= bounds.facets_mm3 <= 3.0 * volume
    assert area <= bounds.facets_mm2 <= 4.0 * area


@pytest.mark.parametrize("sections", [48, 400])
def test_facets_of_a_cylinder_change_no_more_than_their_angles_say(sections):
    mesh = trimesh.creation.cylinder(10.0, 5.0, sections=sections).apply_translation([0.0, 0.0, -20.0])
    bounds = sized_mesh(mesh)
    assert 500.0 * np.pi - mesh.volume <= bounds.facets_mm3
    assert 300.0 * np.pi - mesh.area <= bounds.facets_mm2
    chord = 10.0 * (1.0 - np.cos(np.pi / sections))
    assert chord <= bounds.chord_mm <= 3.0 * chord


@pytest.mark.parametrize("tolerance", [0.1, 0.01, 0.001])
def test_the_same_body_by_other_facets_and_other_faces_passes(tmp_path, tolerance):
    assert failed(mesh_of(dome(), tmp_path / "dome.stl", tolerance), step_of(dome(), tmp_path / "dome.step")) == {}


@pytest.mark.parametrize(
    ("wrong", "says"),
    [({"height": 3.0}, "least z -3 mm, exported -2"), ({"height": 2.1}, "least z -2.1 mm, exported -2")],
)
def test_another_body_misses_and_says_where(tmp_path, wrong, says):
    messages = failed(mesh_of(dome(**wrong), tmp_path / "dome.stl"), step_of(dome(**wrong), tmp_path / "dome.step"))
    assert {"volume_change", "brep_volume_change", "brep_box_change"} <= set(messages)
    assert says in messages["brep_box_change"] and "lens.step is another body" in messages["brep_box_change"]
    assert says in messages["volume_change"] and "lens.stl is another body" in messages["volume_change"]


def test_a_scaled_body_is_named_even_where_light_does_not_tell(tmp_path):
    messages = failed(step=step_of(dome(scale=1.001), tmp_path / "dome.step"))
    assert set(messages) == {"brep_volume_change", "brep_area_change", "brep_box_change"}
    assert messages["brep_volume_change"].startswith("lens.step: it is the lens scaled by 1.001: write it again")


@pytest.mark.parametrize(
    ("scale", "says"),
    [(1.0 / 25.4, "in inches"), (25.4, "as if its mm were inches"), (0.1, "in cm"), (1e-3, "in metres")],
)
def test_another_unit_is_named(tmp_path, scale, says):
    mesh = mesh_of(dome(), tmp_path / "dome.stl")
    assert says in failed(mesh.apply_scale(scale))["volume_change"]
