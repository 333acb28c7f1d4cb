import numpy as np
import pytest
import trimesh
from lens_meshes import INDEX, INNER, OUTER, lambertian, lens_mesh, oracle, right, snell, sphere

from lensforge.optics.media import Media, Medium
from lensforge.proof.facet_casting import Grid
from lensforge.proof.part_mesh import part_mesh_of
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.refraction import AtFace, RefractingFace, unpolarised
from lensforge.proof.sequential_cast import CastFate, send_through
from lensforge.sources.ray_bundle import RayBundle


def send(mesh, rays, index=INDEX, distance=150.0):
    part = part_mesh_of(mesh)
    return send_through(part, Grid(part.mesh), rays, Media(Medium(index))).landed(Screen.square(distance, 300.0, 8))


def one_ray(origin, direction):
    direction = np.array([direction], dtype=float)
    return RayBundle(np.array([origin], dtype=float), direction / np.linalg.norm(direction), np.ones(1))


@pytest.mark.parametrize("ratio", [1.0 / INDEX, INDEX])
def test_refraction_obeys_snell_and_fresnel(ratio):
    rng = np.random.default_rng(2)
    directions, normals = rng.normal(size=(2, 5000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    face = RefractingFace(np.full(5000, ratio), np.ones(5000), None, np.full(5000, 550.0), True)
    at_face = AtFace.of(face, directions, normals, unpolarised(directions))
    expected, share = snell(directions, normals, ratio)
    passes = share > 0.0
    assert (ratio < 1.0) == passes.all()
    assert np.array_equal(passes, at_face.transmittance > 0.0)
    np.testing.assert_allclose(at_face.bent[passes], expected[passes], atol=1e-9)
    np.testing.assert_allclose(at_face.transmittance, share, atol=1e-8)
    np.testing.assert_allclose(at_face.reflectance, 1.0 - share, atol=1e-8)


def test_two_ellipsoids_agree_with_their_closed_forms():
    rays = lambertian(3000, 2.0)
    landings, flux, _ = oracle(INNER, OUTER, rays, INDEX, 150.0)
    errors = []
    for count in (30, 60):
        got = send(right(count), rays)
        both = np.isfinite(landings[:, 0]) & np.isfinite(got.landings[:, 0])
        assert np.mean(np.isnan(landings[:, 0]) != np.isnan(got.landings[:, 0])) < 1e-3
        central = both & (np.abs(landings) < 150.0).all(axis=1)
        errors.append(np.linalg.norm(got.landings - landings, axis=1)[central])
        np.testing.assert_allclose(got.flux[central], flux[central], rtol=1e-5)
    assert np.sqrt(np.mean(errors[1] ** 2)) < 1e-4  # mm; 0.7 urad
    assert np.sqrt(np.mean(errors[0] ** 2) / np.mean(errors[1] ** 2)) > 2.0**2.6  # third order


@pytest.mark.parametrize(("index", "fate"), [(1.40, CastFate.LANDED), (1.42, CastFate.TOTAL_REFLECTION)])
def test_a_prism_of_45_degrees_reflects_totally_from_the_square_root_of_two_on(index, fate):
    corners = [[x, y, z] for y in (-20.0, 20.0) for x, z in ((-10.0, 5.0), (10.0, 5.0), (-10.0, 25.0))]
    got = send(trimesh.convex.convex_hull(np.array(corners)), one_ray([-2.0, 0.3, 0.0], [0.0, 0.0, 1.0]), index)
    assert got.fates[0] == fate
    once = 4.0 * index / (1.0 + index) ** 2
    _, out = snell(np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 1.0]]) / np.sqrt(2.0), index)
    assert got.flux[0] == pytest.approx(once * (out[0] if fate == CastFate.LANDED else 1.0), rel=1e-7)


@pytest.mark.parametrize(
    ("origin", "direction", "fate"),
    [
        ([0.0, 0.0, 0.0], [0.1, 0.0, 1.0], CastFate.LANDED),
        ([0.0, 0.0, -1.0], [0.2, 0.1, 1.0], CastFate.LANDED),  # from within the opening of the base
        ([0.0, 0.0, -9.0], [0.0, 0.01, 1.0], CastFate.LANDED),  # from below the part, up through the opening
        ([0.0, 0.0, -1.0], [1.0, 0.0, 0.05], CastFate.OPENING),  # into the wall of the opening
        ([9.0, 0.0, -5.0], [0.1, 0.0, 1.0], CastFate.OPENING),  # into the base from below
        ([0.0, 0.0, 0.5], [0.0, 0.2, -1.0], CastFate.NO_HIT),  # back down through the opening
        ([0.0, 0.0, 100.0], [0.0, 0.0, 1.0], CastFate.NO_HIT),
        ([9.0, 0.0, 1.0], [0.0, 0.0, 1.0], CastFate.STARTS_INSIDE),
        ([0.0, 0.0, 5.0], [1.0, 0.0, -0.05], CastFate.LANDED),  # down to the cavity's wall, which bends it up
        ([0.0, 0.0, 3.0], [1.0, 0.0, -0.2], CastFate.MISSED_RECEIVER),  # the same, but not enough
        ([0.0, 0.0, 3.0], [1.0, 0.0, -0.55], CastFate.OPENING),  # down through z = 0 to the wall of the opening
        ([0.0, 5.5, 0.3], [1.0, 0.0, -0.1], CastFate.BASE),  # through the cavity's wall, and in the body into the base
        ([40.0, 0.0, 10.0], [-1.0, 0.0, 0.0], CastFate.STARTS_OUTSIDE),  # from beside the lens
        ([0.0, 0.0, 30.0], [0.1, 0.0, -1.0], CastFate.STARTS_OUTSIDE),  # from above it, down
        ([0.0, 0.0, 12.0], [0.0, 0.0, -1.0], CastFate.STARTS_INSIDE),
    ],
)
def test_every_start_has_its_fate(origin, direction, fate):
    mesh = lens_mesh(sphere(6.0).radius, sphere(13.7).radius, 24, (16.0, 2.0))
    assert send(mesh, one_ray(origin, direction)).fates[0] == fate


def test_rays_that_start_high_and_go_down_agree_with_their_closed_form():
    """Level and downward rays through both surfaces, some of which the lens bends up to the receiver."""
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(3000, 3))
    directions[:, 2] = -0.3 * np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = rng.uniform(-0.3, 0.3, (3000, 3))
    origins[:, 2] += 5.0
    rays = RayBundle(origins, directions, np.full(3000, 1.0 / 3000))
    landings, flux, _ = oracle(INNER, OUTER, rays, INDEX, 30.0)
    got = send(right(60), rays, distance=30.0)
    lands = np.isfinite(landings[:, 0])
    assert 0.2 < lands.mean() < 0.9
    assert np.mean(lands != np.isfinite(got.landings[:, 0])) < 2e-3
    central = lands & np.isfinite(got.landings[:, 0]) & (np.abs(landings) < 300.0).all(axis=1)
    assert central.sum() > 200
    assert np.sqrt(np.mean(np.sum((got.landings - landings)[central] ** 2, axis=1))) < 2e-3
    np.testing.assert_allclose(got.flux[central], flux[central], rtol=1e-4)
    assert set(got.fates.tolist()) >= {CastFate.LANDED, CastFate.OPENING, CastFate.BASE}


def test_a_ray_that_leaves_by_the_face_by_which_it_entered_is_back_in_the_cavity():
    def dented(u):
        return 6.0 - 2.0 * np.exp(-((np.arctan2(u[:, 0], u[:, 2]) / 0.15) ** 2))  # a furrow of the wall along y

    got = send(lens_mesh(dented, sphere(13.7).radius, 40), one_ray([-3.0, 0.3, 4.5], [1.0, 0.0, 0.0]))
    assert got.fates[0] == CastFate.BACK_INTO_CAVITY


def test_a_receiver_inside_the_lens_is_never_reached():
    shell = lens_mesh(sphere(6.0).radius, sphere(13.7).radius, 8)
    assert send(shell, one_ray([0.0, 0.0, 0.0], [0.0, 0.1, 1.0]), distance=10.0).fates[0] == CastFate.MISSED_RECEIVER
