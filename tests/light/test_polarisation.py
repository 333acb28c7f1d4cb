"""Polarisation through two faces and a plate: against Mueller matrices and 3 x 3 ray matrices, and its conservation."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from inlined import alone
from landed import by_kernels, trace_tables
from own_media import coatings
from scenes import random_surface, sphere, table_of

from lensforge.kernels import fresnel
from lensforge.light.table_trace import Scene
from lensforge.optics.coatings import coating_tables
from lensforge.optics.media import CoatingLayer, CoverGlass, IndexCurve, LayerStack, Media, Medium
from lensforge.proof.refraction import AtFace, RefractingFace, unpolarised
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

transmittances = alone(fresnel.transmittances)
coated_transmittances = alone(fresnel.coated_transmittances)
axial_share = alone(fresnel.axial_share)
polarised_share = alone(fresnel.polarised_share)
N = 1.4936
GRID = TableGrid(64)
RNG = np.random.default_rng(7)
GLASS = CoverGlass(1.52, 4.0, 10.0)


def snell(d, n, ratio):
    c = d @ n
    return ratio * d + (np.sqrt(1.0 - ratio**2 * (1.0 - c**2)) - ratio * c) * n


def ray_matrix(d, n, ratio):
    """P of Yun, Crabtree and Chipman, Appl. Opt. 50, 2855 (2011), for flux; by Fresnel's sines and tangents."""
    b = snell(d, n, ratio)
    s = np.cross(d, n)
    if np.linalg.norm(s) < 1e-9:
        s = np.cross(d, [0.6, -0.8, 0.1])
    s /= np.linalg.norm(s)
    i, t = (np.arctan2(np.linalg.norm(np.cross(direction, n)), direction @ n) for direction in (d, b))
    if i < 1e-7:
        r_s = r_p = (1.0 - ratio) / (1.0 + ratio)
    else:
        r_s = np.sin(i - t) / np.sin(i + t)
        r_p = np.tan(i - t) / np.tan(i + t)
    into, out = (np.column_stack([s, np.cross(way, s), way]) for way in (d, b))
    return out @ np.diag([np.sqrt(1.0 - r_s**2), np.sqrt(1.0 - r_p**2), 1.0]) @ into.T, b


def chain(d, faces):
    """Share of unpolarised light that passes the faces, (normal, ratio) each, and the share of its field along z."""
    whole = np.eye(3)
    across = np.linalg.svd(d[None])[2][1:]  # two fields at right angles
    for n, ratio in faces:
        matrix, d = ray_matrix(d, n, ratio)
        whole = matrix @ whole
    fields = across @ whole.T
    return 0.5 * np.sum(fields**2), 0.5 * np.sum(fields[:, 2] ** 2)


def near(d, angle):
    """A normal at an angle to d."""
    aside = np.cross(d, RNG.normal(size=3))
    return np.cos(angle) * d + np.sin(angle) * aside / np.linalg.norm(aside)


def two_faces(angles=(1.3, 0.6), count=40):
    for k in range(count):
        d = RNG.normal(size=3)
        d /= np.linalg.norm(d)
        m = near(d, RNG.uniform(0.0, angles[0]) if k > 3 else (0.0, 1e-9, 1e-5, 0.0)[k])
        within = snell(d, m, 1.0 / N)
        n = near(within, RNG.uniform(0.0, angles[1]) if k not in (2, 3) else (0.0, 1e-8)[k - 2])
        yield d, m, within, n


def of_two(d, m, within, n):
    """By the formulas of the kernels: the shares that pass, and with their field along z, of a unit flux."""
    c = d @ m
    e = within @ n
    t_s, t_p, excess = transmittances(c, within @ m, 1.0 / N)[0]
    first = t_s, t_p, excess * N**2
    second, _ = transmittances(e, snell(within, n, N) @ n, N)
    y = m @ n - (m @ within) * e
    b = snell(within, n, N)
    first_normal, *at = (tuple(vector.tolist()) for vector in (m, n, within, b))
    axial = axial_share(first, second, first_normal, fresnel.SecondFace(N, e, b @ n, *at), (0.0, 0.0, 1.0))[0]
    return polarised_share(first, second, y)[0], axial


def test_two_faces_transmit_as_the_ray_matrices_of_chipman_and_yun_say():
    """Skew rays, crossed planes, and at normal incidence of the one, the other and both."""
    for k, (d, m, within, n) in enumerate(two_faces()):
        wanted = chain(d, [(m, 1.0 / N), (n, N)])
        rounding = 1e-8 if k in (1, 2, 3) else 2e-12  # of the matrices, whose plane of incidence is lost to the digits
        np.testing.assert_allclose(of_two(d, m, within, n), wanted, rtol=0, atol=rounding)


def test_light_that_passes_and_light_that_returns_add_up_face_after_face():
    """For unpolarised light and the mean of two polarised rays alike; what is split keeps fields across it."""
    d = np.array([face[0] for face in two_faces(count=60)])
    normals = np.array([near(direction, angle) for direction, angle in zip(d, np.linspace(0.0, 1.4, 60), strict=True)])
    waves = np.full(60, 550.0)
    layers = LayerStack((CoatingLayer(IndexCurve((2.1,)), 80.0),), IndexCurve((N,)), (300.0, 900.0))
    for coating in (None, layers):
        into = RefractingFace(np.ones(60), np.full(60, N), coating, waves, True)
        at = AtFace.of(into, d, normals, unpolarised(d))
        s_state, p_state = (np.repeat(unpolarised(d)[:, k : k + 1], 2, axis=1) for k in (0, 1))
        apart = [AtFace.of(into, d, normals, state).transmittance for state in (s_state, p_state)]
        np.testing.assert_allclose(np.mean(apart, axis=0), at.transmittance, atol=1e-14)
        for way, fields in ((at.bent, at.passed), (at.mirrored, at.returned)):
            assert np.abs(np.einsum("nfi,ni->nf", fields, way)).max() < 1e-13
            np.testing.assert_allclose(np.sum(np.abs(fields) ** 2, axis=(1, 2)), 2.0, rtol=1e-12)
        for light, way in ((at.passed, at.bent), (at.returned, at.mirrored)):
            once = AtFace.of(into, way, near_all(way), light)
            returned = [
                np.sum(np.abs(at_face.passed) ** 2 * at_face.transmittance[:, None, None], axis=(1, 2))
                + np.sum(np.abs(at_face.returned) ** 2 * (1.0 - at_face.transmittance)[:, None, None], axis=(1, 2))
                for at_face in (once,)
            ]
            np.testing.assert_allclose(returned[0], 2.0, rtol=1e-12)


def near_all(ways):
    return np.array([near(way, 0.7) for way in ways])


def rotated(bundle, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return RayBundle(bundle.origins @ turn.T, bundle.directions @ turn.T, bundle.flux)


@pytest.mark.parametrize("glass", [None, GLASS], ids=["bare", "behind a plate"])
def test_skew_rays_through_spheres_transmit_as_their_matrices_say(glass):
    """From beside the centre, with planes of incidence of their own; and the same when all is turned about z."""
    rays = SquareEmitter(1.0).sample(64, 3)
    rays = replace(rays, flux=np.ones(64))
    tables = [table_of(sphere(radius_mm), GRID) for radius_mm in (0.8, 1.3)]
    media = Media(Medium(N), cover_glass=glass)
    exits = trace_tables(tables, Scene(media, GRID), rays)
    assert exits.left_lens.sum() > 50
    for k in np.nonzero(exits.left_lens.numpy() & (exits.directions[:, 2].numpy() > 0.05))[0]:
        p = rays.origins[k]
        d = rays.directions[k]
        faces = []
        way = d
        for radius, ratio in ((0.8, 1.0 / N), (1.3, N)):
            along = p @ way
            p = p + (np.sqrt(along**2 - p @ p + radius**2) - along) * way
            faces.append((p / radius, ratio))
            way = snell(way, p / radius, ratio)
        if glass is not None:
            faces += [(np.array([0.0, 0.0, 1.0]), quotient) for quotient in (1.0 / 1.52, 1.52)]
        assert exits.flux[k].item() == pytest.approx(chain(d, faces)[0], rel=2e-9)
    turned = trace_tables(tables, Scene(media, GRID), rotated(rays, 0.7))
    assert torch.allclose(turned.flux, exits.flux, rtol=1e-9)


@pytest.mark.parametrize("coated", [False, True])
def test_derivatives_at_a_face_are_those_of_differences_up_to_normal_incidence(coated):
    layers = LayerStack((CoatingLayer(IndexCurve((2.1,)), 80.0),), IndexCurve((N,)), (300.0, 900.0))
    media = Media(Medium(N), coatings=coatings(inner=layers), wavelength_nm=550.0)
    table = coating_tables(media, (550.0, 550.0)).faces["inner"][0]
    for ratio in (1.0 / N, N):

        def at(c, ratio=ratio):
            q = np.sqrt(1.0 - ratio**2 * (1.0 - c * c))
            return coated_transmittances(c, q, ratio, table, 0.0) if coated else transmittances(c, q, ratio)

        for c in (0.78, 0.9, 0.999, 1.0 - 1e-7):
            ahead, behind = (np.array(at(c + step)[0]) for step in (1e-6, -1e-6) ) if c < 0.9999 else (
                np.array(at(c)[0]), np.array(at(c - 2e-6)[0]))  # fmt: skip
            np.testing.assert_allclose(at(c)[1], (ahead - behind) / 2e-6, rtol=2e-4, atol=2e-5)


@pytest.mark.parametrize("glass", [None, GLASS], ids=["bare", "behind a plate"])
def test_gradients_at_nearly_normal_incidence_are_those_of_differences(glass):
    """Through nearly concentric spheres all light of a point passes at nearly normal incidence."""
    tables = [table_of(random_surface(k, radius, 0.02), GRID) for k, radius in ((3, 0.8), (4, 2.45))]
    rays = SquareEmitter(1e-6).sample(256, 2)
    scene = Scene(Media(Medium(N), cover_glass=glass), GRID)
    by_flux = torch.from_numpy(RNG.normal(size=256))

    def value(*moved):
        return (1e3 * by_flux * by_kernels(list(moved), scene, rays, 1e4).flux).sum()

    gradients = torch.autograd.grad(value(*(table.requires_grad_() for table in tables)), tables)
    for which, gradient in enumerate(gradients):
        way = torch.from_numpy(RNG.normal(size=gradient.shape)) * (gradient != 0)
        ahead, behind = (
            value(*(table.detach() + s * 1e-7 * way * (k == which) for k, table in enumerate(tables))) for s in (1, -1)
        )
        assert ((ahead - behind) / 2e-7).item() == pytest.approx((gradient * way).sum().item(), rel=1e-5, abs=1e-6)
