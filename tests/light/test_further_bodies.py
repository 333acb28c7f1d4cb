"""Light through bodies behind the lens: closed forms, refraction written by hand, finite differences, what is lost."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from chains import MixedLight, clear, collimator, tables_of, upwards
from shells import BOWL, COVER_LOSS, COVER_N, DOME, LOSS, SECOND, SHELL, N, by_hand, placed, spheres_of

from lensforge.kernels.fate import Fate
from lensforge.light.reference_bodies import ReferenceBody
from lensforge.light.reference_trace import as_arrays, trace_reference
from lensforge.light.secondary_optics import tabled
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import CoverGlass, FaceCoating, FaceScatter, Medium, ReflectanceTable, SecondaryOptic
from lensforge.optics.pose import Pose
from lensforge.optics.scattering import GaussianFacets, lambertian
from lensforge.scene.made_part import AsMade
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.chart_spline import HALF_WIDTH, ChartSpline
from lensforge.surfaces.surface import to_sphere

GRID = TableGrid(161)


def tables(inner, outer) -> np.ndarray:
    return np.stack([tabulate(GRID, inner), tabulate(GRID, outer)])


MADE = AsMade(
    source=Pose.displaced((0.1, -0.2, 0.0), (0.02, -0.03, 0.0)),
    lens=Pose.displaced((0.0, 0.2, 0.1), (-0.01, 0.02, 0.0)),
    faces={"outer": Pose.displaced((0.05, 0.1, 0.02), (0.01, 0.02, 0.0))},
    source_size=1.05, scale=0.98, seat_mm=1.5, slopes={"inner": 2e-3, "outer": 1e-3},
)  # fmt: skip
CONCENTRIC = tables(sphere(2.0), sphere(5.0))


def scene(*bodies: SecondaryOptic, fresnel: bool = True) -> Scene:
    return Scene(replace(clear(N, absorption=LOSS), bodies=bodies), GRID, fresnel)


def test_a_shell_about_a_point_source_bends_nothing_and_loses_by_the_closed_form() -> None:
    rays = upwards(2000, 1)
    exits = TracedBundle.of(CONCENTRIC, scene(placed("shell", SHELL)), rays).exits
    out = exits.left_lens
    assert 0.8 < out.mean() < 1.0, "some go past its tilted rim"
    assert np.abs(exits.directions - rays.directions)[out].max() < 1e-9
    at_lens = (4.0 * N / (N + 1.0) ** 2) ** 2 * np.exp(-3.0 * LOSS)
    at_shell = (4.0 * COVER_N / (COVER_N + 1.0) ** 2) ** 2 * np.exp(-2.5 * COVER_LOSS)
    assert exits.flux[out] == pytest.approx(rays.flux[out] * at_lens * at_shell, rel=1e-10)
    assert exits.lost_in_bodies[0, out] == pytest.approx(rays.flux[out] * at_lens * (1.0 - at_shell), rel=1e-9)
    assert exits.lost_in_bodies[0, ~out] == pytest.approx(rays.flux[~out] * at_lens, rel=1e-10)


def test_displaced_spheres_refract_and_polarise_as_written_by_hand() -> None:
    """Light is polarised by a lens of displaced faces, and more by each of two tilted, displaced shells."""
    rays = upwards(3000, 2, 1.0)
    exits = TracedBundle.of(tables(sphere(3.0, 0.5), sphere(6.0, -1.0)), scene(DOME, SECOND), rays).exits
    shells = [(np.array([0.0, 0.0, 0.5]), 3.0, 1.0, N, 0.0), (np.array([0.0, 0.0, -1.0]), 6.0, N, 1.0, LOSS)]
    shells += [*spheres_of(DOME), *spheres_of(SECOND)]
    points, along, share = by_hand(rays.origins, rays.directions, shells)
    out = exits.left_lens
    assert out.mean() > 0.6
    assert np.abs(exits.points - points)[out].max() < 1e-5
    assert np.abs(exits.directions - along)[out].max() < 1e-6  # of the tables
    assert exits.flux[out] == pytest.approx((rays.flux * share)[out], rel=1e-6)


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


def test_a_body_of_faces_of_a_file_sends_light_as_the_spheres_that_the_file_holds() -> None:
    """CAD faces and points become splines of arrays, by which the tables of a body are kept."""
    axis = np.tan(np.linspace(-1.0, 1.0, 80) * np.arctan(HALF_WIDTH))
    places = to_sphere(np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1))
    given = {name: ChartSpline.through(axis, getattr(DOME, name).radius_on_grid(places)) for name in ("inner", "outer")}
    rays = upwards(2000, 6, 1.0)
    lens = tables(sphere(3.0, 0.5), sphere(6.0, -1.0))
    exits, exact = (TracedBundle.of(lens, scene(body), rays).exits for body in (replace(DOME, **given), DOME))
    out = exact.left_lens
    assert 0.6 < out.mean() < 1.0 and (exits.left_lens == out).all()
    assert np.abs(exits.directions - exact.directions)[out].max() < 1e-6
    assert exits.flux[out] == pytest.approx(exact.flux[out], rel=1e-6)
    assert tabled(replace(DOME, **given)) is tabled(replace(DOME, **given))


def test_the_flux_that_leaves_the_lens_is_kept_or_lost_by_body() -> None:
    rays = upwards(3000, 4, 1.5)
    traced = TracedBundle.of(tables(sphere(3.0, 0.5), sphere(6.0, -1.0)), scene(DOME, BOWL), rays)
    at_lens = traced.at_lens
    exits = traced.exits
    kept = exits.flux + exits.lost_in_bodies.sum(axis=0)
    assert kept == pytest.approx(at_lens.flux, rel=1e-13)
    ended = at_lens.left_lens & ~exits.left_lens
    assert ended.any() and (exits.flux[ended] == 0.0).all()
    assert (exits.lost_in_bodies >= 0.0).all() and (exits.lost_in_bodies.sum(axis=1) > 0.0).all()


def test_light_reflected_totally_in_a_body_is_lost_there() -> None:
    """A ball of a high index whose cavity is flat: oblique light does not leave it."""
    hollow = placed("hollow", (sphere(12.0, -11.0), sphere(5.5)), turn=Pose(), medium=Medium(3.0))
    rays = upwards(2000, 5)
    exits = TracedBundle.of(tables(sphere(0.5), sphere(0.9)), scene(hollow), rays).exits
    total = exits.fates == Fate.TOTAL_REFLECTION
    assert total.any() and exits.left_lens.any()
    assert (exits.lost_in_bodies[0, total] > 0.0).all() and (exits.flux[total] == 0.0).all()


@pytest.mark.parametrize("kind", ["double", "as made", "behind a glass", "frosted", "opal", "tir"])
def test_gradients_through_tilted_bodies_are_those_of_differences(kind: str) -> None:
    """By points, directions, flux with its polarisation, and the exit sine; through a coated and a clear body."""
    film = ReflectanceTable((0.0, 30.0, 60.0), ((0.01, 0.02, 0.2),))
    coated = replace(DOME, coatings=(FaceCoating("inner", "cavity", film),))
    media = replace(clear(N, absorption=LOSS), bodies=(coated, BOWL))
    if kind in ("frosted", "opal"):  # a face of the lens, and others of both bodies
        model = GaussianFacets(0.02) if kind == "frosted" else lambertian(0.3)
        facets = (FaceScatter(face, model) for face in ("outer", "inner", "outer"))
        of_lens, first, second = ((facet,) for facet in facets)
        media = replace(media, scatter=of_lens, bodies=(replace(coated, scatter=first), replace(BOWL, scatter=second)))
    if kind == "behind a glass":
        media = replace(media, cover_glass=CoverGlass(1.52, 3.0, 40.0, 2e-3))
    if kind != "tir":
        table = tables(sphere(3.0, 0.5), sphere(6.0, -1.0))
        made = MADE if kind == "as made" else None
        here = Scene(media, GRID, made=made)
    else:
        body = collimator(0.03)
        table = tables_of(body, GRID)
        here = Scene(media, GRID, chain=body.chain(6))
    if kind in ("frosted", "opal"):
        few = upwards(60, 6, 0.8)
        same = as_arrays(trace_reference(ReferenceBody.by_tables(torch.from_numpy(table), here), few))
        assert np.abs(TracedBundle.of(table, here, few).exits.directions - same.directions).max() < 1e-9
    direction = np.random.default_rng(7).normal(size=table.shape) * 1e-3
    slope = MixedLight(table, here, upwards(1500, 6, 0.8), 8).slope(direction, 2e-4)
    assert slope.crossed < 150
    assert abs(slope.adjoint - slope.differences) < 20.0 * slope.error, slope
    assert abs(slope.adjoint - slope.differences) < 1e-4 * abs(slope.differences) + 1e-6, slope


def test_the_lens_as_made_polarises_as_the_designed_one_does() -> None:
    """Where nothing is displaced the fields from the directions are those of the kernel; and rays follow the lens."""
    rays = upwards(1500, 11, 1.0)
    bumpy = tables(sphere(3.0, 0.5), sphere(6.0, -1.0))
    film = ReflectanceTable((0.0, 30.0, 60.0), ((0.01, 0.02, 0.2),))
    plain = scene(DOME, BOWL)
    media = replace(plain.media, coatings=(FaceCoating("outer", "outside", film),))
    designed = replace(plain, media=media)
    one, other = (TracedBundle.of(bumpy, replace(designed, made=made), rays).exits for made in (None, AsMade()))
    assert np.array_equal(one.fates, other.fates) and one.left_lens.mean() > 0.5
    assert other.flux == pytest.approx(one.flux, rel=1e-9)
    assert other.directions == pytest.approx(one.directions, abs=1e-10)
    turned = Pose.displaced((0.1, -0.2, 0.0), (0.02, -0.03, 0.0))
    moved = TracedBundle.of(bumpy, replace(designed, made=AsMade(source=turned, lens=turned)), rays).exits
    bodies = tuple(replace(body, pose=body.pose.seen_from(turned)) for body in media.bodies)
    seen = TracedBundle.of(bumpy, replace(designed, media=replace(media, bodies=bodies)), rays).exits
    assert (moved.fates == seen.fates).mean() > 0.995
    both = moved.left_lens & seen.left_lens
    assert moved.flux[both] == pytest.approx(seen.flux[both], rel=1e-8)
    assert moved.directions[both] == pytest.approx(turned.directions(seen.directions)[both], abs=1e-9)


def test_colours_are_bent_apart_by_the_index_of_each() -> None:
    from lensforge.optics.material import MATERIALS

    glass = MATERIALS["PC"]
    rays = upwards(600, 9, 0.5).with_wavelengths(np.linspace(450.0, 650.0, 600))
    coloured = replace(DOME, medium=Medium(1.586, 0.0, glass))
    exits = TracedBundle.of(CONCENTRIC, scene(coloured), rays).exits
    for wave in (0, 300, 599):
        dome = replace(DOME, medium=Medium(float(glass.index(rays.wavelengths_nm[wave : wave + 1])[0])))
        alone = TracedBundle.of(CONCENTRIC, scene(dome), replace(rays, waves=None)).exits
        assert exits.directions[wave] == pytest.approx(alone.directions[wave], abs=1e-13)
