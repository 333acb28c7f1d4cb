"""Chains of events: closed forms, the reference tracer, finite differences, invariants, and what is refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from chains import REACH, MixedLight, clear, collimator, mirrors, reflector, tables_of, upwards
from landed import exactly
from nightly import NIGHTLY, first_by_day

from lensforge.errors import InputError
from lensforge.kernels.adjoint import adjoint_of_ways
from lensforge.kernels.fate import Fate
from lensforge.kernels.trace import trace
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.optics.media import (
    CoatingLayer,
    CoverGlass,
    FaceCoating,
    FaceScatter,
    IndexCurve,
    LayerStack,
    ReflectanceTable,
)
from lensforge.optics.pose import Pose
from lensforge.optics.scattering import GaussianFacets, RingScatter, lambertian
from lensforge.scene.body import Body, Face
from lensforge.scene.exit_rays import Sensitivities
from lensforge.scene.made_part import AsMade
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.reciprocal import ConeFace, PlaneFace

GRID = TableGrid(161)
FILM = LayerStack((CoatingLayer(IndexCurve((1.38,)), 100.0),), IndexCurve((1.49,)), (400.0, 700.0))
TABLE = ReflectanceTable((0.0, 30.0, 60.0), ((0.01, 0.02, 0.2),))
NAMES = ("cap", "side", "wall", "exit")
MOVED = AsMade(
    names=NAMES,
    source=Pose.displaced((0.01, 0.02, 0.03), (0.01, 0.02, 0.0), (0.0, 0.0, 0.0)),
    lens=Pose.displaced((0.02, -0.01, 0.03), (0.003, 0.002, 0.0)),
    source_size=1.02, scale=1.001, seat_mm=5.0,
)  # fmt: skip
ROUGH = AsMade(names=NAMES, slopes=dict.fromkeys(NAMES, 0.01))
FROSTED = FaceScatter("cap", GaussianFacets(0.03)), FaceScatter("wall", GaussianFacets(0.01))
STEEP = RingScatter(
    (0.0, 0.05, 0.2, 0.5), ((0.0, 0.1, 0.3, 0.6), (0.0, 0.2, 0.5, 0.8), (0.0, 0.3, 0.4, 0.5)), (0.3, 0.7, 1.0)
)
SPREAD = tuple(
    FaceScatter(*item)
    for item in {
        "cap": STEEP,
        "side": GaussianFacets(0.03),
        "wall": lambertian(0.3),
        "exit": RingScatter((0.0, 0.01, 0.25), ((0.0, 0.4, 0.9),)),
    }.items()
)
CASES = {
    "clear": (clear(), None),
    "absorbing": (clear(absorption=0.02), None),
    "coated": (clear(coatings=(FaceCoating("cap", CAVITY, TABLE), FaceCoating("exit", OUTSIDE, FILM))), None),
    "mirror": (clear(absorption=0.02, coatings=mirrors(0.9, wall=OUTSIDE)), None),
    "two mirrors": (clear(coatings=mirrors(0.8, wall=OUTSIDE, side=CAVITY)), None),
    "glass": (replace(clear(absorption=0.02), cover_glass=CoverGlass(1.52, 2.0, 20.0, 0.001, FILM)), None),
    "moved": (clear(absorption=0.02), MOVED),
    "rough": (clear(), ROUGH),
    "frosted": (replace(clear(coatings=mirrors(0.9, wall=OUTSIDE)), scatter=FROSTED), ROUGH),
    "spread": (replace(clear(coatings=mirrors(0.9, wall=OUTSIDE)), scatter=SPREAD), ROUGH),
}


def scene(body: Body, media, made=None, events: int = 6, grid: TableGrid = GRID, fresnel: bool = True) -> Scene:
    return Scene(media, grid, fresnel, made, body.chain(events))


def test_a_paraboloid_sends_the_light_of_its_focus_along_the_axis() -> None:
    body = reflector(5.0, 1.0, 8.0)
    rays = upwards(4000, 1)
    grid = TableGrid(301)
    media = clear(coatings=mirrors(0.9, mirror=CAVITY))
    traced = TracedBundle.of(tables_of(body, grid), scene(body, media, events=2, grid=grid), rays)
    assert (traced.exits.fates == Fate.LEFT_LENS).all()
    by_mirror = traced.met[:, 1] >= 0
    assert 0.3 < by_mirror.mean() < 0.8
    assert np.abs(traced.exits.directions[by_mirror][:, :2]).max() < 3e-6  # of its table
    np.testing.assert_allclose(traced.exits.flux, np.where(by_mirror, 0.9, 1.0) * rays.flux, rtol=1e-14)
    direct = traced.exits.directions[~by_mirror]
    assert np.abs(direct - rays.directions[~by_mirror]).max() < 1e-14, "an opening bends nothing"


FINE = TableGrid(401)


@cache
def fine_tables() -> np.ndarray:
    return tables_of(collimator(0.05), FINE)


@pytest.mark.parametrize(
    ("case", "fresnel"),
    first_by_day(len(CASES) + 1, [*((case, True) for case in CASES), ("glass", False), ("two mirrors", False)]),
)
def test_the_kernels_agree_with_the_reference_tracer_on_exact_faces(case: str, fresnel: bool) -> None:
    (media, made) = CASES[case]
    body = collimator(0.05)
    events = 2 if case == "two mirrors" else 6
    rays = upwards(60, 3, 0.5)
    here = scene(body, media, made, events, FINE, fresnel)
    exits = TracedBundle.of(fine_tables(), here, rays).exits
    wanted = exactly({face.name: face.surface for face in body.faces}, here, rays)
    assert np.array_equal(exits.fates, wanted.fates)
    assert np.abs(exits.points - wanted.points).max() < 3e-4
    assert np.abs(exits.directions - wanted.directions).max() < 1e-4
    for name in ("flux", "sin2_exit") if exits.axial is None else ("flux", "sin2_exit", "axial"):
        assert np.abs(getattr(exits, name) - getattr(wanted, name)).max() < 5e-4, name
    assert (wanted.absorbed is None) == (exits.absorbed is None)
    if exits.absorbed is not None:
        assert np.abs(exits.absorbed - wanted.absorbed).max() < 1e-5


@pytest.mark.parametrize("case", CASES)
def test_the_adjoint_is_the_slope_of_every_face(case: str) -> None:
    (media, made) = CASES[case]
    body = collimator(0.05)
    light = MixedLight(tables_of(body, GRID), scene(body, media, made), upwards(500, 4, 0.5), 5)
    assert (light.base.met >= 0).sum(1).max() >= 3
    for face in range(4):
        direction = np.zeros_like(light.tables)
        direction[face] = np.random.default_rng(face).normal(size=direction[face].shape)
        slope = light.slope(direction, 1e-7)
        assert slope.differences == pytest.approx(slope.adjoint, abs=3.0 * slope.error), NAMES[face]
        assert slope.crossed <= 15


def test_a_few_rays_have_the_gradient_that_they_have_among_many() -> None:
    """Of most chunks of so few rays there is none."""
    (media, made) = CASES["mirror"]
    body = collimator(0.05)
    rays = upwards(500, 4, 0.5)
    tables = tables_of(body, GRID)
    here = scene(body, media, made)
    by = np.zeros((500, 8))
    by[:3] = np.random.default_rng(1).normal(size=(3, 8))
    few, many = (
        TracedBundle.of(tables, here, rays.take(some)).gradients(
            Sensitivities(by[some, :3], by[some, 3:6]), by[some, 6].copy(), by[some, 7].copy()
        )
        for some in (slice(3), slice(None))
    )
    np.testing.assert_allclose(few, many, rtol=1e-12, atol=1e-15)
    assert many.any()


def test_rays_in_any_order_of_memory_go_through_the_kernels_that_are_compiled() -> None:
    body = collimator(0.05)
    rays = upwards(60, 4, 0.5)
    tables = tables_of(body, GRID)
    by = np.asfortranarray(np.random.default_rng(1).normal(size=(60, 3)))
    alike = np.ones(60)
    turned = replace(rays, origins=np.asfortranarray(rays.origins), directions=np.asfortranarray(rays.directions))
    gradients = []
    compiled = []
    for bundle, points in ((rays, by.copy(order="C")), (turned, by)):
        traced = TracedBundle.of(tables, scene(body, clear()), bundle)
        gradients.append(traced.gradients(Sensitivities(points, points), alike, alike))
        compiled.append((len(trace.signatures), len(adjoint_of_ways.signatures)))
    assert np.array_equal(*gradients) and compiled[0] == compiled[1]


def test_the_adjoint_holds_in_random_scenes() -> None:
    """Up to six events; a crease that is crossed is counted, as is a ray that grazes: its slope has a large error."""
    rng = np.random.default_rng(6)
    crossed = 0
    events = set()
    traced = 0
    for number in range(20_000 if NIGHTLY else 12):
        body = collimator(rng.uniform(0.0, 0.1), rng.uniform(0.0, 0.1), rng.uniform(0.6, 0.95))
        coated = {name: side for name, side in (("wall", OUTSIDE), ("side", CAVITY)) if rng.random() < 0.5}
        media = clear(rng.uniform(1.4, 1.7), mirrors(rng.uniform(0.5, 1.0), **coated), rng.uniform(0.0, 0.05))
        grid = TableGrid(48)
        rays = upwards(48, number, rng.uniform(0.0, 1.0))
        light = MixedLight(tables_of(body, grid), scene(body, media, None, 6, grid), rays, number)
        slope = light.slope(rng.normal(size=light.tables.shape), 1e-8)
        assert slope.differences == pytest.approx(slope.adjoint, abs=10.0 * slope.error), number
        crossed = crossed + slope.crossed
        traced = traced + len(rays)
        events |= set((light.base.met >= 0).sum(1).tolist())
    assert crossed < 0.01 * traced and {2, 3, 4, 5, 6} <= events


def test_the_skewness_of_a_ray_is_kept_by_a_rotational_body() -> None:
    """Bouguer: n times the moment about the axis of rotation is the same before and behind any chain of its faces."""
    body = collimator()
    rays = upwards(3000, 7, 0.7)
    grid = TableGrid(401)
    traced = TracedBundle.of(
        tables_of(body, grid), scene(body, clear(1.49, mirrors(0.9, side=CAVITY)), grid=grid), rays
    )
    exits = traced.exits
    left = traced.exits.fates == Fate.LEFT_LENS
    skew = [np.cross(*way)[left, 2] for way in ((rays.origins, rays.directions), (exits.points, exits.directions))]
    assert (traced.met[left] >= 0).sum(1).max() >= 4
    assert np.abs(skew[0] - skew[1]).max() < 7e-5  # of the tables; it falls with the third power of their step


def test_no_flux_is_lost_without_a_cause() -> None:
    body = collimator(0.05)
    rays = upwards(3000, 8, 0.5)
    tables = tables_of(body, GRID)
    plain = TracedBundle.of(tables, scene(body, clear(absorption=0.05), fresnel=False), rays).exits
    np.testing.assert_allclose(plain.flux + plain.absorbed, rays.flux, rtol=1e-12)
    for events, fate in ((1, Fate.EVENT_LIMIT), (2, Fate.TOTAL_REFLECTION)):
        few = TracedBundle.of(tables, scene(body, clear(), events=events, fresnel=False), rays).exits
        assert few.flux.sum() == pytest.approx(rays.flux.sum(), rel=1e-12)
        assert few.flux[few.fates == fate].sum() > 0.1 * rays.flux.sum()
    mirrored = clear(coatings=mirrors(0.9, wall=OUTSIDE))
    dark = TracedBundle.of(tables, scene(body, mirrored, events=2, fresnel=False), rays)
    assert np.array_equal(dark.exits.fates == Fate.EVENT_LIMIT, dark.met[:, 1] // 4 == NAMES.index("wall"))


def test_light_that_a_facet_sends_through_its_own_face_is_trapped() -> None:
    """Steep facets do so; no search for a face behind which it already is gives up, and the light is counted."""
    body = collimator(0.05)
    rays = upwards(20_000, 8, 0.5)
    media = replace(clear(), scatter=tuple(FaceScatter(name, GaussianFacets(0.3)) for name in ("wall", "exit")))
    few = rays.take(slice(0, 2000))
    traced = TracedBundle.of(tables_of(body, FINE), scene(body, media, grid=FINE), rays)
    assert not (traced.exits.fates == Fate.NOT_CONVERGED).any()
    after_two = (traced.exits.fates == Fate.EVENT_LIMIT) & (traced.met[:, 2] < 0)
    assert 0.001 < after_two.mean() < 0.1
    wanted = exactly({face.name: face.surface for face in body.faces}, scene(body, media, grid=FINE), few)
    assert np.mean(wanted.fates != traced.exits.fates[:2000]) < 0.002, "but at the edges of tables"


@pytest.mark.parametrize("events", [1, 2, 3, 6])
def test_a_mirror_absorbs_what_it_does_not_reflect_at_the_last_event_too(events: int) -> None:
    media = clear(coatings=mirrors(0.7, wall=OUTSIDE, side=CAVITY))
    body = collimator(0.05)
    rays = upwards(3000, 8, 0.5)
    traced = TracedBundle.of(tables_of(body, GRID), scene(body, media, events=events, fresnel=False), rays)
    left = 0.7 ** np.isin(traced.met // 4, [NAMES.index("side"), NAMES.index("wall")]).sum(axis=1)
    assert (traced.exits.fates[left < 1.0] == Fate.EVENT_LIMIT).sum() > (900 if events < 3 else 0)
    np.testing.assert_allclose(traced.exits.flux, left * rays.flux, rtol=1e-12)
    np.testing.assert_allclose(traced.exits.absorbed, (1.0 - left) * rays.flux, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("behind", [None, STEEP, lambertian(0.3)])
def test_the_usual_lens_is_a_chain_of_two_faces(behind: RingScatter | None) -> None:
    """The loop of the nearest face does as the sequence does, where no ray comes back; light spread behind it, too."""
    body = Body.of({"inner": sphere(3.0), "outer": sphere(6.0, 0.5)})
    rays = upwards(2000, 9, 0.5)
    tables = tables_of(body, GRID)
    media = clear(absorption=0.02)
    if behind is not None:
        media = replace(media, scatter=(FaceScatter("inner", GaussianFacets(0.05)), FaceScatter("outer", behind)))
    usual = TracedBundle.of(tables, Scene(media, GRID), rays)
    assert usual.met is None, "without fields"
    chained = TracedBundle.of(tables, scene(body, media, events=2), rays)
    assert np.array_equal(usual.exits.fates, chained.exits.fates)
    for name in ("points", "directions", "flux", "sin2_exit", "absorbed"):
        assert getattr(usual.exits, name) == pytest.approx(getattr(chained.exits, name), rel=1e-12, abs=1e-14), name
    by = np.random.default_rng(1).normal(size=(2000, 3))
    seen = np.random.default_rng(2).normal(size=2000)
    first, second = (traced.gradients(Sensitivities(by, by), seen, seen) for traced in (usual, chained))
    assert first == pytest.approx(second, rel=1e-9, abs=1e-12 * np.abs(first).max())


LEANING = [Face(name, PlaneFace(REACH, 9.0, (x, 0.0, 1.0)), BODY, OUTSIDE) for name, x in (("one", 1.0), ("two", -1.0))]
HOLED = [Face("shell", sphere(8.0), BODY, OUTSIDE), *LEANING, Face("third", ConeFace(REACH, 7.9), BODY, OUTSIDE)]
HIDDEN = [Face("shell", sphere(9.0), BODY, OUTSIDE), Face("top", PlaneFace(REACH, 10.0), BODY, OUTSIDE)]


@pytest.mark.parametrize(
    ("cavity", "envelope", "phrase"),
    [
        (4.0, [], "faces cap: none bounds the body; the body is not closed"),
        (5.0, [Face("exit", sphere(6.0, -2.0), BODY, OUTSIDE)], "wall = -0.99"),
        (4.0, HIDDEN, "top: nowhere the nearest seen from the origin"),
        (4.0, HOLED, "must be one piece without a hole"),
    ],
)
def test_faces_that_make_no_body_are_refused(cavity: float, envelope: list[Face], phrase: str) -> None:
    with pytest.raises(InputError) as error:
        Body((Face("cap", sphere(cavity), CAVITY, BODY), *envelope)).require_sound()
    assert phrase in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("events", [0, 65])
def test_a_number_of_events_that_cannot_be_followed_is_refused(events: int) -> None:
    with pytest.raises(InputError, match=f"events = {events}: must be 1 to 64"):
        collimator().chain(events)
