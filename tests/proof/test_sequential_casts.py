"""A lens with closed forms cast as facets, as a STEP file by the CAD kernel, and by Mitsuba, where it is installed."""

from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import cadquery as cq
import numpy as np
import pytest
from lens_meshes import lambertian, lens_mesh, oracle, snell, sphere
from nightly import first_by_day
from own_media import coatings, with_own

from lensforge.errors import InputError
from lensforge.optics.media import CoverGlass, Media, Medium, ReflectanceTable
from lensforge.proof import mitsuba_cast
from lensforge.proof.acceptance import brep_criteria
from lensforge.proof.facet_casting import Grid
from lensforge.proof.part_comparison import Expected, flux_budget
from lensforge.proof.part_mesh import part_mesh_of
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.sequential_cast import CastFate, send_through, send_through_body
from lensforge.proof.step_body import StepBody
from lensforge.proof.step_cast import cast_step, judge_brep
from lensforge.sources.ray_bundle import RayBundle

INDEX = 1.4936
DISTANCE = 150.0
SCREEN = Screen.square(DISTANCE, 300.0, 8)
# Neither centre is on the seam or the pole of the kernel's spheres as rays see them: both lie off the axis.
INNER = sphere(6.0, (0.3, -0.2, 0.0))
OUTER = sphere(13.0, (-0.4, 0.3, 0.0))
RAYS = lambertian(300, 2.0, seed=3)
HITS, WEIGHTS, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)


def ball(surface):
    return cq.Workplane().sphere(surface.semi_axes[0]).translate(surface.centre)


def written(shape, path):
    cq.exporters.export(shape, str(path))
    return path.read_bytes()


def step(path, outer=OUTER, scale=1.0):
    """The bytes of a dome with a cavity on a cylindrical base, built by the kernel's booleans."""
    return written(cq.Workplane(body_of(outer).val().scale(scale)), path)


def body_of(outer=OUTER):
    below = cq.Workplane().box(100.0, 100.0, 50.0).translate((0.0, 0.0, -25.0))
    bore = cq.Workplane().circle(6.0).extrude(-2.0).translate((INNER.centre[0], INNER.centre[1], 0.0))
    base = cq.Workplane().circle(16.0).extrude(-2.0)
    return ball(outer).cut(below).union(base).cut(ball(INNER)).cut(bore)


@pytest.fixture(scope="module")
def lens_step(tmp_path_factory):
    return step(tmp_path_factory.mktemp("brep") / "lens.step")


PART = part_mesh_of(lens_mesh(INNER.radius, OUTER.radius, 36, (16.0, 2.0)))


def cast_of(step_bytes):
    mesh = send_through(PART, Grid(PART.mesh), RAYS, Media(Medium(INDEX)))
    expected = Expected(SCREEN, np.ones((8, 8)), HITS, WEIGHTS)
    (cast,) = judge_brep(cast_step(step_bytes, RAYS, Media(Medium(INDEX)))(), RAYS, [expected], mesh)
    return cast


def test_a_step_is_held_against_the_way_in_the_mesh(lens_step):
    """A ray that met other faces there is of another fate; so is one that did in the design."""
    mesh = send_through(PART, Grid(PART.mesh), RAYS, Media(Medium(INDEX)))
    other = mesh.met.copy()
    way = np.tile([0, 1], (len(RAYS), 1))
    first, second, third = np.flatnonzero(SCREEN.on_pixels(HITS))[:3]
    other[first, 1] = way[second, 0] = way[third, 1] = -1
    expected = Expected(SCREEN, np.ones((8, 8)), HITS, WEIGHTS, met=way)
    step = cast_step(lens_step, RAYS, Media(Medium(INDEX)))()
    ((cast, _),) = judge_brep(step, RAYS, [expected], replace(mesh, met=other))
    assert (cast.against_design.fates, cast.against_mesh.fates) == (2, 1)


def failed(cast):
    return {criterion.key for criterion in brep_criteria(cast, DISTANCE) if not criterion.holds}


NO_MITSUBA = pytest.mark.skipif(find_spec("mitsuba") is None, reason="Mitsuba is not installed")
# By which a path of light is precise: 36 rings of facets, the CAD kernel, and normals that are interpolated.
PRECISION = {"mesh": 1e-5, "step": 1e-9, "mitsuba": 1e-3}


@pytest.fixture(params=["mesh", "step", pytest.param("mitsuba", marks=NO_MITSUBA)])
def caster(request, lens_step):
    """A cast of rays through the lens in given media, and its precision."""
    part = part_mesh_of(lens_mesh(INNER.radius, OUTER.radius, 60 if request.param == "mitsuba" else 36, (16.0, 2.0)))
    casts = {
        "mesh": partial(send_through, part, Grid(part.mesh)),
        "step": partial(send_through_body, StepBody(lens_step)),
        "mitsuba": lambda rays, media: mitsuba_cast.send_through_mitsuba(part, rays, media)[1],
    }
    return casts[request.param], PRECISION[request.param]


@pytest.mark.parametrize(
    "absorption", first_by_day(1, [None, np.linspace(0.0, 0.1, len(RAYS))]), ids=["one for all", "of each ray"]
)
def test_rays_lose_by_their_paths_in_the_body_what_the_law_says(caster, absorption):
    send, precision = caster
    entered = RAYS.origins + INNER.far_hit(RAYS.origins, RAYS.directions)[:, None] * RAYS.directions
    once = snell(RAYS.directions, INNER.normal(entered), 1.0 / INDEX)[1]
    rays = RAYS
    body = Medium(INDEX, 0.05)
    if absorption is not None:
        rays, body = with_own(RAYS, body, absorptions=absorption)
    clear = send(RAYS, Media(Medium(INDEX)))
    passage = send(rays, Media(body))
    left = clear.fates == CastFate.LANDED
    lost = -np.expm1(-(0.05 if absorption is None else absorption) * np.linalg.norm(clear.points - entered, axis=1))
    np.testing.assert_allclose(passage.flux[left], (clear.flux * (1.0 - lost))[left], rtol=precision)
    absorbed = (RAYS.flux * once * lost)[left]
    rough = max(1e-4, 10.0 * precision)
    np.testing.assert_allclose(passage.absorbed[left], absorbed, rtol=rough, atol=rough * absorbed.max())
    assert not clear.absorbed.any() and not passage.absorbed[passage.fates == CastFate.BASE].any()
    assert flux_budget(RAYS, passage.landed(SCREEN), SCREEN).absorbed == pytest.approx(
        passage.absorbed.sum() / RAYS.flux.sum(), rel=1e-12
    )


def test_gel_and_water_bend_the_rays_as_their_indices_say(caster):
    """Gel of the lens's own index: rays go straight on to the outer face, and are refracted there alone."""
    send, precision = caster
    ends = RAYS.origins + OUTER.far_hit(RAYS.origins, RAYS.directions)[:, None] * RAYS.directions
    directions, once = snell(RAYS.directions, OUTER.normal(ends), INDEX / 1.333)
    passage = send(RAYS, Media(Medium(INDEX), cavity_index=INDEX, outside_index=1.333))
    left = passage.fates == CastFate.LANDED
    assert left.sum() > 250
    np.testing.assert_allclose(passage.points[left], ends[left], atol=20.0 * precision)
    np.testing.assert_allclose(passage.directions[left], directions[left], atol=5.0 * precision)
    np.testing.assert_allclose(passage.flux[left], (RAYS.flux * once)[left], rtol=precision)


def test_coated_faces_let_pass_what_they_do_not_reflect(caster):
    """The coating of the inner face reflects by wavelength; those of the outer face and of the glass by a constant."""
    send, precision = caster
    rounding = 2e-6 if precision > 1e-4 else 1e-12  # Mitsuba's normals are of single precision
    inner = ReflectanceTable((0.0, 90.0), ((0.1, 0.1), (0.3, 0.3)), (400.0, 600.0))
    outer, of_glass = (ReflectanceTable((0.0, 90.0), ((share, share),)) for share in (0.05, 0.2))
    glass = CoverGlass(1.5, 2.0, 30.0, coating=of_glass)
    bare = Media(Medium(INDEX), cover_glass=CoverGlass(1.5, 2.0, 30.0))
    media = replace(bare, coatings=coatings(inner, outer), cover_glass=glass)
    waves = np.random.default_rng(1).uniform(400.0, 600.0, len(RAYS))
    rays = RAYS.with_wavelengths(waves)
    at_lens = rays.flux * (0.9 - 0.2 * (waves - 400.0) / 200.0) * 0.95
    passage = send(rays, media)
    was = send(rays, bare)
    np.testing.assert_array_equal(passage.fates, was.fates)
    np.testing.assert_array_equal(passage.points, was.points)
    left = passage.fates == CastFate.LANDED
    np.testing.assert_allclose(passage.flux[left], (at_lens * 0.8**2)[left], rtol=rounding)
    np.testing.assert_allclose(passage.in_glass[left], (at_lens * (1.0 - 0.8**2))[left], rtol=rounding)


def test_rays_with_an_index_each_go_as_if_the_lens_had_it(caster):
    send, _ = caster
    indices = np.where(np.arange(len(RAYS)) % 2, 1.45, 1.55)
    rays, body = with_own(RAYS, Medium(INDEX), indices)
    mixed = send(rays, Media(body))
    for index in (1.45, 1.55):
        alone = send(RAYS, Media(Medium(index)))
        rows = indices == index
        for name in ("points", "directions", "flux"):
            np.testing.assert_array_equal(getattr(mixed, name)[rows], getattr(alone, name)[rows])


def test_rays_that_cannot_pass_say_why(caster):
    start = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.0], [40.0, 0.0, 0.5], [0.0, 0.0, 20.0], [0.3, 5.3, 0.3]])
    towards = np.array([[0.999, 0.0, -0.0447], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.1, 0.0, -1.0], [1.0, 0.0, -0.1]])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    passage = caster[0](RayBundle(start, towards, np.ones(5)), Media(Medium(INDEX)))
    fates = [CastFate.OPENING, CastFate.STARTS_INSIDE, CastFate.NO_HIT, CastFate.STARTS_OUTSIDE, CastFate.BASE]
    assert passage.fates.tolist() == fates


def test_the_kernel_lands_every_ray_where_the_closed_form_does(lens_step):
    passage = send_through_body(StepBody(lens_step), RAYS, Media(Medium(INDEX))).landed(SCREEN)
    landed = passage.fates == CastFate.LANDED
    np.testing.assert_array_equal(landed, np.isfinite(HITS[:, 0]))
    assert landed.sum() > 250
    np.testing.assert_allclose(passage.landings[landed], HITS[landed], rtol=0.0, atol=1e-8 * DISTANCE)
    np.testing.assert_allclose(passage.flux[landed], WEIGHTS[landed], rtol=1e-9)


def test_the_step_is_nearer_to_the_design_than_the_mesh(lens_step):
    cast, gaps = cast_of(lens_step)
    assert cast.rays == len(RAYS)
    assert failed(cast) == set()
    assert cast.against_design.rms < 1e-6
    assert cast.against_mesh.rms > 100.0 * cast.against_design.rms
    assert gaps[-1] == cast.against_design.max


def test_a_step_whose_faces_another_program_has_split_casts_the_same(tmp_path, lens_step):
    """Split at y = 0, where rays cross from one half of a face to the other."""
    half = cq.Workplane().box(100.0, 50.0, 100.0)
    one, other = (body_of().intersect(half.translate((0.0, side, 0.0))) for side in (25.0, -25.0))
    whole = StepBody(lens_step)
    split = StepBody(written(one.union(other, clean=False), tmp_path / "split.step"))
    np.testing.assert_allclose(split.size().volume_mm3, whole.size().volume_mm3, rtol=1e-7)
    np.testing.assert_allclose(split.size().bounds_mm, whole.size().bounds_mm, rtol=0.0, atol=1e-5)
    passage, wanted = (send_through_body(body, RAYS, Media(Medium(INDEX))) for body in (split, whole))
    np.testing.assert_array_equal(passage.fates, wanted.fates)


WRONG = {
    "scaled": {"scale": 1.01},
    "in inches": {"scale": 1 / 25.4},
    "outer 20 um to +x": {"outer": sphere(13.0, (-0.38, 0.3, 0.0))},
    "outer 20 um thicker": {"outer": sphere(13.02, OUTER.centre)},
}


@pytest.mark.parametrize("name", first_by_day(2, WRONG, "other ways to be wrong"))
def test_a_wrong_step_fails(tmp_path, name):
    assert "brep_deviation_rms" in failed(cast_of(step(tmp_path / "lens.step", **WRONG[name]))[0])


def test_what_is_no_solid_is_input_error(tmp_path):
    for content in (b"", b"not a STEP file"):
        with pytest.raises(InputError, match=r"STEP: (not readable|holds 0 solids)"):
            StepBody(content)
    two = cq.Workplane().box(1, 1, 1).add(cq.Workplane().box(1, 1, 1).translate((5, 0, 0)))
    with pytest.raises(InputError, match="STEP: holds 2 solids"):
        StepBody(written(two, tmp_path / "two.step"))
