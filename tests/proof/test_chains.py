"""Bodies of four faces, cast event by event as facets, as STEP files and by Mitsuba, against closed forms."""

from collections import Counter
from dataclasses import replace
from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest
from chains import clear
from creased_bodies import (
    BALL,
    CAP,
    INDEX,
    OF_BALL,
    OF_CONE,
    OF_PARABOLOID,
    OPTICAL,
    SIDE,
    body_of,
    follow_exactly,
    mesh_of,
    rays_from,
    solid_of,
    sphere,
)
from lens_meshes import right
from nightly import first_by_day

from lensforge.errors import InputError
from lensforge.light.light_ways import FluxByWay
from lensforge.light.simulation import TracedLens
from lensforge.optics.face_roles import OUTSIDE
from lensforge.optics.media import FaceCoating, FaceScatter, Media, Medium, Mirror, ReflectanceTable
from lensforge.optics.scattering import GaussianFacets, lambertian
from lensforge.proof.facet_casting import Grid
from lensforge.proof.mitsuba_cast import send_through_mitsuba
from lensforge.proof.nonsequential_trace import Cause, Limits, PartBody, follow, trace_stray
from lensforge.proof.optical_faces import NO_FACE, USUAL_LENS, OpticalFaces, faces_away
from lensforge.proof.part_comparison import Expected, flux_budget
from lensforge.proof.part_mesh import part_mesh_of, smooth_faces
from lensforge.proof.proof_inputs import optical_of
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.sequential_cast import CastFate, send_through, send_through_body
from lensforge.proof.step_body import StepBody
from lensforge.proof.verification import FilesOfPart, LightOfDesign, Referees, passage_through, verify_part
from lensforge.scene import body as scene
from lensforge.scene.rough_faces import with_facets
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces import asphere
from lensforge.surfaces.reciprocal import ConeFace, PlaneFace

RAYS = rays_from(200, 1.0)
SILVERED = (FaceCoating("wall", OUTSIDE, Mirror(0.8)),)
SCREEN = Screen.square(150.0, 300.0, 8)
NO_MITSUBA = pytest.mark.skipif(find_spec("mitsuba") is None, reason="Mitsuba is not installed")
CONE_FACES = PlaneFace(24.0, 2.5), asphere.sphere(3.0), ConeFace(24.0, 6.0, 1.0), PlaneFace(24.0, 10.0)
CONE = (OF_CONE, (), None)
BRIGHT_BALL = (OF_BALL, SILVERED, {"wall": 0.8})


@cache
def exact(name, events, absorption=0.0):
    body, _, mirrors = {"cone": CONE, "ball": BRIGHT_BALL}[name]
    return follow_exactly(body, RAYS, events, mirrors=mirrors, absorption=absorption)


@cache
def part_of(name, count, events):
    body = {"cone": OF_CONE, "ball": OF_BALL, "paraboloid": OF_PARABOLOID}[name]
    part = part_mesh_of(mesh_of(body, count), optical_of(body, events))
    return part, Grid(part.mesh)


@cache
def step_of(name):
    return solid_of({"cone": OF_CONE, "ball": OF_BALL}[name], OPTICAL)


def test_the_oracle_sees_every_kind_of_chain():
    chains = Counter(exact("cone", 3).chains)
    assert min(chains[chain] for chain in ("CE", "SE", "SwE", "SeW")) > 10
    assert exact("ball", 6).inside.sum() < exact("ball", 3).inside.sum()


@pytest.mark.parametrize(("coatings", "events"), first_by_day(1, [(SILVERED, 6), ((), 3)]))
def test_the_ways_of_the_light_are_those_of_every_ray(coatings, events):
    """The share of each way, and of all that leaves by the wall, with their errors."""
    lens = TracedLens.of_body(body_of(*CONE_FACES), clear(INDEX, coatings), events, 12.0)
    by_way = FluxByWay.none_yet(lens.scene.chain, 4)
    shares = Counter()
    for k, rays in enumerate(RAYS.take(slice(first, first + 50)) for first in (0, 50, 100, 150)):
        for half in (0.5, 0.5):
            by_way.add(k, half, lens.trace(rays))
        wanted = follow_exactly(OF_CONE, rays, events, mirrors={"wall": 0.8} if coatings else None)
        for chain, flux in zip(wanted.chains, wanted.flux, strict=True):
            if chain[-1] in "EW":
                shares[chain.upper() if chain[-1] == "E" else "W", k] += 4.0 * flux
    ways = {"".join(face[0] for face in way.faces).upper(): way.share for way in by_way.ways(0.25)}
    assert set(ways) == {way for way, _ in shares} | {"W"} and len(ways) == (5 if coatings else 4)
    for way, share in ways.items():
        samples = np.array([shares[way, k] for k in range(4)])
        assert share.value == pytest.approx(samples.mean(), rel=1e-3)
        assert share.standard_error == pytest.approx(samples.std(ddof=1) / 2.0, rel=1e-2, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "events", "absorption"),
    first_by_day(
        2,
        [("cone", 3, 0.05), ("ball", 4, 0.0), ("cone", 3, 0.0), ("ball", 4, 0.05)]
        + [(name, events, absorption) for name, events in (("ball", 6), ("cone", 2)) for absorption in (0.0, 0.05)],
        "other chains",
    ),
)
def test_the_kernel_sends_every_ray_along_its_chain(name, events, absorption):
    wanted = exact(name, events, absorption)
    (body, coatings, _) = {"cone": CONE, "ball": BRIGHT_BALL}[name]
    media = clear(INDEX, coatings, absorption)
    passage = send_through_body(StepBody(step_of(name), optical_of(body, events)), RAYS, media)
    out = np.isfinite(wanted.points[:, 0])
    # The oracle ends where a ray comes back to the cavity; the cast follows it through, where there are events left.
    told = ~np.array([chain.endswith("c") and len(chain) + 2 <= events for chain in wanted.chains])
    assert told.all() or (events == 6 and told.sum() > 0.6 * len(told))
    np.testing.assert_array_equal((passage.fates == CastFate.LANDED)[told], out[told])
    lost = [CastFate.TOTAL_REFLECTION, CastFate.EVENT_LIMIT]
    np.testing.assert_array_equal(np.isin(passage.fates, lost)[told], wanted.inside[told])
    by_mirror = wanted.inside & np.array([chain.endswith("w") and name == "ball" for chain in wanted.chains])
    np.testing.assert_array_equal((passage.fates == CastFate.EVENT_LIMIT)[told], by_mirror[told])
    np.testing.assert_allclose(passage.points[out], wanted.points[out], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(passage.directions[out], wanted.directions[out], rtol=0.0, atol=1e-10)
    kept = out | wanted.inside  # with the flux that is left in it, polarised by all that it has met
    np.testing.assert_allclose(passage.flux[kept], wanted.flux[kept], rtol=1e-9)
    if absorption == 0.0:
        np.testing.assert_allclose(passage.absorbed[told], wanted.in_mirrors[told], rtol=1e-9, atol=1e-15)


def test_light_ends_at_a_flange_with_what_the_face_before_has_left():
    optical = optical_of(OF_BALL, 4)
    optical = replace(optical, flange_face=optical.names.index("wall"))
    clear, dim = (
        send_through_body(StepBody(step_of("ball"), optical), RAYS, Media(Medium(INDEX, absorption)))
        for absorption in (0.0, 0.05)
    )
    at_flange = np.array(["w" in chain.lower() for chain in exact("ball", 4).chains])
    assert 20 < at_flange.sum() < 180
    np.testing.assert_array_equal(clear.fates == CastFate.FLANGE, at_flange)
    np.testing.assert_array_equal(dim.fates, clear.fates)
    np.testing.assert_array_equal(dim.flux[at_flange], clear.flux[at_flange])
    assert (0.5 * RAYS.flux < dim.flux)[at_flange].all() and not dim.absorbed[at_flange].any()
    assert (dim.absorbed[dim.fates == CastFate.LANDED] > 0.0).all()


@pytest.mark.parametrize(("name", "events", "precision"), [("cone", 3, 3e-3), ("ball", 4, 2e-5)])
def test_facets_send_every_ray_along_its_chain(name, events, precision):
    wanted = exact(name, events)
    media = clear(INDEX, {"cone": (), "ball": SILVERED}[name])
    out = np.isfinite(wanted.points[:, 0])
    errors = []
    for count in (30, 60):
        part, grid = part_of(name, count, events)
        assert part.far == 0 and part.open_edges == 0
        passage = send_through(part, grid, RAYS, media)
        assert np.mean((passage.fates == CastFate.LANDED) != out) < 0.01
        both = out & (passage.fates == CastFate.LANDED)
        errors.append(np.sqrt(np.mean((passage.directions - wanted.directions)[both] ** 2)))
        np.testing.assert_allclose(passage.flux[both].sum(), wanted.flux[both].sum(), rtol=1e-4)
    assert errors[1] < precision and errors[1] < 0.3 * errors[0]


@pytest.mark.parametrize("model", [GaussianFacets(0.1), lambertian(0.8)])
def test_rays_that_meet_a_rough_face_again_go_as_in_the_design(model):
    """Facets and rings about a mirror, ray by ray with the numbers of the design; the proof draws other numbers."""
    rough = FaceScatter("exit", GaussianFacets(0.05)), FaceScatter("wall", model)
    media = replace(clear(INDEX, SILVERED), scatter=rough)
    rays = with_facets(RAYS, 2)
    optical = optical_of(OF_CONE, 6)
    design = TracedLens.of_body(body_of(*CONE_FACES), media, 6, 12.0).trace(rays)
    again = (design.met == optical.names.index("wall")).sum(axis=1) > 1
    assert again.mean() > 0.05, "by which this is seen"
    body = StepBody(step_of("cone"), optical)
    same, anew = (send_through_body(body, rays, media, seed) for seed in (None, 5))
    alike = (same.met == np.where(design.met < 0, NO_FACE, design.met)).all(axis=1)
    assert np.mean(alike) > 0.9 and np.mean(alike[again]) > 0.8, "but at the edges of tables"
    out = alike & design.left_lens & (same.fates == CastFate.LANDED)
    assert (out & again).sum() > 2
    assert np.abs(same.directions - design.directions)[out].max() < 5e-3
    assert np.abs(same.flux - design.flux)[out].max() < 5e-3
    assert np.mean((anew.met == same.met).all(axis=1)) < 0.9


def test_a_paraboloid_sends_the_light_of_its_focus_along_the_axis():
    """By total reflection, its last face met at right angles: flux and directions in closed form."""
    rays = rays_from(3000, 0.0, seed=2)
    part, grid = part_of("paraboloid", 60, 3)
    passage = send_through(part, grid, rays, Media(Medium(INDEX)))
    assert (passage.fates == CastFate.LANDED).all()
    cosine = rays.directions[:, 2]
    by_wall = cosine < 0.62  # the crease is at 0.625
    np.testing.assert_allclose(passage.directions[by_wall], np.tile([0.0, 0.0, 1.0], (by_wall.sum(), 1)), atol=1e-4)
    radius = 6.0 / (1.0 - cosine[by_wall, None])
    np.testing.assert_allclose(passage.points[by_wall, :2], (radius * rays.directions[by_wall, :2]), atol=1e-3)
    once = 4.0 * INDEX / (1.0 + INDEX) ** 2
    np.testing.assert_allclose(passage.flux[by_wall], rays.flux[by_wall] * once**2, rtol=1e-6)


@pytest.mark.parametrize("name", ["cone", "ball"])
def test_bouguers_invariant_holds_along_the_chain(name):
    """``n r sin`` about the axis: n (x dy - y dx), 1 before and behind bodies of revolution, whatever they reflect."""
    body = {"cone": OF_CONE, "ball": OF_BALL}[name]
    passage = passage_through(step_of(name), optical_of(body, 6), Media(Medium(INDEX)), RAYS)
    out = passage.fates == CastFate.LANDED
    assert out.sum() > 150

    def invariant(points, directions):
        return points[:, 0] * directions[:, 1] - points[:, 1] * directions[:, 0]

    before = invariant(RAYS.origins, RAYS.directions)
    behind = invariant(passage.points, passage.directions)
    np.testing.assert_allclose(behind[out], before[out], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["cone", "ball"])
def test_all_flux_is_accounted_for_and_the_path_of_the_cast_is_no_stray_light(name):
    part, grid = part_of(name, 30, 4)
    media = clear(INDEX, {"cone": (), "ball": SILVERED}[name], 0.01)
    budget = follow(PartBody(part, grid, media), RAYS, Limits(cut_off=1e-6, depth=40))
    escaped = budget.escaped()
    passage = send_through(part, grid, RAYS, media)
    total = escaped.flux.sum() + budget.absorbed + budget.base + budget.cut_off + budget.leaked
    assert total == pytest.approx(1.0, abs=1e-12) and budget.base == 0.0
    sequential = escaped.flux[escaped.causes == Cause.SEQUENTIAL].sum()
    assert sequential == pytest.approx(passage.flux[passage.fates == CastFate.LANDED].sum(), rel=1e-9)
    assert sequential > 0.25 and (escaped.causes == Cause.OUTER_REFLECTION).any()


def test_the_event_limit_is_a_fate_of_their_own_with_its_flux():
    part, grid = part_of("ball", 30, 3)
    media = clear(INDEX, SILVERED)
    passage = send_through(part, grid, RAYS, media)
    budget = flux_budget(RAYS, passage.landed(SCREEN), SCREEN)
    ends = passage.fates == CastFate.EVENT_LIMIT
    assert budget.event_limit == pytest.approx(passage.flux[ends].sum(), rel=1e-12) and budget.event_limit > 0.1
    total = passage.fates == CastFate.TOTAL_REFLECTION
    assert budget.total_reflection == pytest.approx(passage.flux[total].sum(), rel=1e-12)
    assert sum(budget.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(InputError, match=r"events = 1: .* must be >= 2"):
        optical_of(OF_CONE, 1)


def test_names_in_the_file_say_which_face_it_is_and_shapes_where_there_are_none():
    media = clear(INDEX, SILVERED)
    optical = optical_of(OF_BALL, 4)
    rays = RAYS.take(slice(0, 60))
    swapped = OPTICAL | {"wall": "OPTICAL_EXIT", "exit": "OPTICAL_WALL"}
    named, bare, other = (
        passage_through(solid_of(OF_BALL, names), optical, media, rays) for names in (OPTICAL, {}, swapped)
    )
    np.testing.assert_array_equal(named.fates, bare.fates)
    np.testing.assert_array_equal(named.flux, bare.flux)
    assert (named.absorbed > 0.0).any()
    up = rays.directions[:, 2] > 0.95  # straight to the exit, that bears the wall's name
    assert not named.absorbed[up].any() and (other.absorbed[up] > 0.0).all()


def test_facets_of_another_body_are_counted():
    mesh = part_mesh_of(mesh_of(OF_BALL, 16), optical_of(OF_CONE))
    assert mesh.far > 100


def test_a_shallow_crease_is_no_smooth_face():
    body = body_of(CAP, SIDE, BALL, sphere(12.0, -0.5))
    mesh = mesh_of(body, 40)
    optical = optical_of(body)
    part = part_mesh_of(mesh, optical)
    assert len(np.unique(smooth_faces(mesh))) == len(np.unique(part.faces)) - 1
    for number, face in enumerate(body.faces):
        rows = np.unique(part.corners[part.faces == number])
        places = np.zeros((len(part.fit.fitted), 3))
        places[part.corners.ravel()] = mesh.vertices[mesh.faces.ravel()]
        exactly = face.surface.normal_at(places[rows]) * (1.0 if optical.away[number] else -1.0)
        assert np.abs(part.fit.fitted[rows] - exactly).max() < 2e-3, face.name


def test_the_usual_lens_is_the_case_of_two_faces_and_two_events():
    assert optical_of(scene.Body.of({"inner": asphere.sphere(3.0), "outer": asphere.sphere(6.0)})) == USUAL_LENS
    part = part_mesh_of(right(20))
    low = part.mesh.triangles_center[:, 2] <= 0.0
    away = faces_away(part.mesh.triangles_center, part.mesh.face_normals)
    np.testing.assert_array_equal(part.faces, np.where(low, -1, np.where(away, 1, 0)))


def test_total_reflection_on_the_way_in_keeps_the_flux_of_the_ray():
    """In gel denser than the body; the design's fate is the same."""
    part = part_mesh_of(right(20))
    ray = RayBundle(np.array([[0.0, 0.0, 4.5]]), np.array([[1.0, 0.0, 0.0]]), np.ones(1))
    passage = send_through(part, Grid(part.mesh), ray, Media(Medium(1.05), cavity_index=1.7))
    assert passage.fates[0] == CastFate.TOTAL_REFLECTION and passage.flux[0] == 1.0


def test_a_mirror_takes_what_it_does_not_reflect_and_a_table_splits_the_light():
    """Of the outer face, from the middle of a ball: once the mirror, once a coating of the same reflectance."""
    part = part_mesh_of(right(30), OpticalFaces(events=4))
    ray = RayBundle(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1))
    silver = Mirror(0.3)
    table = ReflectanceTable((0.0, 90.0), ((0.3, 0.3),))
    first, second = (
        send_through(
            part, Grid(part.mesh), ray, Media(Medium(INDEX), coatings=(FaceCoating("outer", OUTSIDE, coating),))
        )
        for coating in (silver, table)
    )
    entered = second.flux[0] / 0.7
    # back through the cavity, and out of its opening
    assert first.fates[0] == CastFate.NO_HIT and second.fates[0] == CastFate.LANDED
    assert first.flux[0] == pytest.approx(0.3 * entered**2, rel=1e-3)
    assert first.absorbed[0] == pytest.approx(0.7 * entered, rel=1e-12)


@pytest.mark.parametrize("mitsuba_rays", [0, pytest.param(200, marks=NO_MITSUBA)])
def test_every_referee_verifies_a_body_of_four_faces(mitsuba_rays):
    wanted = exact("cone", 3)
    optical = optical_of(OF_CONE, 3)
    hits = SCREEN.land(wanted.points, wanted.directions)
    expected = Expected(SCREEN, SCREEN.irradiance(hits, wanted.flux), hits, wanted.flux)
    stl = mesh_of(OF_CONE, 60).export(file_type="stl")
    light = LightOfDesign(RAYS, Media(Medium(INDEX)), [expected], optical=optical)
    proof = verify_part(FilesOfPart(stl, step_of("cone")), light, Referees(20, 100, mitsuba_rays))
    assert proof.first.brep.against_design.max < 1e-6 and proof.first.brep.against_design.fates == 0
    assert proof.first.against_design.compared > 100 and proof.first.against_design.rms < 0.3
    assert (proof.plain_cast.disagreements, proof.far_facets, proof.open_edges) == (0, 0, 0)
    assert sum(proof.first.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    if mitsuba_rays:
        assert proof.first.mitsuba.against_design.rms < 0.5 and proof.first.mitsuba.against_design.fates < 4
    stray = trace_stray(stl, rays=RAYS, media=Media(Medium(INDEX)), screens=[SCREEN], optical=optical)
    assert stray.first.balance_error < 1e-12
    assert stray.first.flux.detected_direct == pytest.approx(stray.first.efficiency_sequential, rel=1e-9)


@NO_MITSUBA
@pytest.mark.parametrize("name", ["cone", "ball"])
def test_mitsuba_sends_every_ray_along_its_chain(name):
    wanted = exact(name, 4)
    media = clear(INDEX, {"cone": (), "ball": SILVERED}[name])
    passage = send_through_mitsuba(part_of(name, 60, 4)[0], RAYS, media)[1]
    out = np.isfinite(wanted.points[:, 0])
    assert np.mean((passage.fates == CastFate.LANDED) != out) < 0.02
    both = out & (passage.fates == CastFate.LANDED)
    assert np.median(np.abs(passage.directions - wanted.directions)[both]) < 1e-3
    np.testing.assert_allclose(passage.flux[both].sum(), wanted.flux[both].sum(), rtol=1e-3)
