"""The light of lenses among opaque bodies: halves, budgets, a limit, and the same shadows by code that shares none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from presets import FEW
from scenes import small_spec

import lensforge as lf
from lensforge.light.evaluation import measure_preset
from lensforge.light.exit_light import exit_rays
from lensforge.light.lens_light import searched_source
from lensforge.light.light_facts import light_facts
from lensforge.light.simulation import TracedLens
from lensforge.made.yield_study import measure_yield
from lensforge.proof.proof_inputs import screens_of
from lensforge.proof.sequential_cast import CastFate, Passage
from lensforge.scene.body_view import body_views
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.eye_view import eye_views
from lensforge.scene.housing import Housing
from lensforge.scene.light_ends import LOSSES
from lensforge.scene.possible_light import SourceLight
from lensforge.scene.receiver_shapes import receivers_of, seen_by_lamp
from lensforge.search.merit import MeritFunction
from lensforge.search.parameters import Parametrisation
from lensforge.search.problem import Problems
from lensforge.search.scene_check import light_requirements
from lensforge.search.start_faces import start_faces
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec

HALF = {"kind": "box", "name": "half", "size_mm": [400.0, 900.0, 2.0], "centre_mm": [200.0, 0.0, 40.0]}
BEZEL = {
    "kind": "cylinder", "name": "bezel", "radius_mm": 70.0, "bore_radius_mm": 12.0, "length_mm": 3.0,
    "centre_mm": [2.0, -3.0, 25.0], "tilt_deg": [12.0, -9.0], "rotate_z_deg": 20.0,
}  # fmt: skip
POST = {
    "kind": "box", "name": "post", "size_mm": [6.0, 9.0, 60.0], "centre_mm": [9.0, -12.0, 45.0],
    "tilt_deg": [-25.0, 14.0], "rotate_z_deg": 35.0,
}  # fmt: skip
LIMIT = {"kind": "blocked", "at_most_share": 0.1}
MIRROR = {"surface": "mirror", "reflectance": 0.85}
WHITE = {"surface": "diffuse", "reflectance": 0.7}
GLASSY = {"surface": "clear", "refractive_index": 1.47, "absorption_per_mm": 0.01}
# Around the lens, from below its top, so that much light meets the bore.
RING = {
    "kind": "cylinder", "name": "ring", "radius_mm": 40.0, "bore_radius_mm": 17.0, "length_mm": 30.0,
    "centre_mm": [1.0, -0.7, 34.0], "tilt_deg": [4.0, -6.0],
}  # fmt: skip


def lens_of(spec: Spec) -> lf.Lens:
    return lf.Lens(start_faces(spec), spec, 0, FEW)


def light_of(*scene: dict[str, Any], **more: Any) -> tuple[lf.Light, lf.Lens]:
    lens = lens_of(small_spec(scene=list(scene), **more))
    return lf.evaluate(lens, rays=2**14), lens


def test_a_wall_over_a_half_takes_half_of_the_light() -> None:
    """Of a lens with the mirrors of the wall: half of what lands, half of what leaves; the budget stays whole."""
    free, _ = light_of()
    light, lens = light_of(HALF, limits=[LIMIT])
    (whole,) = free.receivers
    (half,) = light.receivers
    error = 4.0 * (half.efficiency.standard_error or 0.0)
    assert half.efficiency.value == pytest.approx(0.5 * whole.efficiency.value, abs=error)
    # Light that leaves along the wall passes below it.
    assert half.flux.housing == pytest.approx(0.5 * (whole.flux.detected + whole.flux.outside), abs=0.01)
    assert sum(half.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    (blocked,) = half.blocked
    assert (blocked.name, blocked.share.value) == ("half", pytest.approx(half.flux.housing))
    x, y, z = blocked.place_mm
    assert x > 0.0 and abs(y) < 1.0 and z == pytest.approx(39.0, abs=0.1)
    (limit,) = light.limits
    assert limit.value == pytest.approx(half.flux.housing) and limit.state == "fail"
    told = [fact for group in light_facts(light, lens) for fact in group.facts if fact.key == "blocked"]
    assert [fact.value for fact in told] == [pytest.approx(100.0 * half.flux.housing)]
    assert told[0].note.startswith("by half, about (")


def test_two_bodies_share_what_they_block() -> None:
    """In the order in which light meets them: what the bezel leaves, the post behind it may take."""
    alone = light_of(BEZEL)[0].receivers[0]
    both = light_of(BEZEL, POST)[0].receivers[0]
    shares = {body.name: body.share.value for body in both.blocked}
    assert set(shares) == {"bezel", "post"} and sum(shares.values()) == pytest.approx(both.flux.housing)
    assert 0.0 < both.flux.housing - alone.flux.housing <= shares["post"]
    assert all((body.share.standard_error or 0.0) > 0.0 for body in both.blocked)


def test_what_each_of_two_bodies_blocks_and_where_is_told_by_its_own_name() -> None:
    """Walls of unequal size on both sides; the second blocks more."""
    small = HALF | {"name": "left", "size_mm": [400.0, 900.0, 2.0], "centre_mm": [-215.0, 0.0, 40.0]}
    light, _ = light_of(small, HALF | {"name": "right"})
    (receiver,) = light.receivers
    left, right = receiver.blocked
    assert (left.name, right.name) == ("left", "right")
    assert 0.05 < left.share.value < 0.8 * right.share.value
    assert left.place_mm[0] < -15.0 and right.place_mm[0] > 0.0


def test_a_search_fades_light_beside_rims_by_the_angle_of_the_spec() -> None:
    """On receivers and in the view of an eye: bodies seem larger by half of it, so that less light lands."""
    eye = {"kind": "luminance", "at_most": 1e9, "unit": "cd_per_m2", "eyes_mm": [[140.0, -20.0, 380.0]], "spot_mm": 2.0}
    source = searched_source(small_spec())
    landed = []
    for rim_deg in (0.1, 3.0):
        spec = small_spec(scene=[BEZEL], optimise__rim_deg=rim_deg, limits=[eye], source__flux_lm=100.0)
        problem = Problems(spec, source, 3.0, None, False).of((9,))
        merit = problem.merit
        assert isinstance(merit, MeritFunction) and isinstance(problem.parametrisation, Parametrisation)
        tables = problem.parametrisation.tables(*problem.parametrisation.start())
        light = merit.light_of(tables, source.sample(2**12, 5))
        landed.append([float(image.sum()) for image in light.images])
    assert all(wide < 0.99 * narrow for narrow, wide in zip(*landed, strict=True))


def test_a_body_beyond_an_eye_blocks_none_of_its_view() -> None:
    """One nearer than the eye does, also in the second half of the way."""
    plate = {"kind": "box", "name": "plate", "size_mm": [900.0, 900.0, 1.0]}
    eye = {"kind": "luminance", "at_most": 1e9, "unit": "cd_per_m2", "eyes_mm": [[5.0, -3.0, 120.0]], "spot_mm": 1.0}
    seen = []
    for height_mm in (100.0, 140.0):
        spec = small_spec(scene=[plate | {"centre_mm": [0.0, 0.0, height_mm]}], limits=[eye], source__flux_lm=100.0)
        (view,) = eye_views(spec)
        points = np.array([[0.5, 0.2, 8.0], [-1.0, 0.4, 7.5]])
        directions = np.array([5.0, -3.0, 120.0]) - points
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        exits = ExitRays(points, directions, np.ones(2), np.zeros(2), np.zeros(2, dtype=np.int8))
        seen.append(view.land(exits).landed.tolist())
    assert seen == [[False, False], [True, True]]


def test_the_far_field_and_the_evaluation_block_the_same() -> None:
    """All that leaves meets the wall or goes on; on a plane before the wall nothing is lost."""
    lens = lens_of(small_spec(scene=[BEZEL]))
    far = lf.photometry(lens, rays=2**14).lost_w.housing / searched_source(lens.spec).flux_w
    (near,) = lf.evaluate(lens, rays=2**14).receivers
    assert far == pytest.approx(near.flux.housing, abs=0.01) and far > 0.05
    before = lens_of(small_spec(scene=[{**BEZEL, "centre_mm": [2.0, -3.0, 300.0]}]))
    assert lf.evaluate(before, rays=2**12).receivers[0].flux.housing == 0.0


LAMPS = {"kind": "table", "places_mm": [[-20.0, 3.0], [18.0, -2.0, 5.0]], "turns_deg": [30.0, 200.0]}


@pytest.mark.parametrize(
    "surfaces", [({}, {}), (WHITE, MIRROR), (GLASSY, MIRROR)], ids=["black", "white and mirror", "clear and mirror"]
)
@pytest.mark.parametrize("lamps", [None, LAMPS], ids=["one lamp", "the second of two lamps"])
@pytest.mark.parametrize("events", [1, 4])
def test_the_proof_has_the_shadows_of_the_design(
    lamps: dict[str, Any] | None, surfaces: tuple[dict[str, Any], dict[str, Any]], events: int
) -> None:
    """Ray by ray, through a grid in the place of a tree, turned by other rotations; what bodies reflect, too."""
    spec = small_spec(scene=[BEZEL | surfaces[0], POST | surfaces[1]], scene_events=events, lamps=lamps)
    if lamps is not None:
        spec = seen_by_lamp(spec, 1)
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(4000, 3)) * [0.5, 0.5, 0.0] + [0.0, 0.0, 1.0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = 5.0 * directions + rng.normal(size=(4000, 3))
    flux = rng.random(4000)
    draws = rng.random((4000, 2 * events))
    exits = ExitRays(points, directions, flux, flux, np.zeros(4000, dtype=np.int8), draws=draws)
    passage = replace(
        Passage.of(RayBundle(points, directions, flux), 0), points=points, directions=directions, draws=draws,
        fates=np.full(4000, CastFate.LANDED),
    )  # fmt: skip
    for receiver, screen in zip(receivers_of(spec, 16), screens_of(spec), strict=True):
        designed = receiver.land(exits)
        cast = passage.landed(screen)
        assert designed.shadow is not None and 200 < designed.shadow.met.sum() < 3800
        assert ((cast.fates == CastFate.HOUSING) == (designed.shadow.onward == 0.0)).all()
        assert ((cast.fates == CastFate.SECOND_WALL) == designed.shadow.again).all()
        assert ((cast.fates == CastFate.MISSED_RECEIVER) == designed.missed_receiver).all()
        assert cast.flux == pytest.approx(flux * designed.shadow.onward)
        reflects = bool(surfaces[0])
        assert (designed.landed & designed.shadow.met).any() == reflects
        assert designed.shadow.again.any() == reflects or events > 1
        assert (len(designed.legs) > 2) == (reflects and events > 1)
        assert cast.landings[designed.landed] == pytest.approx(designed.hits[designed.landed], rel=1e-9, abs=1e-8)
        assert np.isnan(cast.landings[~designed.landed]).all()


@pytest.mark.parametrize("lamps", [None, LAMPS], ids=["one lamp", "two lamps"])
def test_a_search_counts_what_is_blocked_as_the_evaluation_does(lamps: dict[str, Any] | None) -> None:
    """With a narrow rim; light beside the window is without it."""
    limits = [LIMIT, {"kind": "loss", "cause": "beside", "at_most_share": 0.2}]
    scene = [BEZEL, POST | {"centre_mm": [9.0, -12.0, 60.0]}]
    spec = small_spec(scene=scene, limits=limits, lamps=lamps, optimise__rim_deg=0.01)
    source = searched_source(spec)
    problem = Problems(spec, source, 3.0, None, False).of((9, 25))
    merit = problem.merit
    assert isinstance(merit, MeritFunction) and isinstance(problem.parametrisation, Parametrisation)
    rays = source.sample(2**12, 5)
    light = merit.light_of(problem.parametrisation.tables(*problem.parametrisation.start()), rays)
    judged = lf.evaluate(lf.Lens(start_faces(spec), spec, 0, FEW), rays=2**13).limits
    for cause, limit in zip(("housing", "beside"), judged, strict=True):
        share = float(light.losses[0][LOSSES.index(cause)]) / light.emitted_w
        assert share == pytest.approx(limit.value, abs=0.02) and limit.value > 0.02, cause


MAST = {**POST, "name": "mast", "patch_mm": 6.0, "centre_mm": [9.0, -12.0, 60.0]}
DOSE = {"kind": "body", "body": "mast", "at_least": 1e-3, "unit": "mj_per_cm2", "exposure_s": 40.0}


@pytest.mark.parametrize("lamps", [None, LAMPS], ids=["one lamp", "two lamps"])
def test_a_body_has_the_light_that_it_keeps_from_a_receiver(lamps: dict[str, Any] | None) -> None:
    """Of the second of two bodies, behind the first; of lamps the sum. Limits are of the same patches."""
    limits = [
        DOSE | {"facing": [0.0, 0.0, -1.0], "within_deg": 70.0},
        DOSE | {"of": "mean"},
        DOSE | {"facing": [0.0, 0.0, 1.0]},
    ]
    light, lens = light_of(BEZEL, MAST, lamps=lamps, limits=limits)
    (body,) = light.on_bodies
    share = {blocked.name: blocked.share for blocked in light.receivers[0].blocked}["mast"]
    lit_w = searched_source(lens.spec).flux_w * share.value * len(lens.spec.all_lamps)
    assert body.area_mm2 == pytest.approx(2.0 * (6 * 9 + 9 * 60 + 60 * 6), rel=1e-9)
    assert body.mean.value * 1e-6 * body.area_mm2 == pytest.approx(lit_w, rel=1e-9) and lit_w > 0.0
    assert body.mean.standard_error == pytest.approx(
        body.mean.value * (share.standard_error or 0) / share.value, rel=1e-6
    )
    (view,) = body_views(lens.spec)
    assert body.least.value == body.irradiance.min() == 0.0
    assert body.least_mm == pytest.approx(view.centres_mm[body.irradiance.argmin()])
    up = view.pose.directions(view.patches.normals)[:, 2]
    least, mean, above = light.limits
    assert mean.value == pytest.approx(0.1 * 40.0 * body.mean.value) and mean.unit == "mJ/cm²"
    assert above.value == 0.0 and above.state == "fail"
    noise = 3.0 * (least.standard_error or 0.0)
    assert least.value == pytest.approx(4.0 * body.irradiance[-up >= np.cos(np.radians(70.0))].min(), abs=noise)
    facts = {fact.key: fact for group in light_facts(light, lens) for fact in group.facts}
    assert facts["body_mean"].value == pytest.approx(body.mean.value) and "is dark" in facts["body_mean"].note
    assert facts["body_least"].label == "Least on mast" and facts["body_least"].note.startswith("at (")


def test_no_lens_brings_more_to_a_body_than_two_faces_transmit() -> None:
    """Evenly over the patches that count, of which a design is told before it searches."""
    spec = small_spec(scene=[MAST], limits=[DOSE | {"facing": [0.0, 0.0, -1.0]}, DOSE | {"of": "mean"}])
    source = searched_source(spec)
    _, required = light_requirements(spec, source)
    (view,) = body_views(spec)
    areas_mm2 = view.patches.areas_mm2
    passed_w = source.flux_w * SourceLight.of(source, spec.media, lens=spec.lens).transmittance
    counted = view.counted(spec.limits[0])
    for requirement, area_mm2 in zip(required, (areas_mm2[counted].sum(), areas_mm2.sum()), strict=True):
        assert requirement.possible == pytest.approx(0.1 * 40.0 * passed_w / (1e-6 * area_mm2))
        assert requirement.possible_words.endswith("mJ/cm² (all that two faces transmit)")


def test_a_yield_judges_a_limit_on_a_body_of_one_lamp_alone() -> None:
    """The mean dose, by parts whose lens is moved a little; parts of several lamps are drawn apart, and refused."""
    mean = DOSE | {"of": "mean"}
    moved = {"lens_shift_mm": 0.05}
    lens = lens_of(small_spec(scene=[MAST], limits=[mean], tolerances=moved))
    spread = measure_yield(lens, parts=4, rays=2**11, with_budget=False).metrics["limits.0: mean light on the body"]
    (judged,) = lf.evaluate(lens, rays=2**14).limits
    assert judged.value is not None and judged.value > 0.0
    assert spread.mean.value == pytest.approx(judged.value, rel=0.1)
    lamps = lens_of(small_spec(scene=[MAST], lamps=LAMPS, limits=[mean], tolerances=moved))
    with pytest.raises(lf.InputError, match=r"yield: limits.0: light on a body is of all lamps, whose parts are drawn"):
        measure_yield(lamps, parts=4, rays=2**9, with_budget=False)


def test_a_limit_on_a_body_faces_the_scene_and_not_a_lamp_that_leans_in_it() -> None:
    """The light of the one lamp that a proof casts is not judged by it."""
    limit = DOSE | {"facing": [0.0, 0.0, -1.0], "within_deg": 5.0}
    upright = MAST | {"tilt_deg": [0.0, 0.0]}
    spec = small_spec(scene=[upright], lamps=LAMPS | {"aims_mm": [[0.0, 0.0, 60.0], [0.0, 0.0, 70.0]]}, limits=[limit])
    alone = seen_by_lamp(spec, 1)
    assert len(spec.limits) == 1 and not alone.limits and alone.scene[0].tilt_deg != (0.0, 0.0)
    assert lf.evaluate(lens_of(alone), rays=2**10).on_bodies[0].mean.value > 0.0


@pytest.mark.parametrize("surface", [MIRROR, WHITE], ids=["mirror", "white"])
def test_a_ring_returns_what_it_does_not_take(surface: dict[str, Any]) -> None:
    """Of the light that a black ring takes; the far field loses the same. What it adds in the window is stated."""
    limits = [LIMIT, {"kind": "loss", "cause": "beside", "at_most_share": 0.9}]
    black = light_of(RING)[0].receivers[0]
    light, lens = light_of(RING | surface, limits=limits)
    (lit,) = light.receivers
    (ring,) = lit.blocked
    taken = black.flux.housing
    assert taken > 0.2 and ring.share.value == pytest.approx(lit.flux.housing, rel=1e-12)
    assert lit.flux.housing == pytest.approx((1.0 - surface["reflectance"]) * taken, rel=1e-9)
    assert sum(lit.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12) and lit.flux.second_wall > 5e-4
    gained = lit.efficiency.value - black.efficiency.value
    assert ring.returned is not None and (ring.returned.standard_error or 0.0) > 0.0
    assert ring.returned.value == pytest.approx(gained, abs=1e-12) and gained > 0.02
    assert ring.place_mm == pytest.approx(black.blocked[0].place_mm, abs=0.05)
    blocked, beside = (limit.value for limit in light.limits)
    assert blocked == pytest.approx(lit.flux.housing + lit.flux.second_wall)
    assert beside == pytest.approx(lit.flux.outside + lit.missed_by_cause.missed_receiver)
    assert lit.possible.efficiency >= lit.efficiency.value
    (told,) = [
        fact for group in light_facts(light, lens) for fact in group.facts if fact.label == "Light by reflection"
    ]
    assert (
        told.value == pytest.approx(100.0 * gained)
        and told.note == "in the window, by ring; the search counts one reflection"
    )
    far = lf.photometry(lens, rays=2**14).lost_w
    source_w = searched_source(lens.spec).flux_w
    assert far.housing / source_w == pytest.approx(lit.flux.housing, abs=0.01)
    assert far.second_wall / source_w == pytest.approx(lit.flux.second_wall, abs=0.01)


def test_light_in_the_far_field_comes_from_the_walls_that_reflect_it() -> None:
    """Rays of the file start on a sphere around them, and go on from where they met them."""
    lens = lens_of(small_spec(scene=[RING | MIRROR]))
    traced = TracedLens.of(lens, 3.0)
    bundle = searched_source(lens.spec).sample(2**12, 3)
    housing = Housing.of(lens.spec.scene)
    assert housing is not None
    out = exit_rays(traced, bundle, 1.001 * housing.reach_mm, housing=housing)
    exits = traced.trace(bundle)
    shadow = housing.shadow(exits.points, exits.directions, np.where(exits.left_lens, np.inf, -np.inf))
    _, reflected = housing.reflected(exits, shadow)
    keys = {tuple(way) for way in np.round(out.rays.directions, 9).tolist()}
    on_path = np.array([tuple(way) in keys for way in np.round(reflected.directions, 9).tolist()])
    assert on_path.sum() > 100
    assert np.linalg.norm(out.rays.origins, axis=1) == pytest.approx(1.001 * housing.reach_mm)
    assert out.rays.flux.sum() + out.by_fate_w[1:].sum() == pytest.approx(exits.flux.sum())


def test_an_eye_of_a_search_takes_all_bodies_for_black() -> None:
    """To the last bit; its pattern has what they reflect."""
    eye = {"kind": "luminance", "at_most": 1e9, "unit": "cd_per_m2", "eyes_mm": [[140.0, -20.0, 380.0]], "spot_mm": 2.0}
    source = searched_source(small_spec())
    pictures = []
    for surface in ({}, WHITE, MIRROR):
        spec = small_spec(scene=[POST | surface], limits=[eye], source__flux_lm=100.0)
        problem = Problems(spec, source, 3.0, None, False).of((9,))
        merit = problem.merit
        assert isinstance(merit, MeritFunction) and isinstance(problem.parametrisation, Parametrisation)
        tables = problem.parametrisation.tables(*problem.parametrisation.start())
        pictures.append([image.detach().numpy() for image in merit.light_of(tables, source.sample(2**12, 5)).images])
        (view,) = eye_views(spec)
        assert view.housing is not None and not view.housing.reflects
    for other in pictures[1:]:
        pattern, seen = other
        assert (seen == pictures[0][1]).all()
        assert pattern.sum() > pictures[0][0].sum()


def test_the_error_of_the_tables_is_that_before_black_bodies() -> None:
    """To the last bit: rays through exact surfaces have no numbers for a diffuse wall."""
    errors = []
    for surface in ({}, WHITE, MIRROR):
        lens = lens_of(small_spec(scene=[RING | surface]))
        coarse, fine = (TracedLens.of(lens, nodes) for nodes in (2.0, 4.0))
        errors.append(measure_preset(lens, searched_source(lens.spec), coarse, fine))
    assert errors[0] == errors[1] == errors[2]
    assert abs(errors[0].design.efficiency.value) > 0.0


@pytest.mark.parametrize("surface", [MIRROR, WHITE, GLASSY], ids=["mirror", "white", "clear"])
def test_a_yield_has_the_light_that_goes_on_from_a_ring(surface: dict[str, Any]) -> None:
    lens = lens_of(small_spec(scene=[RING | surface], limits=[LIMIT], tolerances={"lens_shift_mm": 0.01}))
    spread = measure_yield(lens, parts=4, rays=2**12, with_budget=False).metrics
    light = lf.evaluate(lens, rays=2**14)
    by_name = {name: value.mean.value for name, value in spread.items()}
    assert by_name["efficiency"] == pytest.approx(light.receivers[0].efficiency.value, abs=0.01)
    (share,) = [value for name, value in by_name.items() if name.startswith("limits.0")]
    assert light.limits[0].value is not None and share == pytest.approx(light.limits[0].value, abs=0.01)


GLASS = {"refractive_index": 1.5, "distance_mm": 90.0, "thickness_mm": 2.0}
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"scene": [BEZEL, BEZEL]}, "scene: two have the name 'bezel'; give each its own"),
    ({"scene": [{**BEZEL, "bore_radius_mm": 70.0}]}, "bore_radius_mm = 70: must be less than radius_mm = 70"),
    ({"scene": [BEZEL], "lamps": {"kind": "endless", "pitch_mm": 60.0}}, "an endless lattice of lamps would need"),
    ({"scene": [BEZEL], "lens__cover_glass": GLASS}, "leave out the glass"),
    ({"scene": [BEZEL | {"surface": "clear"}]}, 'surface = "clear": give one of refractive_index and material'),
    (
        {"scene": [BEZEL | {"surface": "clear", "material": "jelly"}]},
        "material = 'jelly': must be one of PMMA, PC",
    ),
    ({"scene": [BEZEL | {"material": "PMMA"}]}, "material = PMMA: of a clear body only; give surface"),
    ({"scene": [BEZEL | {"refractive_index": 1.5}]}, "refractive_index = 1.5: of a clear body only"),
    ({"scene": [BEZEL | GLASSY | {"reflectance": 0.5}]}, "a clear surface reflects by its refractive_index"),
    ({"scene": [BEZEL | GLASSY | {"patch_mm": 5.0}]}, "light on a clear body is not measured"),
    ({"scene": [{"kind": "room", "name": "room", "size_mm": [900.0] * 3} | GLASSY]}, "scene.0.surface"),
    ({"limits": [LIMIT]}, "limits.0.cause = 'housing': of this scene it is one of beside"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "phrase"), REFUSED)
def test_a_scene_that_is_not_modelled_is_refused_in_a_line(changes: dict[str, Any], phrase: str) -> None:
    with pytest.raises(lf.InputError) as refusal:
        small_spec(**changes)
    assert phrase in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_spec_without_a_scene_keeps_its_hash() -> None:
    content = small_spec().model_dump()
    assert "scene" not in content and "rim_deg" not in content["optimise"]
    assert "scene" in small_spec(scene=[BEZEL]).model_dump()


# A tilted plate of plastic over the lens, from beside whose rim some light passes.
COVER = {
    "kind": "box", "name": "cover", "size_mm": [60.0, 44.0, 5.0], "centre_mm": [5.0, -4.0, 32.0],
    "tilt_deg": [9.0, -14.0], "rotate_z_deg": 25.0, "surface": "clear", "refractive_index": 1.59,
    "absorption_per_mm": 0.004,
}  # fmt: skip


@pytest.mark.parametrize("lamps", [None, LAMPS], ids=["one lamp", "two lamps"])
def test_a_clear_body_passes_what_it_does_not_take(lamps: dict[str, Any] | None) -> None:
    """Fates sum to 1; light by way of it is in the window, its loss is that of two faces and of the way within."""
    without = light_of(lamps=lamps)[0].receivers[0]
    shelf = {"kind": "box", "name": "shelf", "size_mm": [60.0, 300.0, 2.0], "centre_mm": [55.0, 0.0, 60.0]}
    light, lens = light_of(COVER, shelf, lamps=lamps, limits=[LIMIT])
    (lit,) = light.receivers
    assert sum(lit.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    by_name = {blocked.name: blocked for blocked in lit.blocked}
    cover, opaque = (by_name[name] for name in ("cover", "shelf"))
    assert lit.flux.housing == pytest.approx(cover.share.value + opaque.share.value)
    assert lit.flux.second_wall > 1e-3, "behind the cover the shelf ends light, too"
    assert cover.passed is not None and cover.trapped is not None and cover.returned is None
    assert opaque.passed is None and opaque.trapped is None
    assert 0.05 < cover.passed.value < lit.efficiency.value and (cover.passed.standard_error or 0.0) > 0.0
    assert 0.0 < cover.trapped.value < cover.share.value
    assert without.efficiency.value > lit.efficiency.value
    (blocked,) = light.limits
    assert blocked.value == pytest.approx(lit.flux.housing + lit.flux.second_wall)
    told = {fact.label: fact for group in light_facts(light, lens) for fact in group.facts}
    passed = told["Light through a clear body"]
    assert passed.value == pytest.approx(100.0 * cover.passed.value)
    assert passed.note == "in the window, through cover; the search takes it for air"
    far = lf.photometry(lens, rays=2**14).lost_w
    emitted_w = searched_source(lens.spec).flux_w * len(lens.spec.all_lamps)
    assert far.housing / emitted_w == pytest.approx(lit.flux.housing, abs=0.01)


def test_a_large_plate_takes_what_its_faces_and_its_way_take() -> None:
    """Of light that goes up by little: 1 - T² and the absorption, by the angles of the rays that leave the lens."""
    plate = COVER | {"size_mm": [4000.0, 4000.0, 5.0], "centre_mm": [0.0, 0.0, 60.0]}
    lens = lens_of(small_spec(scene=[plate]))
    exits = TracedLens.of(lens, 3.0).trace(searched_source(lens.spec).sample(2**13, 3))
    housing = Housing.of(lens.spec.scene)
    assert housing is not None
    shadow = housing.shadow(exits.points, exits.directions, np.where(exits.left_lens, np.inf, -np.inf))
    normal = np.array(lens.spec.scene[0].pose.axis)
    cosine = np.abs(exits.directions @ normal)
    deep = shadow.met & (cosine > 0.05)
    c = cosine[deep]
    within = np.sqrt(1.0 - (1.0 - c**2) / 1.59**2)
    faces = [1.0 - ((a - b) / (a + b)) ** 2 for a, b in ((c, 1.59 * within), (1.59 * c, within))]
    wanted = 0.5 * (faces[0] ** 2 + faces[1] ** 2) * np.exp(-0.004 * 5.0 / within)
    assert deep.sum() > 4000 and shadow.onward[deep] == pytest.approx(wanted, rel=1e-5)


def test_a_search_and_an_eye_look_through_clear_bodies_as_if_they_were_air() -> None:
    """To the last bit; nor has the error of the tables light of them."""
    eye = {"kind": "luminance", "at_most": 1e9, "unit": "cd_per_m2", "eyes_mm": [[140.0, -20.0, 380.0]], "spot_mm": 2.0}
    source = searched_source(small_spec())
    pictures = []
    for scene in ([POST], [COVER, POST], [COVER], []):
        spec = small_spec(scene=scene, limits=[eye], source__flux_lm=100.0)
        problem = Problems(spec, source, 3.0, None, False).of((9,))
        merit = problem.merit
        assert isinstance(merit, MeritFunction) and isinstance(problem.parametrisation, Parametrisation)
        tables = problem.parametrisation.tables(*problem.parametrisation.start())
        pictures.append([image.detach().numpy() for image in merit.light_of(tables, source.sample(2**12, 5)).images])
    for one, other in ((0, 1), (2, 3)):
        assert all((first == same).all() for first, same in zip(pictures[one], pictures[other], strict=True))
    assert any((first != other).any() for first, other in zip(pictures[0], pictures[3], strict=True))


def test_more_events_follow_light_from_body_to_body_in_every_figure() -> None:
    """Between a ring and a wall above it: whole budgets, what was lost at a second body lands, in far fields, too."""
    wall = HALF | WHITE | {"centre_mm": [30.0, 5.0, 62.0], "size_mm": [70.0, 80.0, 2.0], "tilt_deg": [10.0, -15.0]}
    far_field = {"kind": "far_field", "half_angle_deg": 70.0, "targets": [{"kind": "disc", "diameter_deg": 70.0}]}
    near = {
        "kind": "plane", "centre_mm": [0.0, 0.0, 150.0], "width_mm": 160.0, "height_mm": 160.0,
        "targets": [{"kind": "disc", "diameter_mm": 80.0}],
    }  # fmt: skip
    receivers = {"target": None, "receivers": [far_field, near]}
    once, twice, often = (light_of(RING | MIRROR, wall, scene_events=events, **receivers) for events in (1, 2, 9))
    for number in (0, 1):
        fluxes = [light.receivers[number].flux for light, _ in (once, twice, often)]
        for flux in fluxes:
            assert sum(flux.model_dump().values()) == pytest.approx(1.0, abs=1e-9)
        lost = [flux.second_wall for flux in fluxes]
        assert lost[0] > 1.3 * lost[1] > 10.0 * lost[2] > 0.0, lost
        first, second, last = (
            {body.name: body for body in light.receivers[number].blocked} for light, _ in (once, twice, often)
        )
        assert second["ring"].share.value > first["ring"].share.value
        for bodies, flux in zip((first, second, last), fluxes, strict=True):
            assert sum(body.share.value for body in bodies.values()) == pytest.approx(flux.housing, abs=1e-9)
    for light, lens in (twice, often):
        far = lf.photometry(lens, rays=2**14).lost_w
        flux_w = searched_source(lens.spec).flux_w
        assert far.housing / flux_w == pytest.approx(light.receivers[0].flux.housing, abs=0.01)
        assert far.second_wall / flux_w == pytest.approx(light.receivers[0].flux.second_wall, abs=0.004)
    spec = once[1].spec
    assert "scene_events" not in spec.model_dump() and often[1].spec.model_dump()["scene_events"] == 9
    assert spec.media.scattering == 1 and often[1].spec.media.scattering == 9
