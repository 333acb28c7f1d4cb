import re

import numpy as np
import pytest
from geometry_lenses import ALL_LEVELS, exact_volume, make_lens, plan_of, random_surface
from nightly import first_by_day
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve

from lensforge.cad.solid import build_solid
from lensforge.cad.step import parse_step, step_bytes
from lensforge.errors import InputError
from lensforge.spec import BaseSection
from lensforge.surfaces.step_file import parts_of

NONE = BaseSection(kind="none")
OPTICAL = {"OPTICAL_INNER", "OPTICAL_OUTER"}
BASE = {"BASE_SIDE", "BASE_BOTTOM", "BASE_BORE"}


def solid_of(inner, outer, base, nodes=None):
    return build_solid(plan_of(inner, outer, base, nodes))


@pytest.mark.parametrize(
    ("radii", "base", "names"),
    first_by_day(
        2,
        [
            ((0.8, 2.45), NONE, OPTICAL | {"RIM"}),
            ((0.8, 2.45), BaseSection(), OPTICAL | BASE | {"BASE_TOP"}),
            ((6.0, 13.7), BaseSection(), OPTICAL | BASE | {"RIM"}),
            ((6.0, 12.7), BaseSection(), OPTICAL | BASE),
        ],
        "more bases",
    ),
    ids=["no base", "ledge", "overhang", "flush"],
)
def test_a_shell_has_its_faces_and_the_volume_of_its_closed_form(radii, base, names):
    solid = solid_of(*(random_surface(radius, 0.0, seed=0) for radius in radii), base)
    volume = 2.0 * np.pi * (radii[1] ** 3 - radii[0] ** 3) / 3.0
    volume += base.height_mm * np.pi * (12.7**2 - radii[0] ** 2) if base.kind == "cylinder" else 0.0
    assert {re.sub(r"_\d+$", "", name) for name in solid.faces} == names  # walls below a rim have several faces
    assert solid.valid
    assert solid.volume_mm3 == pytest.approx(volume, rel=2e-9)


@pytest.mark.parametrize("seed", first_by_day(1, range(4)))
def test_a_rim_that_crosses_the_cylinder_gives_a_valid_solid_of_the_right_volume(seed):
    inner = random_surface(6.0, 0.02, seed)
    outer = random_surface(12.7, 0.02, seed + 50)
    solid = solid_of(inner, outer, BaseSection())
    assert solid.valid
    assert sum(name.startswith("OPTICAL") for name in solid.faces) == 2
    assert solid.volume_mm3 == pytest.approx(exact_volume(inner, outer, BaseSection()), rel=2e-9)
    again = parse_step(step_bytes(solid, "crossing"))
    assert again.valid
    assert again.volume_mm3 == pytest.approx(solid.volume_mm3, rel=1e-9)
    assert set(again.faces) == set(solid.faces)


@pytest.mark.parametrize(("relative", "nodes"), first_by_day(2, [(1e-6, None), (0.02, 50), (1e-3, None)]))
def test_shallow_crossings_and_coarse_patches_are_valid_too(relative, nodes):
    outer = random_surface(12.7, relative, 51, levels=(9, 25, 81))
    solid = solid_of(random_surface(6.0, 0.0, 0), outer, BaseSection(), nodes)
    assert "BASE_SIDE_2" in solid.faces
    assert solid.valid
    assert parse_step(step_bytes(solid, "shallow")).valid


@pytest.fixture(scope="module")
def written():
    lens = make_lens(0.8, 2.45, 0.01)
    solid = solid_of(lens.inner, lens.outer, BaseSection())
    return solid, step_bytes(solid, "small_lens")


def test_step_says_millimetres_ap214_and_the_names(written):
    text = written[1].decode()
    assert "FILE_SCHEMA(('AUTOMOTIVE_DESIGN" in text
    assert "LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.)" in text
    assert "PRODUCT('small_lens','small_lens'" in text
    assert text.count("PRODUCT(") == 1
    assert text.count("MANIFOLD_SOLID_BREP(") == 1
    for name in (OPTICAL | BASE | {"BASE_TOP", "BASE_BORE_1"}) - {"BASE_BORE"}:
        assert text.count(f"ADVANCED_FACE('{name}'") == 1


def test_optical_faces_are_single_patches_trimmed_by_a_circle(written):
    text = written[1].decode().replace("\n", "")
    assert text.count("B_SPLINE_SURFACE_WITH_KNOTS('',7,7") == 2
    assert text.count("CIRCLE('',") >= 2  # the two trims in parameter space, and the base's own circles
    for name in OPTICAL:
        assert len(parts_of(parse_step(written[1]).faces[name], "WIRE")) == 1


@pytest.mark.parametrize(
    "base",
    first_by_day(1, [BaseSection(), BaseSection(flat_mm=11.0, height_mm=3.0)], "two seconds each"),
    ids=["round", "flat"],
)
def test_other_cad_programs_find_the_volume_the_centroid_and_the_box(base):
    """By the kernel's default integration, without a tolerance, and by its box of control points: as they do."""
    from cadquery import Solid
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    inner = random_surface(6.0, 0.08, 3, (9, 25, 81))
    outer = random_surface(11.0, 0.05, 4, (9, 25, 81))
    part = parse_step(step_bytes(solid_of(inner, outer, base), "read elsewhere"))
    default = GProp_GProps()
    exact = GProp_GProps()
    BRepGProp.VolumeProperties_s(part.shape, default)
    BRepGProp.VolumeProperties_s(part.shape, exact, 1e-8)
    assert default.Mass() == pytest.approx(exact.Mass(), rel=1e-6)
    assert default.CentreOfMass().Distance(exact.CentreOfMass()) < 1e-5
    assert Solid(part.shape).BoundingBox().zmin == pytest.approx(-base.height_mm, abs=1e-3)


@pytest.mark.usefixtures("cad_read_here")
@pytest.mark.parametrize("content", [b"", b"ISO-10303-21;", b"\x00\xff" * 50], ids=["empty", "header", "noise"])
def test_a_damaged_step_is_one_line(content):
    with pytest.raises(InputError, match=r"^part\.step: (not readable as STEP|holds 0 solids)") as caught:
        parse_step(content, "part.step")
    assert "\n" not in str(caught.value)


def test_a_coarse_spline_is_trimmed_where_it_crosses_the_plane_and_keeps_its_volume_in_a_file() -> None:
    """Its rim lies beside the unit circle by its form error; a trim there is made anew by who reads it."""
    inner, outer = (random_surface(radius, 0.05, seed, levels=(9, 25, 81)) for radius, seed in ((6.0, 5), (13.0, 6)))
    solid = build_solid(plan_of(inner, outer, nodes=24))
    read = parse_step(step_bytes(solid, "coarse"))
    assert read.valid and read.default_volume_mm3 == pytest.approx(solid.default_volume_mm3, rel=1e-8)


def gaps_mm(face, edge):
    """Largest distance (mm) of an edge's curve from its place on a face, at places between its nodes, too."""
    curve = BRepAdaptor_Curve(edge)
    on_face = BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 0.0)
    surface = BRep_Tool.Surface_s(face)
    apart = []
    for at in np.linspace(curve.FirstParameter(), curve.LastParameter(), 4001).tolist():
        place = on_face.Value(at)
        apart.append(surface.Value(place.X(), place.Y()).Distance(curve.Value(at)))
    return max(apart)


def test_no_edge_of_few_nodes_is_farther_from_its_face_than_its_tolerance():
    """A rough rim crosses a square base: of its arcs the one with the largest gap is neither the first nor the last."""
    inner = random_surface(3.0, 0.01, 3)
    outer = random_surface(6.0, 0.1, 9, levels=ALL_LEVELS)
    face = solid_of(inner, outer, BaseSection(kind="square", side_mm=11.0), nodes=30).faces["OPTICAL_OUTER"]
    edges = parts_of(face, "EDGE")
    gaps = [gaps_mm(face, edge) for edge in edges]
    assert len(edges) > 4 and max(gaps) > 1e-6, "above the least tolerance that there is"
    for gap, edge in zip(gaps, edges, strict=True):
        assert BRep_Tool.Tolerance_s(edge) >= gap
