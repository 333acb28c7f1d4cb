import numpy as np
import pytest
from geometry_lenses import exact_volume, plan_of, random_surface
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import first_by_day, scaled

from lensforge.cad.facets import Facets
from lensforge.cad.mesh import build_mesh, check_closed, mesh_error, rings_for
from lensforge.cad.patch import fit_patch
from lensforge.cad.plan import BORE, BOTTOM, INNER, OUTER, RIM, SIDE, TOP, make_plan, rim_directions
from lensforge.errors import InputError
from lensforge.spec import BaseSection
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import to_chart

NONE = BaseSection(kind="none")


def edges_pair_up(triangles):
    """Every directed edge once, and its reverse once: closed, oriented, two-sided; no library asked."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    keys = edges[:, 0] * 2**32 + edges[:, 1]
    back = edges[:, 1] * 2**32 + edges[:, 0]
    return len(np.unique(keys)) == len(keys) and np.array_equal(np.sort(keys), np.sort(back))


def as_stl(mesh):
    """Vertices in single precision, equal ones merged: what a reader of the STL sees."""
    vertices, index = np.unique(mesh.vertices.astype(np.float32), axis=0, return_inverse=True)
    return vertices.astype(float), index.reshape(-1)[mesh.triangles]


def part_area_vector(mesh, name):
    a, b, c = np.moveaxis(mesh.vertices[mesh.part(name)], 1, 0)
    return np.cross(b - a, c - a).sum(axis=0) / 2.0


@pytest.mark.parametrize("base", [NONE, BaseSection()], ids=["no base", "cylinder"])
@pytest.mark.parametrize("radii", [(0.8, 2.45), (6.0, 12.7), (6.0, 13.7)])
def test_volume_of_a_shell_converges_to_its_closed_form_with_order_two(radii, base):
    inner, outer = (random_surface(radius, 0.0, seed=0) for radius in radii)
    volume = 2.0 * np.pi * (radii[1] ** 3 - radii[0] ** 3) / 3.0
    volume += base.height_mm * np.pi * (12.7**2 - radii[0] ** 2) if base.kind == "cylinder" else 0.0
    plan = plan_of(inner, outer, base)
    coarse, fine = (build_mesh(plan, rings).volume() / volume - 1.0 for rings in (24, 48))
    assert -2e-3 < fine < 0.0
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_volume_of_a_crossing_freeform_matches_the_integral(seed):
    inner = random_surface(6.0, 0.02, seed)
    outer = random_surface(12.7, 0.02, seed + 50)
    plan = plan_of(inner, outer, BaseSection())
    coarse, fine = (build_mesh(plan, rings).volume() for rings in (32, 64))
    extrapolated = (4.0 * fine - coarse) / 3.0
    assert extrapolated == pytest.approx(exact_volume(inner, outer, BaseSection()), rel=2e-6)


@settings(max_examples=min(scaled(40, by_day=12), 1000), deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000), relative=st.floats(0.0, 0.03), excess=st.floats(-0.05, 0.05), rings=st.integers(3, 24)
)
def test_every_body_is_closed_however_the_rim_crosses_the_cylinder(seed, relative, excess, rings):
    inner = random_surface(1.0, relative, seed)
    outer = random_surface(2.45, relative, seed + 1)
    radius = 2.45 * (1.0 + excess * relative / 0.03)
    for base in (NONE, BaseSection(diameter_mm=2.0 * radius)):
        mesh = build_mesh(plan_of(inner, outer, base), rings)
        assert check_closed(mesh.vertices, mesh.triangles).volume_mm3 == pytest.approx(mesh.volume(), rel=1e-9)
        for vertices, triangles in ((mesh.vertices, mesh.triangles), as_stl(mesh)):
            closure = check_closed(vertices, triangles)
            assert edges_pair_up(triangles)
            assert closure.watertight
            assert closure.genus == 0


@pytest.mark.parametrize("offset", [0.0, 1e-9, 1e-6, 1e-5, 1e-4, -1e-5, -1e-9])
def test_a_rim_that_almost_touches_the_cylinder_is_still_closed(offset):
    plan = plan_of(random_surface(6.0, 0.0, seed=0), random_surface(12.7 + offset, 1e-7, seed=4), BaseSection())
    mesh = build_mesh(plan, 40)
    for vertices, triangles in ((mesh.vertices, mesh.triangles), as_stl(mesh)):
        assert (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all()
        assert edges_pair_up(triangles)
        assert check_closed(vertices, triangles).watertight


def test_names_lie_where_they_should_and_face_outwards():
    plan = plan_of(random_surface(6.0, 0.02, 1), random_surface(12.7, 0.02, 51), BaseSection())
    mesh = build_mesh(plan, 48)
    assert set(mesh.names) == {OUTER, INNER, RIM, TOP, SIDE, BOTTOM, BORE}
    height = {name: mesh.vertices[np.unique(mesh.part(name)), 2] for name in mesh.names}
    for name in (TOP, RIM):
        assert (height[name] == 0.0).all()
    assert (height[BOTTOM] == -2.0).all()
    signs = {OUTER: 1, INNER: -1, RIM: -1, TOP: 1, BOTTOM: -1}
    assert {name: np.sign(part_area_vector(mesh, name)[2]) for name in signs} == signs
    for name, sign in {SIDE: 1, BORE: -1}.items():
        corners = mesh.vertices[mesh.part(name)]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (sign * np.sum(normal * corners.mean(axis=1), axis=1) > 0.0).all()


def test_ledge_and_overhang_have_the_areas_between_rim_and_circle():
    plan = plan_of(random_surface(6.0, 0.0, 1), random_surface(12.7, 0.02, 51), BaseSection())
    mesh = build_mesh(plan, 100)
    azimuths = np.linspace(0.0, 2.0 * np.pi, 4096, endpoint=False)
    excess = (plan.envelope.radius(rim_directions(azimuths)) ** 2 - 12.7**2) * np.pi
    for name, area in ((TOP, -np.minimum(excess, 0.0).mean()), (RIM, -np.maximum(excess, 0.0).mean())):
        assert part_area_vector(mesh, name)[2] == pytest.approx(area, rel=2e-3)


def densely_measured(plan, mesh):
    """Distance at 45 points of every facet of the optical faces; no search."""
    distance = 0.0
    for face in plan.faces:
        patch = face.shape
        corners = mesh.vertices[mesh.part(face.label)]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        for i in range(9):
            for j in range(9 - i):
                chart = to_chart(np.array([i, j, 8 - i - j]) / 8 @ corners)
                away = np.sum((patch.points(chart) - corners[:, 0]) * normals, axis=1)
                distance = max(distance, np.abs(away).max())
    return distance


def rough_plan(base=NONE):
    return plan_of(random_surface(6.0, 0.02, 1), random_surface(13.7, 0.02, 51), base)


@pytest.mark.parametrize("chord_mm", [None, 0.02])
def test_the_error_of_a_mesh_is_the_largest_anywhere_on_its_facets(chord_mm):
    plan = rough_plan()
    mesh = build_mesh(plan, 20, chord_mm)
    distance = densely_measured(plan, mesh)
    assert distance <= mesh_error(mesh, plan) < 1.02 * distance


@pytest.mark.parametrize("base", first_by_day(1, [NONE, BaseSection()], "finer meshes"), ids=["no base", "cylinder"])
@pytest.mark.parametrize("chord_mm", [0.02, 0.008])
def test_split_facets_keep_the_tolerance_and_the_body_closed(base, chord_mm):
    plan = rough_plan(base)
    mesh = build_mesh(plan, 20, chord_mm)
    equal = build_mesh(plan, 20)
    assert densely_measured(plan, mesh) <= chord_mm < mesh_error(equal, plan)
    for vertices, triangles in ((mesh.vertices, mesh.triangles), as_stl(mesh)):
        assert edges_pair_up(triangles)
        assert check_closed(vertices, triangles).watertight
    assert set(mesh.names) == set(equal.names)


def test_one_rough_place_costs_few_triangles():
    basis = SrbfBasis((9, 25, 81, 289), 1.75)
    bump = SrbfSurface(basis, np.where(np.arange(basis.size) == 250, 0.6, 0.0), 13.7)
    plan = plan_of(random_surface(6.0, 0.0, 1), bump, NONE)
    mesh = build_mesh(plan, 40, 0.004)
    equal = build_mesh(plan, 40)
    rings = 40 * np.sqrt(mesh_error(equal, plan) / 0.004)  # the distance falls as rings^-2
    assert len(mesh.triangles) < 0.5 * len(equal.triangles) * (rings / 40) ** 2


def test_splitting_keeps_vertices_on_the_faces_and_angles_from_collapsing():
    plan = rough_plan()
    mesh = build_mesh(plan, 20, 0.002)
    for face in plan.faces:
        patch = face.shape
        triangles = mesh.part(face.label)
        points = mesh.vertices[np.unique(triangles)]
        radius = np.linalg.norm(points, axis=1)
        assert np.abs(radius - patch.radius(points / radius[:, None])).max() < 1e-12
        corners = mesh.vertices[triangles]
        sides = np.roll(corners, -1, axis=1) - corners
        lengths = np.linalg.norm(sides, axis=2)
        doubled_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        assert np.degrees(np.arcsin(doubled_area / (np.sort(lengths, axis=1)[:, 1:].prod(axis=1)))).min() > 8.0


def test_a_tolerance_that_takes_too_many_triangles_is_refused(monkeypatch):
    monkeypatch.setattr("lensforge.cad.facets.MOST_TRIANGLES", 5000)
    with pytest.raises(InputError, match=r"with 5000 triangles, the most that are made; export with a number of"):
        build_mesh(rough_plan(), 20, 1e-4)


def test_rings_follow_the_detail_of_the_faces_and_the_width_of_the_base():
    plan = rough_plan()
    assert rings_for(plan, 1e-3) == 98
    fine = make_plan(fit_patch(random_surface(6.0, 0.02, 1), 200), plan.envelope, NONE)
    assert rings_for(fine, 1e-3) == 270
    finest = make_plan(fit_patch(random_surface(6.0, 0.02, 1), 320), plan.envelope, NONE)
    assert rings_for(finest, 1e-3) == 310, "1.35 a node were 432: 2.2 million triangles"
    assert rings_for(finest, 1e-3, 400) == 400, "light asks for them"
    wide = plan_of(random_surface(6.0, 0.0, 1), random_surface(13.7, 0.0, 51), BaseSection(diameter_mm=600.0))
    rings = rings_for(wide, 1e-3)
    assert rings > 128
    assert 300.0 * (1.0 - np.cos(np.pi / (6 * rings))) <= 1e-3


def test_an_edge_of_the_face_is_split_beyond_the_tolerance_alone() -> None:
    """Of two facets, the second of which has the far places: nearer ones no split of its facet would bring nearer."""
    vertices = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.1]])
    triangles = np.array([[0, 1, 2], [1, 3, 2]])  # they share the edge from 1 to 2, the last of the second

    def far(*second: float) -> list[bool]:
        return Facets(vertices, triangles, np.array([[0.0] * 4, second])).far(0.9, 1.0)[1].tolist()

    assert far(0.95, 0.0, 0.0, 0.0) == [False] * 4
    assert far(0.0, 0.95, 0.95, 0.95) == [False, False, True, True]
    assert far(0.0, 1.05, 0.0, 0.0) == [False, True, False, False]
    assert far(0.89, 0.89, 0.89, 0.89) == [False] * 4
