"""Remedies follow their cause: the mesh is named where the mesh is it, and only there."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from lens_meshes import DISTANCE, INDEX, INNER, OUTER, lambertian, oracle, right

from lensforge.optics.media import Media, Medium
from lensforge.proof.acceptance import (
    BLOCKS,
    FINE_FACETS_UM,
    LEAST_RAYS,
    brep_criteria,
    mitsuba_criteria,
)
from lensforge.proof.cast_results import Agreement, BrepCast, MitsubaCast
from lensforge.proof.file_form import FileForm
from lensforge.proof.part_comparison import Expected, compare, flux_budget, gap_quantiles, judge_independent_rays
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.remedies import Evidence, form_of_mesh
from lensforge.proof.sequential_cast import CastFate, LandedRays, Passage
from lensforge.proof.verification import FilesOfPart, LightOfDesign, Referees, verify_part
from lensforge.results import Metric

SCREEN = Screen.square(DISTANCE, 300.0, 32)
RAYS = lambertian(4000, 2.0, seed=1)
HITS, FLUX, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
FATES = np.where(np.isnan(HITS[:, 0]), "base", "landed").astype("U20")
MESH = "finer mesh"


def failed(part, rays=RAYS, hits=HITS, flux=FLUX, fates=FATES):
    """Remedies of the criteria that fail, by name, and the result."""
    result = verified(part, rays, hits, flux, fates)
    return {criterion.key: criterion.remedy for criterion in result.criteria if not criterion.holds}, result.first


def verified(part, rays=RAYS, hits=HITS, flux=FLUX, fates=FATES):
    expected = Expected(SCREEN, SCREEN.irradiance(hits, flux), hits, flux, fates)
    light = LightOfDesign(rays, Media(Medium(INDEX)), [expected])
    return verify_part(FilesOfPart(part.export(file_type="stl")), light, Referees(1))


def test_light_that_only_the_design_loses_is_named_with_its_flux():
    lost = np.nonzero((np.abs(HITS) < 100.0).all(axis=1))[0][:120]
    hits = HITS.copy()
    flux = FLUX.copy()
    fates = FATES.copy()
    hits[lost] = np.nan
    flux[lost] = 0.0
    fates[lost] = "backward"
    remedies, result = failed(right(), hits=hits, flux=flux, fates=fates)
    assert remedies["fate_disagreement_flux"].startswith("3.00% of the flux: design backward, part landed")
    assert MESH not in remedies["fate_disagreement_flux"]
    assert remedies["nmse_same_rays"] == remedies["fate_disagreement_flux"]
    assert "deviation_rms" not in remedies
    (pair, *_) = result.against_design.pairs
    assert (pair.design, pair.part, pair.rays, pair.flux) == ("backward", "landed", 120, pytest.approx(0.03))
    assert sum(pair.rays for pair in result.against_design.pairs) == result.against_design.fates
    assert sum(pair.flux for pair in result.against_design.pairs) == pytest.approx(result.against_design.fates_flux)


def test_light_that_the_base_cuts_off_asks_for_another_base():
    """From 9 mm below z = 0, through an opening 8 mm high: the design knows the opening at z = 0 alone."""
    rays = lambertian(4000, 4.0, seed=2, height=-9.0)
    with np.errstate(invalid="ignore"):  # some pass by the cavity: they are taken out below
        hits, flux, _ = oracle(INNER, OUTER, rays, INDEX, DISTANCE)
    up = rays.origins[:, :2] + 9.0 * rays.directions[:, :2] / rays.directions[:, 2:]
    across = np.linalg.norm(up, axis=1)
    passes = INNER.radius(np.column_stack([up / across[:, None], np.zeros(4000)])) > across
    hits[~passes] = np.nan
    flux[~passes] = 0.0
    fates = np.where(passes, "base", "outside_cavity")
    remedies, result = failed(right(base=(16.0, 8.0)), rays, hits, flux, fates)
    assert (
        result.against_design.pairs == ()
    )  # the rim itself decides, however deep the opening, if its walls are upright
    narrow = right(base=(16.0, 8.0))
    low = narrow.vertices[:, 2] < -7.9
    inside = low & (np.linalg.norm(narrow.vertices[:, :2], axis=1) < 8.0)
    narrow.vertices[inside, :2] *= 0.25
    remedies, result = failed(narrow, rays, hits, flux, fates)
    assert "design landed, part opening; the base cuts off light" in remedies["fate_disagreement_flux"]
    assert "deviation_rms" not in remedies and MESH not in "".join(remedies.values())


def test_flux_that_differs_where_landings_agree_is_no_matter_of_the_mesh():
    remedies, _ = failed(right(), flux=1.005 * FLUX)
    assert set(remedies) == {"flux_deviation"}
    assert "so the mesh is right" in remedies["flux_deviation"]


def test_a_hole_is_told_to_be_closed():
    whole = right(rings=8)
    remedies, _ = failed(trimesh.Trimesh(whole.vertices, np.delete(whole.faces, 30, axis=0), process=False))
    assert remedies["open_edges"] == remedies["deviation_rms"] == "export again: the mesh is not closed"


@pytest.mark.parametrize(
    ("edges", "step", "says"),
    [
        (3, True, "not closed"),
        (0, True, "lens.step is right, its rays land where the design's do; the facets of lens.stl are too coarse"),
        (0, False, "so the mesh is not the cause"),
        (0, None, "if it stays, the file is not the lens of lens.json"),
    ],
)
def test_the_step_file_tells_whether_the_mesh_is_the_cause(edges, step, says):
    assert says in form_of_mesh(edges, step)


def test_fine_facets_are_not_blamed_for_a_shifted_face_or_a_void():
    shifted = right(80, outer=replace(OUTER, centre=(-0.34, 0.3, -0.5)))
    void = trimesh.creation.icosphere(subdivisions=3, radius=0.9).apply_translation([2.1, -1.4, 11.2])
    void.invert()
    for part in (shifted, trimesh.util.concatenate([right(rings=80), void])):
        remedies, _ = failed(part)
        assert remedies and MESH not in "".join(remedies.values())
        assert "a face of lens.stl lies elsewhere, or it has a void" in "".join(remedies.values())


@pytest.mark.parametrize(("of_limit", "says"), [(0.9, MESH), (1.1, "so the mesh is not the cause")])
def test_facets_are_blamed_however_fine_where_the_step_file_lands_its_rays(of_limit, says):
    """Low facets may still have normals that are too coarse: then no face has moved. The STEP has half the limit."""
    proof = verified(right(80, outer=replace(OUTER, centre=(-0.34, 0.3, -0.5))))
    rms = 0.5 * of_limit * proof.first.deviation_limit_mm
    none = {"flux": 0.0, "fates": 0, "fates_flux": 0.0}
    alike = Agreement(compared=9, rms=rms, p99=1.0, max=1.0, **none)
    cast = BrepCast(rays=9, seconds=0.0, against_design=alike, against_mesh=alike)
    with_step = proof.changed(receivers=(proof.first.changed(brep=cast),))
    told = {criterion.key: criterion.remedy for criterion in with_step.judge() if not criterion.holds}
    assert proof.facet_height_um.rms <= FINE_FACETS_UM and says in told["deviation_rms"]


def test_form_comes_before_fates_and_fates_before_losses():
    some = Agreement(compared=9, rms=2.0, p99=2.0, max=2.0, flux=0.5, fates=0, fates_flux=0.5)
    wrong = Evidence(some, 1.0, 0.1, 0.1, "FORM")
    assert wrong.of_pixels() == wrong.of_flux() == wrong.of_deviation() == "FORM"
    right = Evidence(some.model_copy(update={"rms": 0.5, "fates_flux": 0.0}), 1.0, 0.1, 0.1, "FORM")
    assert right.of_pixels() == right.of_flux() != "FORM"
    none = Evidence(some.model_copy(update={"rms": 0.5, "fates_flux": 0.0, "flux": 0.0}), 1.0, 0.1, 0.1, "FORM")
    assert "pixel borders" in none.of_pixels()


def landed_rays(rays, landings, **fields):
    given = {**vars(Passage.of(rays, 2)), "in_housing": np.zeros(len(rays)), **fields}
    return LandedRays(**given, landings=landings)


@pytest.mark.parametrize("fate", list(CastFate)[1:])
@pytest.mark.parametrize(
    "design", ["backward", "outside_cavity", "base", "total_reflection", "not_converged", "surfaces_intersect", "lost"]
)
def test_every_pair_of_fates_has_its_advice(design, fate):
    """Both ways; the mesh is blamed for light at a limit only, never for light that starts somewhere else."""
    nowhere = np.full((2, 2), np.nan)
    there = np.zeros((2, 2))
    ones = np.ones(2)
    rays = lambertian(2, 0.0)
    for landed in (False, True):
        fates = np.full(2, CastFate.LANDED if landed else fate, dtype=np.int64)
        passage = landed_rays(rays, there if landed else nowhere, fates=fates)
        screen = Screen.square(DISTANCE, 10.0, 2)
        expected = Expected(screen, np.ones((2, 2)), nowhere if landed else there, ones, np.full(2, design))
        agreement = compare(rays, passage, expected)
        pair = agreement.pairs[0]
        assert (pair.design, pair.part) == ((design, "landed") if landed else ("landed", fate.name.lower()))
        alike = agreement.model_copy(update={"compared": 5, "rms": 0.0})
        says = Evidence(alike, 1.0, 1.0, 0.0, "FORM").of_fates()
        assert says.startswith("100.00% of the flux: design ") and "FORM" not in says
        start = {"backward", "outside_cavity"} if landed else {"opening", "no_hit", "starts_inside", "starts_outside"}
        assert (MESH in says) == (not {pair.design, pair.part} & (start | {"not_converged", "surfaces_intersect"}))


def test_rays_that_met_other_faces_count_as_of_another_fate():
    """However near they land; those of the same faces count however far apart they land."""
    rays = lambertian(3, 0.0)
    ones = np.ones(3)
    fates = np.full(3, CastFate.LANDED, dtype=np.int64)
    design = np.array([[0, 3], [0, 3], [1, 2]])
    part = np.array([[0, 3], [0, 2], [1, 2]])
    places = np.array([[0.0, 0.5], [1.0, 0.0], [0.0, 0.0]])
    landed = landed_rays(rays, places + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 3.0]]), fates=fates, met=part)
    one_way = Expected(Screen.square(DISTANCE, 10.0, 2), np.ones((2, 2)), places, ones)
    agreement, alike = (compare(rays, landed, reference) for reference in (replace(one_way, met=design), one_way))
    assert (agreement.compared, agreement.fates, agreement.max) == (2, 1, pytest.approx(3.0))
    assert agreement.fates_flux == pytest.approx(rays.flux[1] / rays.flux.sum())
    assert (alike.compared, alike.fates) == (3, 0)
    assert replace(one_way, met=design).take(np.array([1, 2])).met.tolist() == design[1:].tolist()


@pytest.mark.parametrize(("kind", "unit"), [("plane", 1.0), ("cylinder", 1.0), ("sphere", 1.0), ("far_field", 1e3)])
def test_gaps_are_mm_on_the_receiver_and_of_directions_those_at_a_metre(kind, unit):
    """Of three rays: 0.005 and 0.013 units of the chart, the third lands nowhere in the part."""
    screen = Screen.kinds[kind]((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0, 1.5, 1.0, 8, 4, (None, None, None))
    rays = lambertian(3, 0.0)
    places = np.array([[0.1, 0.2], [-0.3, 0.1], [0.2, 0.2]])
    fates = np.array([CastFate.LANDED, CastFate.LANDED, CastFate.NO_HIT], dtype=np.int64)
    off = np.array([[3e-3, -4e-3], [5e-3, 12e-3], [np.nan, 0.0]])
    landed = landed_rays(rays, places + off, fates=fates)
    expected = Expected(screen, np.ones((4, 8)), places, np.ones(3))
    agreement = compare(rays, landed, expected)
    assert (agreement.compared, agreement.fates) == (2, 1)
    assert (agreement.rms, agreement.max) == pytest.approx((unit * np.sqrt(97e-6), 0.013 * unit))
    assert gap_quantiles(landed, expected)[[0, 250, 500]] == pytest.approx(unit * np.array([5e-3, 9e-3, 13e-3]))
    nowhere = compare(rays, replace(landed, landings=np.full((3, 2), np.nan)), expected)
    assert nowhere.rms == pytest.approx(unit * np.hypot(1.5, 1.0)), "the diagonal"


CASTS = {  # limits by hand: rad, share of the flux, rays or share of the flux with another fate
    "brep_": (5e-5, 1e-4, 2), "mitsuba_": (1e-3, 2e-3, 2e-3)}  # fmt: skip


@pytest.mark.parametrize("beyond", [0.999, 1.001])
@pytest.mark.parametrize("prefix", CASTS)
def test_each_figure_of_a_cast_is_judged_by_its_own_limit(prefix, beyond):
    """A little inside each limit, and a little beyond each; the reach of the light is 2 m."""
    angle, flux, fates = CASTS[prefix]
    count = int(fates * (beyond > 1.0) + 2) if prefix == "brep_" else 7
    seen = Agreement(compared=9, rms=beyond * angle * 2000.0, p99=9.0, max=9.0, flux=beyond * flux, fates=count,
                     fates_flux=beyond * 2e-3)  # fmt: skip
    common = {"rays": 1024, "seconds": 1.0, "against_design": seen}
    if prefix == "brep_":
        criteria = brep_criteria(BrepCast(**common, against_mesh=seen), 2000.0)
    else:
        nmse = {"nmse_vs_design": beyond * (2.5 * 0.01 + 1e-3), "noise_floor_nmse": 0.01, "nmse_same_rays": 0.0}
        criteria = mitsuba_criteria(MitsubaCast(version="3", **common, **nmse), 2000.0)
    assert {criterion.key: criterion.holds for criterion in criteria} == {
        criterion.key: beyond < 1.0 for criterion in criteria
    }
    if prefix == "brep_":  # of four times as many rays four times as many may end otherwise
        more = BrepCast(
            **{**common, "rays": 4096, "against_design": seen.model_copy(update={"fates": 8})}, against_mesh=seen
        )
        assert brep_criteria(more, 2000.0)[-1].holds and brep_criteria(more, 2000.0)[-1].limit == 8.0
    assert f"{prefix}deviation_rms" in {criterion.key for criterion in criteria} and len(criteria) == (
        3 if prefix == "brep_" else 4
    )


EXACT = Metric(value=1.0, standard_error=0.0)


def test_the_flux_budget_of_a_few_rays_by_hand():
    """Unequal rays: in the window, beside it, gone back, totally reflected, at a second wall; all lose some before."""
    rays = lambertian(5, 0.0)
    rays = replace(rays, flux=np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    ends = CastFate.LANDED, CastFate.LANDED, CastFate.NO_HIT, CastFate.TOTAL_REFLECTION, CastFate.SECOND_WALL
    fates = np.array(ends, dtype=np.int64)
    lost = {
        "absorbed": [0.1, 0.0, 0.2, 0.0, 0.0], "in_glass": [0.0, 0.3, 0.0, 0.1, 0.0],
        "in_bodies": [0.2, 0.0, 0.0, 0.3, 0.0], "in_housing": [0.0, 0.1, 0.0, 0.0, 0.6],
    }  # fmt: skip
    places = np.array([[1.0, 2.0], [1.0, 4.0], *[[np.nan, np.nan]] * 3])
    flux = np.array([0.5, 1.5, 2.5, 3.0, 4.0])
    landed = landed_rays(
        rays, places, fates=fates, flux=flux, **{name: np.array(values) for name, values in lost.items()}
    )
    screen = replace(Screen.square(DISTANCE, 10.0, 2), window=(10.0, 6.0, None))
    budget = flux_budget(rays, landed, screen).model_dump()
    by_hand = {"detected": 0.5, "outside": 1.5, "missed": 2.5, "total_reflection": 3.0, "event_limit": 0.0,
               "absorbed": 0.3, "cover_glass": 0.4, "bodies": 0.5, "housing": 0.7, "second_wall": 4.0,
               "reflected": 15.0 - 11.5 - 1.9}  # fmt: skip
    assert budget == pytest.approx({name: share / 15.0 for name, share in by_hand.items()})
    assert sum(budget.values()) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("uneven", [0.0, 0.5])
def test_a_picture_without_the_noise_of_its_rays_scatters_by_its_stated_error(uneven):
    """Of light as designed, where the blocks' products are noise alone, and of light that is off."""
    count = 8 * LEAST_RAYS
    values = []
    rays = replace(lambertian(count, 0.0), flux=np.ones(count))
    screen = Screen.square(DISTANCE, 10.0, 8, 0.0)
    wanted = np.full((8, 8), count / 100e-6)  # W/m2 of rays of 1 W on 10 x 10 mm
    wanted[:, :4] *= 1.0 + uneven
    fates = np.full(count, CastFate.LANDED, dtype=np.int64)
    for seed in range(200):
        places = np.random.default_rng(seed).uniform(-5.0, 5.0, (count, 2))
        up = {"points": np.column_stack([places, np.zeros(count)]), "directions": np.tile([0.0, 0.0, 1.0], (count, 1))}
        passage = replace(Passage.of(rays, 2), **up, flux=np.ones(count), fates=fates)
        judgement = judge_independent_rays(
            rays, passage, Expected(screen, wanted, places, np.ones(count)), (EXACT, 0.0)
        )
        values.append((judgement.nmse_less_noise.value, judgement.nmse_less_noise.standard_error))
    off, errors = np.array(values).T
    truth = 0.5 * uneven**2 / (0.5 * (1.0 + uneven) ** 2 + 0.5)
    assert off.mean() == pytest.approx(truth, abs=4.0 * off.std() / np.sqrt(len(off)))
    assert 0.8 < off.std(ddof=1) / np.sqrt(np.mean(errors**2)) < 1.2  # known to 5 %


def test_the_error_of_a_picture_without_the_noise_of_its_rays_by_pairs_of_blocks():
    """The mean product of the errors of each two blocks, less the noise of the design; not known without that."""
    random = np.random.default_rng(3)
    count = LEAST_RAYS
    rays = replace(lambertian(count, 0.0), flux=np.full(count, 2.0))
    screen = Screen.square(DISTANCE, 10.0, 3, 0.0)
    places = random.uniform(-5.0, 5.0, (count, 2))
    flux = random.uniform(0.5, 1.5, count)
    up = {"points": np.column_stack([places, np.zeros(count)]), "directions": np.tile([0.0, 0.0, 1.0], (count, 1))}
    fates = np.full(count, CastFate.LANDED, dtype=np.int64)
    passage = replace(Passage.of(rays, 2), **up, flux=flux, fates=fates)
    wanted = screen.irradiance(places, flux) * random.uniform(0.8, 1.2, (3, 3))
    expected = Expected(screen, wanted, places, flux)
    errors = []
    for rows in np.array_split(np.arange(count), BLOCKS):
        errors.append(screen.irradiance(places[rows], flux[rows]) * count / len(rows) - wanted)
    pairs = [(one * other).sum() for a, one in enumerate(errors) for b, other in enumerate(errors) if a != b]
    design = Metric(value=0.9, standard_error=1e-3)
    judgement, unknown = (judge_independent_rays(rays, passage, expected, (design, noise)) for noise in (0.002, None))
    assert judgement.nmse_less_noise.value == pytest.approx(np.mean(pairs) / (wanted**2).sum() - 0.002, rel=1e-9)
    assert unknown.nmse_less_noise is None and judgement.efficiency_design == design
    inside = flux * (np.abs(places) <= 5.0).all(axis=1) / rays.flux.sum()
    assert judgement.efficiency.value == pytest.approx(inside.sum())
    assert judgement.efficiency.standard_error == pytest.approx(np.std(count * inside, ddof=1) / np.sqrt(count))


def form(name, off_um=0.01):
    at = (0.0, 0.0, 1.0)
    return FileForm(name=name, off_um=off_um, face="OPTICAL_OUTER", at_mm=at, limit_um=0.07, open_edges=0)


def judged(proof, **changes):
    changed = proof.changed(**changes)
    return changed.changed(criteria=tuple(changed.judge()))


def test_a_mesh_with_coarse_facets_fails_nothing_beside_a_step_file_that_is_right():
    """Also on the second of two receivers; a file of another form, or a STEP file that is not cast, decides."""
    proof = verified(right(rings=8))
    limit_mm = proof.first.deviation_limit_mm
    none = {"flux": 0.0, "fates": 0, "fates_flux": 0.0}
    casts = [
        BrepCast(rays=9, seconds=0.0, against_design=agreement, against_mesh=agreement)
        for agreement in (Agreement(compared=9, rms=of * limit_mm, p99=1.0, max=1.0, **none) for of in (0.4, 0.6))
    ]
    right_one, wrong_one = (proof.first.changed(brep=cast) for cast in casts)
    second = right_one.changed(name="second")
    forms = tuple(map(form, ("lens.step", "lens.stl", "lens.3mf")))
    coarse = judged(proof, receivers=(right_one, second), forms=forms)
    missed = coarse.facet_misses
    assert {"deviation_rms", "second: deviation_rms"} <= {criterion.key for criterion in missed}
    assert all(criterion.holds for criterion in coarse.deciding_criteria()) and len(missed) + len(
        list(coarse.deciding_criteria())
    ) == len(coarse.criteria)
    for others in (
        {"receivers": (right_one, wrong_one.changed(name="second")), "forms": forms},  # its STEP lands light elsewhere
        {"receivers": (right_one, proof.first.changed(name="second")), "forms": forms},  # without a cast of the STEP
        {"receivers": (right_one, second), "forms": ()},  # of no known form
        {"receivers": (right_one, second), "forms": (*forms[:2], form("lens.3mf", 0.08))},
        {"receivers": (right_one, second), "forms": forms, "open_edges": 1},
    ):
        assert judged(proof, **others).facet_misses == (), others


def test_a_step_file_of_the_right_form_is_not_called_another_lens():
    proof = verified(right(rings=8))
    none = {"flux": 0.0, "fates": 0, "fates_flux": 0.0}
    off = Agreement(compared=9, rms=0.6 * proof.first.deviation_limit_mm, p99=1.0, max=1.0, **none)
    seen = proof.first.changed(brep=BrepCast(rays=9, seconds=0.0, against_design=off, against_mesh=off))
    for off_um, says in ((0.01, "is this lens, but its normals"), (0.08, "is not the lens of lens.json")):
        criteria = judged(proof, receivers=(seen,), forms=(form("lens.step", off_um),)).criteria
        (told,) = (criterion.remedy for criterion in criteria if criterion.key == "brep_deviation_rms")
        assert says in told
