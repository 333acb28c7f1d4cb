"""Bodies whose cavity and envelope have several faces: closed forms of spheres that meet, files as read back."""

import numpy as np
import pytest
from jaxtyping import Float
from known_shapes import OfRadius, sphere
from nightly import first_by_day
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from lensforge.cad.body_export import BodyProof, BuiltBody, build_body, prove
from lensforge.cad.boundary import Boundary, Crease, boundaries, of_shapes
from lensforge.cad.form_error import chart_samples, fit_to_form
from lensforge.cad.mesh import build_mesh, check_closed, mesh_error
from lensforge.cad.plan import rim_points
from lensforge.cad.plate_export import copies_off_mm, volume_of_mm3
from lensforge.cad.plate_layout import PlateLayout
from lensforge.cad.plate_mesh import build_plate_mesh, lens_meshes
from lensforge.cad.plate_solid import build_plate_solid
from lensforge.cad.section import profile
from lensforge.cad.step import parse_step, step_bytes
from lensforge.cad.wall import thickest, thinnest
from lensforge.errors import InputError
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.scene.body import Body, Face
from lensforge.spec import BaseSection
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.plate_section import PlateSection
from lensforge.surfaces.step_file import parts_of
from lensforge.surfaces.surface import Surface, to_sphere

Centre = tuple[float, float, float]
NONE = BaseSection(kind="none")


def body(cavity: dict[str, Surface], envelope: dict[str, Surface]) -> Body:
    return Body(
        tuple(Face(name, surface, CAVITY, BODY) for name, surface in cavity.items())
        + tuple(Face(name, surface, BODY, OUTSIDE) for name, surface in envelope.items())
    )


ROUND = body({"cavity": sphere(2.0)}, {"exit": sphere(6.0, (0.0, 0.0, -2.0)), "wall": sphere(5.0, (0.0, 0.0, 0.5))})
FREE = body(
    {"cap": sphere(3.0, (0.1, 0.0, -0.6)), "side": sphere(2.5, (0.0, 0.05, 0.3))},
    {"wall": sphere(5.2, (0.2, 0.1, 0.3)), "exit": sphere(6.0, (0.0, 0.0, -1.0))},
)


def volume_by_radii(faces: tuple[Face, Face]) -> float:
    """Integral of ``rho^3/3`` of the nearer face over the hemisphere, with a root sought on each meridian."""
    node, weight = np.polynomial.legendre.leggauss(40)
    total = 0.0
    count = 60
    for azimuth in 2.0 * np.pi / count * np.arange(count):

        def radii(polar: Float[np.ndarray, " n"], azimuth: float = azimuth) -> Float[np.ndarray, "f n"]:
            across = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            u = np.sin(polar)[:, None] * across + np.cos(polar)[:, None] * np.array([0.0, 0.0, 1.0])
            return np.stack([face.surface.radius(u) for face in faces])

        crease = brentq(lambda polar: np.subtract(*radii(np.array([polar])))[0], 0.0, 0.5 * np.pi, xtol=1e-14)
        for low, high in ((0.0, crease), (crease, 0.5 * np.pi)):
            polar = low + 0.5 * (high - low) * (node + 1.0)
            total += 0.5 * (high - low) * weight @ (radii(polar).min(axis=0) ** 3 * np.sin(polar)) / 3.0
    return total * 2.0 * np.pi / count


def points_of(crease: Crease, shape: Surface) -> Float[np.ndarray, "n 3"]:
    u = to_sphere(crease.chart(np.linspace(0.0, 2.0 * np.pi, 257)))
    return shape.radius(u)[:, None] * u


def shared_edges(built: BuiltBody, first: str, second: str) -> list:
    """Edges of the solid, as those of cadquery, that belong to both faces."""
    import cadquery as cq

    first, second = (parts_of(built.solid.faces[f"OPTICAL_{name.upper()}"], "EDGE") for name in (first, second))
    return [cq.Edge(edge) for edge in first if any(edge.IsSame(other) for other in second)]


@pytest.fixture(scope="module")
def round_body() -> BuiltBody:
    return build_body(ROUND)


@pytest.fixture(scope="module")
def free_body() -> BuiltBody:
    return build_body(FREE)


@pytest.fixture(scope="module")
def proof(free_body: BuiltBody) -> BodyProof:
    return prove(free_body, *free_body.files("four faces"))


def test_bodies_of_four_faces_are_joined_by_a_plate(free_body: BuiltBody) -> None:
    plate = PlateSection(thickness_mm=1.5, kind="round", diameter_mm=30.0)
    layout = PlateLayout(plate, (30.0, 30.0), Lamps.level(((-7.0, 0.0), (7.0, 1.0)), (20.0, 250.0)))
    read = parse_step(step_bytes(build_plate_solid([free_body.plan], layout), "two bodies"))
    assert read.valid and copies_off_mm(read.faces, [free_body.plan], layout) < 1e-9
    opening = rim_points(free_body.plan.cavity)
    around = float(np.pi * np.mean(np.sum(opening**2, axis=1)))
    scale = layout.bore_scale(opening)
    bore = 1.5 * around * (1.0 + scale + scale**2) / 3.0
    foot = 15.0 - 1.5 * np.tan(np.radians(plate.draft_deg))
    expected = 2.0 * (free_body.solid.volume_mm3 - bore) + 0.5 * np.pi * (15.0**2 + 15.0 * foot + foot**2)
    assert read.volume_mm3 == pytest.approx(expected, rel=1e-8)
    assert volume_of_mm3(read.faces, layout, [free_body.solid.volume_mm3]) == pytest.approx(expected, rel=1e-8)
    mesh = build_plate_mesh([free_body.plan], layout, *lens_meshes((free_body.plan,), (0, 0)))
    closure = check_closed(mesh.vertices, mesh.triangles)
    assert closure.watertight and closure.volume_mm3 == pytest.approx(expected, rel=1e-3)


def test_two_spheres_meet_in_their_circle_and_have_its_volume(round_body: BuiltBody) -> None:
    """Centres at -2 and 0.5: ``36 - (z + 2)^2 = 25 - (z - 0.5)^2`` at z = 1.45."""
    height = 1.45
    radius = np.sqrt(36.0 - (height + 2.0) ** 2)
    (crease,) = round_body.plan.envelope.creases
    points = points_of(crease, round_body.surfaces["exit"])
    np.testing.assert_allclose(points[:, 2], height, atol=1e-6)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), radius, atol=1e-6)
    edges = shared_edges(round_body, "exit", "wall")
    assert sum(edge.Length() for edge in edges) == pytest.approx(2.0 * np.pi * radius, abs=1e-6)
    for edge in edges:
        assert [edge.Center().z, edge.positionAt(0.37).z] == pytest.approx([height, height], abs=1e-6)

    def slice_mm3(radius_mm: float, centre: float, low: float, high: float) -> float:
        return np.pi * (radius_mm**2 * (high - low) - ((high - centre) ** 3 - (low - centre) ** 3) / 3.0)

    volume = slice_mm3(5.0, 0.5, 0.0, height) + slice_mm3(6.0, -2.0, height, 4.0) - 2.0 * np.pi * 8.0 / 3.0
    assert round_body.solid.valid
    assert round_body.solid.volume_mm3 == pytest.approx(volume, rel=1e-8)
    assert round_body.solid.default_volume_mm3 == pytest.approx(volume, rel=1e-6), "as other programs integrate"


def test_shifted_spheres_meet_in_a_tilted_circle(free_body: BuiltBody) -> None:
    for boundary in (free_body.plan.cavity, free_body.plan.envelope):
        (crease,) = boundary.creases
        low, high = crease.extent
        assert high - low > 0.05, "the angle of the crease depends on the azimuth"
        one, other = (free_body.surfaces[face.name] for face in boundary.faces)
        points = points_of(crease, crease.one)
        for ball in (one, other):
            assert np.abs(np.linalg.norm(points - np.array(ball.centre), axis=1) - ball.axes[0]).max() < 1e-6
        for edge in shared_edges(free_body, *(face.name for face in boundary.faces)):
            place = np.array(edge.positionAt(0.41).toTuple())
            for ball in (one, other):
                assert np.linalg.norm(place - np.array(ball.centre)) == pytest.approx(ball.axes[0], abs=1e-6)


def test_faces_follow_one_another_from_the_axis_whatever_their_order(free_body: BuiltBody) -> None:
    assert [face.name for face in free_body.plan.faces] == ["exit", "wall", "cap", "side"]


def test_four_faces_are_read_back_as_one_solid_to_a_nanometre(free_body: BuiltBody, proof: BodyProof) -> None:
    volume = volume_by_radii(FREE.envelope) - volume_by_radii(FREE.cavity)
    solid = proof.solid
    assert (solid.valid, solid.faults, solid.genus) == (True, [], 0)
    assert set(solid.faces) == {"OPTICAL_CAP", "OPTICAL_SIDE", "OPTICAL_WALL", "OPTICAL_EXIT", "RIM"}
    assert solid.volume_mm3 == pytest.approx(volume, rel=1e-8)
    assert solid.default_volume_mm3 == pytest.approx(volume, rel=1e-6)
    assert set(proof.form) == {"cap", "side", "exit", "wall"}
    assert max(error.form_max_nm for error in proof.form.values()) <= 1.0
    assert max(error.normal_max_mrad for error in proof.form.values()) <= 0.02
    for closure in (proof.stl, proof.threemf):
        assert closure.watertight and closure.genus == 0
        assert closure.volume_mm3 == pytest.approx(volume, rel=2e-4)
    assert mesh_error(free_body.mesh, free_body.plan) <= 1e-3


def test_every_edge_of_the_file_belongs_to_two_faces(proof: BodyProof) -> None:
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp
    from OCP.TopTools import TopTools_IndexedDataMapOfShapeListOfShape

    owners = TopTools_IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndAncestors_s(
        proof.solid.shape, TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_FACE, owners
    )
    assert owners.Extent() > 20
    assert {owners.FindFromIndex(k).Size() for k in range(1, owners.Extent() + 1)} == {2}
    wires = {name: len(parts_of(face, "WIRE")) for name, face in proof.solid.faces.items()}
    assert wires == {"OPTICAL_CAP": 1, "OPTICAL_EXIT": 1, "OPTICAL_SIDE": 2, "OPTICAL_WALL": 2, "RIM": 2}


@pytest.mark.parametrize("rings", [3, 12])
def test_the_mesh_is_closed_along_creases_and_its_vertices_there_lie_on_both_faces(
    free_body: BuiltBody, rings: int
) -> None:
    for mesh in (build_mesh(free_body.plan, rings), build_mesh(free_body.plan, rings, 0.01)):
        assert check_closed(mesh.vertices, mesh.triangles).watertight
        for boundary in (free_body.plan.cavity, free_body.plan.envelope):
            one, other = boundary.faces
            shared = np.intersect1d(mesh.part(one.label), mesh.part(other.label))
            assert len(shared) >= 6
            radius = np.linalg.norm(mesh.vertices[shared], axis=1)
            for face in (one, other):
                assert np.abs(face.shape.radius(mesh.vertices[shared] / radius[:, None]) - radius).max() < 1e-11
            for face in (one, other):
                vertices = mesh.vertices[np.unique(mesh.part(face.label))]
                length = np.linalg.norm(vertices, axis=1)
                assert (length <= boundary.radius(vertices / length[:, None]) + 1e-11).all()
    assert mesh_error(mesh, free_body.plan) <= 0.01


@pytest.mark.parametrize(
    "base",
    first_by_day(
        1,
        [BaseSection(diameter_mm=10.6, height_mm=1.0), BaseSection(diameter_mm=14.0, relief_step_mm=0.5)],
        "two seconds each",
    ),
    ids=["crossing", "step"],
)
def test_a_body_of_four_faces_has_the_base_of_any_lens(base: BaseSection) -> None:
    built = build_body(FREE, base, rings=24)
    assert (built.solid.valid, built.solid.genus) == (True, 0)
    assert {"BASE_BOTTOM", "OPTICAL_WALL", "OPTICAL_SIDE"} < set(built.solid.faces)
    closure = check_closed(built.mesh.vertices, built.mesh.triangles)
    assert closure.watertight
    assert closure.volume_mm3 == pytest.approx(built.solid.volume_mm3, rel=1e-2)


def test_a_face_is_sampled_and_fitted_where_it_bounds_the_body() -> None:
    cavity, envelope = boundaries(FREE)
    for boundary in (cavity, envelope):
        for number, face in enumerate(boundary.faces):
            chart = chart_samples(1024, domain=face.domain)
            inside = chart[:1024]
            assert (boundary.numbers(inside) == number).all()
            fitted = fit_to_form(face.shape, domain=face.domain)
            assert np.abs(fitted.radius(to_sphere(chart)) - face.shape.radius(to_sphere(chart))).max() < 1e-6
    assert fit_to_form(cavity.faces[0].shape, 80, cavity.faces[0].domain).knots[-1] < 0.7, "no farther than it reaches"


def test_walls_are_measured_between_the_faces_where_they_bound_the_body(free_body: BuiltBody) -> None:
    plan = free_body.plan

    def points(boundary: Boundary, count: int = 2**15) -> Float[np.ndarray, "n 3"]:
        u = to_sphere(chart_samples(count))
        return boundary.radius(u)[:, None] * u

    near = points(plan.cavity)
    far = points(plan.envelope)
    wall = thinnest(plan.cavity, plan.envelope)
    shortest = cKDTree(far).query(points(plan.cavity, 2**11))[0].min()
    assert shortest - 5e-3 < wall.thickness_mm <= shortest
    longest = (np.linalg.norm(far, axis=1) - np.linalg.norm(near, axis=1)).max()
    assert longest <= thickest(plan.cavity, plan.envelope).thickness_mm < longest + 1e-3


def test_the_wall_at_a_corner_of_the_cavity_is_on_the_crease() -> None:
    """Both balls of the cavity come nearer to the envelope towards the circle in which they meet, and beyond it."""
    cap = sphere(4.5, (0.2, 0.0, -2.0))
    side = sphere(2.6, (0.0, 0.0, 0.8))
    radius = 5.0
    pair = boundaries(body({"cap": cap, "side": side}, {"wall": sphere(radius)}))
    fits = {face.name: fit_to_form(face.shape, domain=face.domain) for boundary in pair for face in boundary.faces}
    between = np.array(side.centre) - np.array(cap.centre)
    away = np.linalg.norm(between)
    along = (away**2 + cap.axes[0] ** 2 - side.axes[0] ** 2) / (2.0 * away)
    middle = np.array(cap.centre) + along * between / away
    axis = between / away
    off_axis = np.linalg.norm(middle - (middle @ axis) * axis)
    farthest = np.hypot(middle @ axis, np.sqrt(cap.axes[0] ** 2 - along**2) + off_axis)
    assert thinnest(*of_shapes(pair, fits)).thickness_mm == pytest.approx(radius - farthest, abs=1e-5)


def test_the_wall_at_a_cap_is_on_the_axis(round_body: BuiltBody) -> None:
    wall = thinnest(round_body.plan.cavity, round_body.plan.envelope)
    assert wall.thickness_mm == pytest.approx(2.0, abs=1e-6)
    assert wall.envelope_mm == pytest.approx((0.0, 0.0, 4.0), abs=1e-3)


def test_the_section_has_its_corner_at_the_crease() -> None:
    _, envelope = boundaries(ROUND)
    curve = profile(envelope, np.array([0.6, 0.8, 0.0]), count=31)
    corners = np.hypot(curve[:, 0], curve[:, 1] - 1.45) - np.sqrt(36.0 - 3.45**2)
    assert len(curve) == 33
    assert np.sort(np.abs(corners))[1] < 1e-9


# Nearer than 5 mm between 22.5 and 67.5 degrees from the axis.
WAVE = OfRadius(lambda u: 5.0 + 0.2 * np.cos(4.0 * np.arccos(np.clip(u[:, 2], -1.0, 1.0))))


@pytest.mark.parametrize(
    ("envelope", "line"),
    [
        ({"exit": sphere(5.0), "wall": WAVE}, r"^exit: cut into 2 pieces seen from the origin, by wall"),
        (
            {"exit": sphere(5.0), "wall": sphere(5.2, (0.5, 0.0, 0.0))},
            r"^faces exit, wall: from the axis to the rim at azimuth \d+ degrees the body is bounded by (exit|wall):",
        ),
        ({"exit": sphere(5.0), "wall": sphere(6.0)}, r"^wall: nowhere the nearest"),
        (
            {"exit": sphere(5.0), "wall": sphere(5.004, (0.0, 0.0, -0.005))},
            r"^faces wall and exit: almost touch along their crease; let them meet at 1 degree or more$",
        ),
        ({}, r"^faces cavity: none bounds the body; the body is not closed, add one$"),
        ({"exit": sphere(3.0, (0.0, 0.0, -1.5)), "wall": sphere(5.0)}, r"^wall = -0\.\d+ mm in the direction"),
    ],
    ids=["twice", "not around", "hidden", "grazing", "open", "crossing the cavity"],
)
def test_other_arrangements_are_one_line(envelope: dict[str, Surface], line: str) -> None:
    with pytest.raises(InputError, match=line) as caught:
        build_body(body({"cavity": sphere(2.0)}, envelope))
    assert "\n" not in str(caught.value)


def test_a_domain_holds_the_places_that_it_does_not_move():
    """Of crooked faces, on both sides of every crease and as near as a tenth of a micrometre; also on its own edge."""
    places = np.random.default_rng(8).uniform(-1.0, 1.0, (4000, 2))
    turns = np.linspace(0.0, 6.0, 400)
    for boundary in boundaries(FREE):
        near = [(1.0 + step) * crease.chart(turns) for crease in boundary.creases for step in (-1e-7, 1e-7)]
        tried = np.concatenate([places, *near])
        for face in boundary.faces:
            held = face.domain.holds(tried)
            stays = np.abs(face.domain.within(tried) - tried).max(axis=1) < 1e-9
            np.testing.assert_array_equal(held, stays)
            assert held.any() and not held.all()
