"""Light through bodies before the lens: closed forms, refraction written by hand, finite differences, what is lost."""

from dataclasses import replace

import numpy as np
import pytest
from chains import MixedLight, clear, collimator, tables_of, upwards

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import DOUBLE, FaceCoating, FurtherBody, Media, Medium, ReflectanceTable
from lensforge.sources.source_pose import rotation_about
from lensforge.surfaces.asphere import Asphere, sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

GRID = TableGrid(161)
N, COVER_N, LOSS, COVER_LOSS = 1.49, 1.586, 0.01, 0.004
TURN = rotation_about("y", 0.11) @ rotation_about("x", -0.17)


def placed(name: str, shells: tuple[Asphere, Asphere], centre=(0.0, 0.0, 0.0), turn=TURN, **fields) -> FurtherBody:
    rows = tuple(tuple(float(value) for value in row) for row in turn)
    return FurtherBody(name, fields.pop("medium", Medium(COVER_N, COVER_LOSS)), *shells, centre, rows, **fields)


def tables(inner, outer) -> np.ndarray:
    return np.stack([tabulate(GRID, inner), tabulate(GRID, outer)])


CONCENTRIC = tables(sphere(2.0), sphere(5.0))
SHELL = sphere(12.0), sphere(14.5)
DOME = placed("dome", (sphere(20.0), sphere(21.5, 0.8)), (1.5, -2.0, -1.0))
BOWL = placed("bowl", (Asphere(29.0, -30.0, 0.4), Asphere(32.5, -31.0, 0.2)), (-2.0, 1.0, -3.0), TURN.T)


def scene(*bodies: FurtherBody, fresnel: bool = True) -> Scene:
    return Scene(replace(clear(N, absorption=LOSS), bodies=bodies), GRID, fresnel)


def test_a_shell_about_a_point_source_bends_nothing_and_loses_by_the_closed_form() -> None:
    rays = upwards(2000, 1)
    found = TracedBundle.of(CONCENTRIC, scene(placed("shell", SHELL)), rays).exits
    out = found.left_lens
    assert 0.8 < out.mean() < 1.0, "some go past its tilted rim"
    assert np.abs(found.directions - rays.directions)[out].max() < 1e-9
    at_lens = (4.0 * N / (N + 1.0) ** 2) ** 2 * np.exp(-3.0 * LOSS)
    at_shell = (4.0 * COVER_N / (COVER_N + 1.0) ** 2) ** 2 * np.exp(-2.5 * COVER_LOSS)
    assert found.flux[out] == pytest.approx(rays.flux[out] * at_lens * at_shell, rel=1e-10)
    assert found.lost_in_bodies[0, out] == pytest.approx(rays.flux[out] * at_lens * (1.0 - at_shell), rel=1e-9)
    assert found.lost_in_bodies[0, ~out] == pytest.approx(rays.flux[~out] * at_lens, rel=1e-10)


def by_hand(points, along, shells):
    """Rays and coherency through spheres (centre, radius, index before and behind, absorption before), outwards."""
    light = np.einsum("ij,n->nij", np.eye(3), np.full(len(points), 0.5))
    light = light - 0.5 * np.einsum("ni,nj->nij", along, along)
    for centre, radius, before, behind, loss in shells:
        apart = points - centre
        b = (apart * along).sum(1)
        path = -b + np.sqrt(b * b - (apart * apart).sum(1) + radius**2)
        points = points + path[:, None] * along
        normal = (points - centre) / radius
        light = light * np.exp(-loss * path)[:, None, None]
        cos_in = (along * normal).sum(1)
        sin_out = before / behind * np.sqrt(1.0 - cos_in**2)
        cos_out = np.sqrt(1.0 - sin_out**2)
        s = np.cross(along, normal)
        s = s / np.linalg.norm(s, axis=1)[:, None]
        p = np.cross(along, s)
        ahead = before / behind * along + (cos_out - before / behind * cos_in)[:, None] * normal
        r_s = (before * cos_in - behind * cos_out) / (before * cos_in + behind * cos_out)
        r_p = (behind * cos_in - before * cos_out) / (behind * cos_in + before * cos_out)
        jones = np.einsum("n,ni,nj->nij", np.sqrt(1.0 - r_s**2), s, s)
        jones += np.einsum("n,ni,nj->nij", np.sqrt(1.0 - r_p**2), np.cross(ahead, s), p)
        light, along = jones @ light @ jones.transpose(0, 2, 1), ahead
    return points, along, np.trace(light, axis1=1, axis2=2)


def test_displaced_spheres_refract_and_polarise_as_written_by_hand() -> None:
    """Light is polarised by a lens of displaced faces, and more by each of two tilted, displaced shells."""
    second = placed("second", (sphere(30.0, -2.0), sphere(33.0)), (3.0, 2.0, 0.5), TURN.T)
    rays = upwards(3000, 2, 1.0)
    found = TracedBundle.of(tables(sphere(3.0, 0.5), sphere(6.0, -1.0)), scene(DOME, second), rays).exits
    shells = [(np.array([0.0, 0.0, 0.5]), 3.0, 1.0, N, 0.0), (np.array([0.0, 0.0, -1.0]), 6.0, N, 1.0, LOSS)]
    for body, heights in ((DOME, (0.0, 0.8)), (second, (-2.0, 0.0))):
        turn, origin = np.array(body.turn), np.array(body.centre_mm)
        centres = [origin + turn @ [0.0, 0.0, height] for height in heights]
        radii = (20.0, 21.5) if body is DOME else (30.0, 33.0)
        shells += [(centres[0], radii[0], 1.0, COVER_N, 0.0), (centres[1], radii[1], COVER_N, 1.0, COVER_LOSS)]
    points, along, share = by_hand(rays.origins, rays.directions, shells)
    out = found.left_lens
    assert out.mean() > 0.6
    assert np.abs(found.points - points)[out].max() < 1e-5
    assert np.abs(found.directions - along)[out].max() < 1e-6  # of the tables
    assert found.flux[out] == pytest.approx((rays.flux * share)[out], rel=1e-6)


def test_a_body_of_the_index_around_it_changes_nothing() -> None:
    rays = upwards(2000, 3, 1.0)
    air = replace(DOME, medium=Medium(1.0))
    bumpy = tables(sphere(3.0, 0.5), sphere(6.0, -1.0))
    with_it, alone = (TracedBundle.of(bumpy, scene(*bodies), rays).exits for bodies in ((air,), ()))
    out = with_it.left_lens
    assert out.mean() > 0.6
    assert np.abs(with_it.directions - alone.directions)[out].max() < 1e-12
    assert with_it.flux[out] == pytest.approx(alone.flux[out], rel=1e-12)
    away = with_it.points - alone.points
    assert np.abs(np.cross(away, alone.directions))[out].max() < 1e-9, "on the same lines"


def test_the_flux_that_leaves_the_lens_is_kept_or_lost_by_body() -> None:
    rays = upwards(3000, 4, 1.5)
    traced = TracedBundle.of(tables(sphere(3.0, 0.5), sphere(6.0, -1.0)), scene(DOME, BOWL), rays)
    at_lens, exits = traced.at_lens, traced.exits
    kept = exits.flux + exits.lost_in_bodies.sum(axis=0)
    assert kept == pytest.approx(at_lens.flux, rel=1e-13)
    ended = at_lens.left_lens & ~exits.left_lens
    assert ended.any() and (exits.flux[ended] == 0.0).all()
    assert (exits.lost_in_bodies >= 0.0).all() and (exits.lost_in_bodies.sum(axis=1) > 0.0).all()


def test_light_reflected_totally_in_a_body_is_lost_there() -> None:
    """A ball far off the axis of its cavity: oblique light does not leave it."""
    hollow = placed("hollow", (sphere(12.0, -11.0), sphere(30.0)), (0.0, 0.0, 0.0))
    rays = upwards(2000, 5)
    found = TracedBundle.of(tables(sphere(0.5), sphere(0.9)), scene(hollow), rays).exits
    total = found.fates == Fate.TOTAL_REFLECTION
    lost = found.lost_in_bodies[0]
    assert (lost[total] > 0.0).all() and (found.flux[total] == 0.0).all()


@pytest.mark.parametrize("kind", ["double", "tir"])
def test_gradients_through_tilted_bodies_are_those_of_differences(kind: str) -> None:
    """By points, directions, flux with its polarisation, and the exit sine; through a coated and a clear body."""
    film = ReflectanceTable((0.0, 30.0, 60.0), ((0.01, 0.02, 0.2),))
    coated = replace(DOME, coatings=(FaceCoating("inner", "cavity", film),))
    media = replace(clear(N, absorption=LOSS), bodies=(coated, BOWL))
    if kind == "double":
        own, here = tables(sphere(3.0, 0.5), sphere(6.0, -1.0)), Scene(media, GRID)
    else:
        body = collimator(0.03)
        own, here = tables_of(body, GRID), Scene(media, GRID, chain=body.chain(6))
    direction = np.random.default_rng(7).normal(size=own.shape) * 1e-3
    slope = MixedLight(own, here, upwards(1500, 6, 0.8), 8).slope(direction, 2e-4)
    assert slope.crossed < 150
    assert abs(slope.adjoint - slope.differences) < 20.0 * slope.error, slope
    assert abs(slope.adjoint - slope.differences) < 1e-4 * abs(slope.differences) + 1e-6, slope


def test_colours_are_bent_apart_by_the_index_of_each() -> None:
    from lensforge.optics.material import MATERIALS

    glass = MATERIALS["PC"]
    rays = replace(upwards(600, 9, 0.5), wavelengths_nm=np.linspace(450.0, 650.0, 600))
    coloured = replace(DOME, medium=Medium(1.586, 0.0, glass))
    found = TracedBundle.of(CONCENTRIC, scene(coloured), rays).exits
    for wave in (0, 300, 599):
        one = replace(DOME, medium=Medium(float(glass.index(rays.wavelengths_nm[wave : wave + 1])[0])))
        alone = TracedBundle.of(CONCENTRIC, scene(one), replace(rays, wavelengths_nm=None)).exits
        assert found.directions[wave] == pytest.approx(alone.directions[wave], abs=1e-13)


def test_names_of_the_faces_are_those_of_the_usual_lens() -> None:
    assert Media(Medium(N), bodies=(DOME,)).bodies[0].media(Media(Medium(N), outside_index=1.1)).outside_index == 1.1
    assert DOUBLE == ("inner", "outer")
