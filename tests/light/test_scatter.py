"""Faces that scatter: closed forms, energy, the proof's own facets and rings, and what no facets do."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
from chains import clear, upwards
from inlined import alone
from scipy.integrate import quad
from scipy.stats import kstest, norm

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.kernels.ray_packet import COEFFICIENTS, SIZE, empty_packet, fetch_table
from lensforge.kernels.seen_slopes import CELL, added_slope, mark_incidence, seen_number, seen_table
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import FaceScatter, Media
from lensforge.optics.scattering import FacetTurn, GaussianFacets, RingScatter, gaussian, lambertian
from lensforge.proof.facet_tilt import Arrival, FaceNumbers, _seen, tilted
from lensforge.proof.refraction import LitRays
from lensforge.proof.ring_spread import Spreading, spread
from lensforge.scene.made_part import AsMade
from lensforge.scene.rough_faces import facet_numbers, keys_of_rays, numbers_again, roughness, with_facets
from lensforge.sources.build_source import build_source
from lensforge.spec.scatter_section import AbgScatter, GaussianScatter, LambertianScatter, TableScatter
from lensforge.spec.source_sections import SquareSource
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

SEEN = alone(seen_number)
AT = COEFFICIENTS * SIZE


@numba.njit(error_model="numpy")
def _added(packet, table, light):
    mark_incidence(packet, AT, 0, *light)
    fetch_table(packet, 1, table, AT + CELL)
    return added_slope(packet, AT, 0)


def added(rms: float, cosine: float, along: float) -> tuple[float, float, float]:
    """Slope of one facet that light sees beyond what is drawn, and its derivatives."""
    return _added(empty_packet(), seen_table(), (rms, cosine, along))


N = 1.49
GRID = TableGrid(161)
SPHERES = np.stack([tabulate(GRID, sphere(radius)) for radius in (1.0, 3.0)])
RAYS = replace(
    upwards(200_000, 1), flux=np.full(200_000, 5e-6)
)  # from the centre: each meets both faces along the normal


def frosted(face: str, sigma_deg: float) -> Media:
    turn = FacetTurn(1.0 / N if face == "inner" else N)
    return replace(clear(N), scatter=(FaceScatter(face, gaussian(np.radians(sigma_deg), turn)),))


@pytest.mark.parametrize("sigma_deg", [0.5, 6.0, 20.0])
def test_a_frosted_face_spreads_light_along_its_normal_as_gaussian_facets_do(sigma_deg: float) -> None:
    """A facet of slope tan m turns light by asin(n sin m) - m; the squared slope is exponentially distributed."""
    media = frosted("outer", sigma_deg)
    exits = TracedBundle.of(SPHERES, Scene(media, GRID, fresnel=False), RAYS).exits
    slope = np.sin(np.radians(sigma_deg)) / (N - np.cos(np.radians(sigma_deg)))
    assert media.scatter[0].model.slope == pytest.approx(slope, rel=1e-12)
    critical = 1.0 / np.sqrt(N**2 - 1.0)
    back = np.exp(-0.5 * (critical / slope) ** 2)
    out = exits.left_lens
    assert 1.0 - out.mean() == pytest.approx(back, abs=4.0 * np.sqrt(back / len(RAYS)) + 1e-6)
    np.testing.assert_allclose(exits.flux[out], RAYS.flux[out], rtol=1e-12, err_msg="no light is made or lost")
    angles = np.arccos(np.clip((exits.directions * RAYS.directions).sum(axis=1)[out], -1.0, 1.0))
    slopes = np.sin(angles) / (N - np.cos(angles))
    share = (1.0 - np.exp(-0.5 * (slopes / slope) ** 2)) / (1.0 - back)
    assert kstest(share, "uniform").statistic < 1.95 / np.sqrt(out.sum())  # 0.1 % of samples
    across = exits.directions[out] - (exits.directions * RAYS.directions).sum(axis=1)[out, None] * RAYS.directions[out]
    assert np.abs(across.mean(axis=0)).max() < 5.0 * across.std() / np.sqrt(out.sum()), "to all sides alike"


@pytest.mark.parametrize(("face", "sigma_deg"), [("inner", 5.0), ("outer", 5.0)])
def test_a_frosted_face_lets_through_what_its_facets_do(face: str, sigma_deg: float) -> None:
    """Fresnel's transmittance over the distribution of the slopes, at the facets alone: the other face is met later."""
    media = frosted(face, sigma_deg)
    slope = media.scatter[0].model.slope
    ratio = 1.0 / N if face == "inner" else N

    def passed(m: float) -> float:
        c = np.cos(m)
        s = ratio * np.sin(m)
        if s >= 1.0:
            return 0.0
        q = np.sqrt(1.0 - s * s)
        reflected = [((ratio * c - q) / (ratio * c + q)) ** 2, ((c - ratio * q) / (c + ratio * q)) ** 2]
        return 1.0 - 0.5 * sum(reflected)

    def weighted(x: float) -> float:
        return passed(np.arctan(slope * x)) * x * np.exp(-0.5 * x * x)

    exits = TracedBundle.of(SPHERES, Scene(media, GRID), RAYS).exits
    wanted = quad(weighted, 0.0, 12.0, epsabs=1e-12)[0]
    if face == "outer":
        wanted *= 4.0 * N / (N + 1.0) ** 2
        assert exits.flux[exits.left_lens].sum() == pytest.approx(wanted, abs=2e-4)
    else:
        lit = LitRays.of(with_facets(RAYS, 1), media, ("inner", "outer"))
        rms = np.full(len(RAYS), slope)
        facets = tilted(Arrival(*[RAYS.directions] * 3), rms, lit.numbers_at(np.zeros(len(RAYS), dtype=int)))
        angles = np.arccos(np.minimum((facets * RAYS.directions).sum(axis=1), 1.0))
        assert np.mean([passed(m) for m in angles[:20_000]]) == pytest.approx(wanted, abs=2e-4)


@pytest.mark.parametrize("k", [0.0, 0.1, 0.7, 3.0, 40.0])
@pytest.mark.parametrize("a", [-6.0, -1.3, 0.0, 1e-9, 2.2, 5.0])
def test_light_sees_the_facets_that_face_it(a: float, k: float) -> None:
    """The share of the facets that light sees with a lesser slope, by quadrature, is that of lesser normal numbers."""
    seen = [quad(lambda x: (k + x) * np.exp(-0.5 * x * x), *ends, epsabs=1e-13, epsrel=1e-12, limit=200)[0]
            for ends in ((max(-k, -12.0), SEEN(a, k)), (SEEN(a, k), 12.0))]  # fmt: skip
    assert seen[a > 0.0] / sum(seen) == pytest.approx(norm.cdf(-abs(a)), rel=1e-7)
    assert _seen(np.array([a]), np.array([k]))[0] == pytest.approx(SEEN(a, k), rel=1e-9, abs=1e-9), "of the proof"


@pytest.mark.parametrize(("most", "within"), [(3.0, 3e-8), (4.0, 5e-8), (6.0, 1e-6)])
def test_the_table_of_what_light_sees_is_as_close_as_it_says(most: float, within: float) -> None:
    """By random numbers and incidences from grazing light to the normal; across the light a facet stays as drawn."""
    rng = np.random.default_rng(0)
    rms = 0.3
    for a, cosine in zip(most * rng.uniform(-1.0, 1.0, 2000), rng.random(2000) ** 2, strict=True):
        sine = np.sqrt(1.0 - cosine**2)
        exact = SEEN(a, cosine / (rms * sine)) - a
        assert added(rms, cosine, a * rms * sine)[0] * sine / rms == pytest.approx(exact, abs=within)


@pytest.mark.parametrize("cosine", [0.02, 0.5, 0.9999, 1.0 - 1e-7, -0.3])
@pytest.mark.parametrize("rms", [1e-4, 0.3])
def test_what_is_seen_changes_with_the_incidence_as_its_derivatives_say(rms: float, cosine: float) -> None:
    """By differences, also beside the place from which a series is summed; light from behind sees the other slopes."""
    along = 0.8 * rms * np.sqrt(1.0 - cosine**2)
    step = min(1e-5, 0.3 * (1.0 - abs(cosine)))
    terms = added(rms, cosine, along)
    by_c = [added(rms, cosine + sign * step, along)[0] for sign in (1.0, -1.0)]
    assert terms[1] == pytest.approx((by_c[0] - by_c[1]) / (2.0 * step), rel=2e-3, abs=1e-9)
    by_along = [added(rms, cosine, along + sign * 1e-4 * rms)[0] for sign in (1.0, -1.0)]
    assert terms[2] == pytest.approx((by_along[0] - by_along[1]) / (2e-4 * rms), rel=2e-3, abs=1e-9)
    other = added(rms, -cosine, -along)
    assert other == pytest.approx((-terms[0], terms[1], terms[2]), rel=1e-12)


@pytest.mark.parametrize(
    ("face", "angle_deg", "sigma_deg"), [("outer", 30.0, 4.0), ("inner", 60.0, 10.0), ("inner", 85.0, 20.0)]
)
def test_oblique_light_goes_on_as_the_facets_that_it_sees_send_it(
    face: str, angle_deg: float, sigma_deg: float
) -> None:
    """What passes, its mean direction and its spread, by quadrature over slopes; from air nothing is reflected totally.

    A mean slope alone had from air at 85 degrees 1 % of the light reflected totally, and twice the spread.
    """
    turn = np.radians(angle_deg)
    (radius, ratio) = {"inner": (2.0, 1.0 / N), "outer": (3.0, N)}[face]
    other = {"outer": {"cavity_index": N}, "inner": {"outside_index": N}}[face]  # the other face bends nothing
    media = replace(frosted(face, sigma_deg), **other)
    count = len(RAYS)
    place = np.tile([radius * np.sin(turn), 0.0, 0.1], (count, 1))
    numbers = np.random.default_rng(1).random((count, 2))
    rays = replace(RAYS, origins=place, directions=np.tile([0.0, 0.0, 1.0], (count, 1)), facets=numbers)
    tables = np.stack([tabulate(GRID, sphere(radius_mm)) for radius_mm in (2.0, 3.0)])
    exits = TracedBundle.of(tables, Scene(media, GRID, fresnel=False), rays).exits
    x, y = np.meshgrid(*[media.scatter[0].model.slope * np.linspace(-6.0, 6.0, 1201)] * 2)
    facets = np.stack([x, y, np.ones_like(x)], axis=-1) / np.sqrt(1.0 + x**2 + y**2)[..., None]
    way = np.array([np.sin(turn), 0.0, np.cos(turn)])  # in the frame of the face; x as light goes along it
    weights = np.exp(-0.5 * (x**2 + y**2) / media.scatter[0].model.slope ** 2)
    weights = weights * np.maximum(way[2] + x * way[0], 0.0)
    c = facets @ way
    q = np.sqrt(np.maximum(1.0 - ratio**2 * (1.0 - c**2), 0.0))
    behind = ratio * way + (q - ratio * c)[..., None] * facets
    passes = weights * (q > 0.0)
    share = passes.sum() / weights.sum()
    met = exits.fates != Fate.TOTAL_REFLECTION
    assert met.mean() == pytest.approx(share, abs=3e-3 if face == "outer" else 1e-12)
    to_face = np.column_stack([[-np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [np.sin(turn), 0.0, np.cos(turn)]])
    forwards = passes * (behind[..., 2] > 0.3)  # others come to the cavity again, or go down
    directions = exits.directions[exits.left_lens] @ to_face
    directions = directions[directions[:, 2] > 0.3]
    assert len(directions) / count == pytest.approx(forwards.sum() / weights.sum(), abs=3e-3)
    mean = (behind * forwards[..., None]).sum(axis=(0, 1)) / forwards.sum()
    squares = (behind**2 * forwards[..., None]).sum(axis=(0, 1)) / forwards.sum()
    assert directions.mean(axis=0) == pytest.approx(mean, abs=2e-3)
    assert (directions**2).mean(axis=0) == pytest.approx(squares, abs=2e-3)


def test_a_ray_meets_the_same_facets_alone_and_among_others() -> None:
    media = frosted("outer", 4.0)
    rays = upwards(3000, 2, 0.4)
    scene = Scene(media, GRID)
    order = np.random.default_rng(3).permutation(3000)
    whole = TracedBundle.of(SPHERES, scene, rays).exits.directions
    some = TracedBundle.of(SPHERES, scene, rays.take(order[:700])).exits.directions
    assert np.array_equal(some, whole[order[:700]])
    other = replace(rays, origins=rays.origins + 1e-12)
    assert np.abs(TracedBundle.of(SPHERES, scene, other).exits.directions - whole).max() > 0.01, "and no others"


def test_a_polished_face_costs_no_bits_and_one_face_does_not_scatter_for_another() -> None:
    plain = TracedBundle.of(SPHERES, Scene(clear(N), GRID), RAYS).exits
    for media in (frosted("inner", 3.0), frosted("outer", 3.0)):
        same = TracedBundle.of(SPHERES, Scene(media.polished, GRID), RAYS).exits
        assert np.array_equal(same.directions, plain.directions)
        assert (
            np.abs(TracedBundle.of(SPHERES, Scene(media, GRID), RAYS).exits.directions - plain.directions).max() > 0.1
        )
    drawn = facet_numbers(RAYS, keys_of_rays(RAYS), (GaussianFacets(0.1), None, GaussianFacets(0.1)))
    assert not drawn[:, 2:4].any()
    assert np.abs(np.corrcoef(drawn[:, [0, 1, 4, 5]].T) - np.eye(4)).max() < 0.012, "each face has its own"


def test_the_proof_draws_facets_of_its_own_with_the_same_light() -> None:
    media = frosted("outer", 8.0)
    proof, design = (FaceNumbers.of(with_facets(RAYS, 1), media, ("inner", "outer"), seed=seed) for seed in (7, None))
    normals = RAYS.directions
    faces = np.ones(len(RAYS), dtype=int)
    rms = np.full(len(RAYS), 0.25)
    numbers = [
        face_numbers.at(faces, np.full(len(RAYS), times)) for face_numbers in (proof, design) for times in (0, 1, 2)
    ]
    assert np.abs(np.corrcoef(np.column_stack(numbers).T) - np.eye(12)).max() < 0.012, "each time that a face is met"
    facets = [tilted(Arrival(*[normals] * 3), rms, number) for number in numbers]
    angles = [np.arccos((facet * normals).sum(axis=1)) for facet in facets]
    assert max(kstest(angle, angles[0]).statistic for angle in angles[1:]) < 1.95 * np.sqrt(2.0 / len(RAYS))
    away = tilted(Arrival(normals, -normals, normals), rms, numbers[3])
    assert np.array_equal(away, facets[3]), "a facet has one normal, from both sides"


def test_a_drawn_sample_has_quasi_random_facets_for_two_faces() -> None:
    """Sixteen equal parts of each pair of dimensions, of rays and facets alike, hold as many of 4096 rays."""
    square = SquareSource(side_mm=1.0)
    rays = build_source(square, facets=3).sample(4096, 5)
    assert np.array_equal(rays.origins, build_source(square).sample(4096, 5).origins)
    assert rays.facets is not None and rays.facets.shape == (4096, 4)
    place = np.column_stack([rays.origins[:, 0] + 0.5, rays.facets])
    for one in range(5):
        for other in range(one):
            cells = (4.0 * place[:, one]).astype(int) * 4 + (4.0 * place[:, other]).astype(int)
            assert set(np.bincount(cells, minlength=16)) == {256}, (one, other)
    scattered = facet_numbers(rays, keys_of_rays(rays), (GaussianFacets(0.1),) * 3)
    assert np.abs(scattered.std(axis=0) - 1.0).max() < 0.04 and np.abs(scattered[:, :4].mean(axis=0)).max() < 1e-3


def test_facets_of_a_made_part_add_to_those_of_the_design() -> None:
    made = AsMade(slopes={"outer": 0.08, "inner": 0.0})
    media = frosted("outer", 2.0)
    both = roughness(media, ("inner", "outer"), RAYS, made)
    assert not both.noise[:, :2].any()
    rms = np.hypot(0.08, media.scatter[0].model.slope)
    assert (both.noise * np.repeat(both.slopes, 2))[:, 2:].std(axis=0) == pytest.approx([rms, rms], rel=0.01)
    other = roughness(media, ("inner", "outer"), replace(RAYS, origins=RAYS.origins + 1e-9), made, before=1)
    assert np.abs(other.noise - both.noise).max() > 0.1


def test_the_proof_meets_the_facets_of_the_design_on_the_lens_and_on_a_body() -> None:
    """Ray by ray: a double lens, and the third face that scatters, on a body behind it; met again, too, from behind.

    Light comes at 40 degrees.
    """
    rays = with_facets(upwards(500, 4, 0.4), 3)
    names = ("inner", "outer")
    facets = (GaussianFacets(0.05), GaussianFacets(0.1))
    faces = np.tile([0, 1], 250)
    normals = rays.directions
    cosine = np.cos(np.radians(40.0))
    sine = np.sin(np.radians(40.0))
    sideways = np.cross(normals, [0.6, 0.8, 0.0])
    sideways /= np.linalg.norm(sideways, axis=1)[:, None]
    for before, kinds in ((0, facets), (2, (None, facets[0]))):
        seen = replace(clear(N), scatter=tuple(FaceScatter(n, f) for n, f in zip(names, kinds, strict=True) if f))
        draws = FaceNumbers.of(rays, seen, names, before)
        rms = np.array([0.0 if f is None else f.slope for f in kinds])[faces]
        keys = roughness(seen, names, rays, before=before).keys
        for times, sign in ((0, 1.0), (1, 1.0), (2, -1.0), (300, -1.0)):
            numbers = draws.at(faces, np.full(500, times))
            ways = sign * (cosine * normals + sine * sideways)
            tilted_normals = tilted(Arrival(normals, normals, ways), rms, numbers)
            drawn_numbers = facet_numbers(rays, keys_of_rays(rays), kinds, before)
            slopes = rms[:, None] * drawn_numbers.reshape(500, 2, 2)[np.arange(500), faces]
            if times:
                by_face = np.stack([numbers_again(keys, face, np.full(500, times)) for face in (0, 1)])
                radial, azimuthal = by_face[faces, np.arange(500)].T
                assert numbers[rms > 0.0] == pytest.approx(np.column_stack([radial, azimuthal])[rms > 0.0], abs=0.0)
                length = rms * np.sqrt(-2.0 * np.log(1.0 - radial))
                slopes = length[:, None] * np.column_stack(
                    [np.cos(2 * np.pi * azimuthal), np.sin(2 * np.pi * azimuthal)]
                )
            along = (slopes * normals[:, :2]).sum(axis=1) / (1.0 + normals[:, 2])
            tilts = np.column_stack([slopes, 0.0 * along]) - along[:, None] * (normals + np.eye(3)[2])
            drawn = sine * (tilts * sideways).sum(axis=1)
            more = [
                s * (SEEN(a / (s * sine), cosine / (s * sine)) - a / (s * sine)) if s else 0.0
                for s, a in zip(rms, drawn, strict=True)
            ]
            wanted = normals + tilts + np.array(more)[:, None] * sideways
            wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
            assert np.abs(tilted_normals - wanted).max() < 1e-10


def test_a_mirror_turns_light_by_twice_the_slope() -> None:
    assert gaussian(np.radians(10.0), FacetTurn(None)).slope == pytest.approx(np.tan(np.radians(5.0)), rel=1e-12)


@pytest.mark.parametrize(("sigma_deg", "allowed"), [(27.0, True), (28.5, False), (45.0, False)])
def test_a_face_that_would_turn_half_of_the_light_back_is_refused(sigma_deg: float, allowed: bool) -> None:
    section = GaussianScatter(sigma_deg=sigma_deg)
    if allowed:
        assert section.model(FacetTurn(N)).slope < 0.78
    else:
        with pytest.raises(ValueError, match="turned back; take a smaller angle"):
            section.model(FacetTurn(N))


ANGLES = [0.0, 5.0, 20.0, 60.0]
MEASURED = {
    "incidence_deg": [0.0, 40.0],
    "scattering_deg": ANGLES,
    "bsdf_per_sr": [[4.0, 2.0, 0.2, 0.0], [1.0, 1.0, 0.1, 0.1]],
}


def opal(face: str, model: RingScatter, **more: object) -> Media:
    return replace(clear(N, **more), scatter=(FaceScatter(face, model),))


def cosines_behind(model: RingScatter) -> np.ndarray:
    """Of light that came along the normal, behind a face that reflects nothing."""
    exits = TracedBundle.of(SPHERES, Scene(opal("outer", model), GRID, fresnel=False), RAYS).exits
    assert exits.left_lens.all()
    np.testing.assert_allclose(exits.flux, RAYS.flux, rtol=1e-12, err_msg="no light is made or lost")
    return np.clip((exits.directions * RAYS.directions).sum(axis=1), -1.0, 1.0)


def test_a_lambertian_share_looks_the_same_from_everywhere() -> None:
    """Of a Lambertian plate the squared sine is even; the rest goes straight on."""
    cosines = cosines_behind(LambertianScatter(kind="lambertian", share=0.7).model(FacetTurn(N)))
    spread = cosines < 1.0 - 1e-12
    assert spread.mean() == pytest.approx(0.7, abs=1e-3)
    assert kstest(1.0 - cosines[spread] ** 2, "uniform").statistic < 1.95 / np.sqrt(spread.sum())


@pytest.mark.parametrize(("a", "b", "g"), [(0.01, 1e-4, 2.0), (0.002, 1e-3, 2.6), (0.2, 0.5, 0.0)])
def test_a_finely_rough_face_scatters_as_the_abg_model_says(a: float, b: float, g: float) -> None:
    model = AbgScatter(kind="abg", a=a, b=b, g=g).model(FacetTurn(N))

    def within(s: float) -> float:
        return quad(lambda x: 2.0 * np.pi * x * a / (b + x**g), 0.0, s, limit=500, points=[min(s, 0.1 * s)])[0]

    assert model.shares[0][-1] == pytest.approx(within(1.0), rel=1e-7)
    if g == 2.0:
        assert model.shares[0][-1] == pytest.approx(np.pi * a * np.log1p(1.0 / b), rel=1e-7)
    sines = np.sqrt(1.0 - cosines_behind(model) ** 2)
    for s in (0.003, 0.03, 0.3, 0.8):
        share = 1.0 - within(1.0) + within(s)
        assert np.mean(sines <= s) == pytest.approx(share, abs=4.0 * np.sqrt(share * (1.0 - share) / len(RAYS)) + 1e-6)


def test_a_measured_face_scatters_by_its_table_between_its_incidences() -> None:
    """At an incidence with a row by the row; halfway between two cosines each ray by half of both amounts."""
    model = TableScatter(kind="table", **MEASURED).model(FacetTurn(N))
    rows = []
    for row in MEASURED["bsdf_per_sr"]:
        rows.append(quad(lambda x, row=row: 2.0 * np.pi * np.sin(x) * np.cos(x) * np.interp(np.degrees(x), ANGLES, row),
                         0.0, np.radians(60.0), points=np.radians(ANGLES[1:3]))[0])  # fmt: skip
    assert [share[-1] for share in model.shares] == pytest.approx(rows[::-1], rel=1e-4)
    cosines = cosines_behind(model)
    assert np.mean(cosines < 1.0 - 1e-12) == pytest.approx(rows[0], abs=3e-3)
    number = np.full(1, 0.9)
    steep, straight = model.amounts(number)[0]
    middle = 0.5 * (1.0 + np.cos(np.radians(40.0)))
    met = Spreading(model, np.array([[0.9, 0.0]]), np.array([[0.0, 0.0, 1.0]]), np.array([middle]))
    assert spread(np.array([[0.0, 0.0, 1.0]]), met)[0, 0] == pytest.approx(0.5 * (steep + straight), rel=1e-12)


@pytest.mark.parametrize("model", [lambertian(0.5), TableScatter(kind="table", **MEASURED).model(FacetTurn(N))])
def test_the_proof_spreads_each_ray_as_the_design_does(model: RingScatter) -> None:
    """Behind the outer face of a crooked lens, by the numbers of the rays."""
    tables = np.stack([tabulate(GRID, sphere(radius, lift)) for radius, lift in ((2.0, 0.3), (6.0, -2.5))])
    rays = with_facets(upwards(4000, 4, 1.2), 1)
    plain, rough = (
        TracedBundle.of(tables, Scene(media, GRID), rays).exits for media in (clear(N), opal("outer", model))
    )
    left = plain.left_lens
    points = plain.points[left]
    ways = plain.directions[left]
    wanted = rough.directions[left]
    normals = (points - [0.0, 0.0, -2.5]) / 6.0
    met = Arrival(points, -normals, refracted(ways, normals))
    directions = spread(ways, Spreading.of(model, rays.facets[left], met))
    assert left.sum() > 3500 and directions == pytest.approx(wanted, abs=2e-5), "of the tables"
    assert rough.flux == pytest.approx(plain.flux, rel=1e-12)


def refracted(outside: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Directions in the body of light that leaves it so: Snell backwards."""
    along = (outside * normals).sum(axis=1)
    squared = 1.0 - (1.0 - along**2) / N**2
    return outside / N + (np.sqrt(squared) - along / N)[:, None] * normals


def test_light_beyond_grazing_comes_back_by_as_much() -> None:
    """Of shift 0.9 along x on a direction of 0.5 along it, 1.4 is folded to 1/1.4; azimuth 0 by the numbers."""
    model = RingScatter((0.0, 0.9), ((0.0, 1.0),))
    met = Spreading(model, np.array([[1.0 - 1e-15, 0.0]]), np.eye(3)[2:], np.array([0.9]))
    directions = spread(np.array([[0.5, 0.0, np.sqrt(0.75)]]), met)
    assert directions[0] == pytest.approx([1.0 / 1.4, 0.0, np.sqrt(1.0 - 1.4**-2)], abs=1e-9)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        (lambda: AbgScatter(kind="abg", a=0.05, b=1e-4, g=2.0).model(FacetTurn(N)), "scatter 1.45 .*up to 0.0346"),
        (lambda: TableScatter(kind="table", incidence_deg=[0.0], scattering_deg=[0.0, 90.0], bsdf_per_sr=[[0.4, 0.4]])
            .model(FacetTurn(N)), "bsdf_per_sr at incidence_deg = 0: the face would scatter 1.26 of its light"),
        (lambda: TableScatter(kind="table", **MEASURED | {"bsdf_per_sr": [[1.0, 1.0]]}), "must be 2 rows"),
        (lambda: TableScatter(kind="table", **MEASURED | {"scattering_deg": [5.0, 6.0, 7.0, 8.0]}), "must rise from 0"),
        (lambda: TableScatter(kind="table", **MEASURED | {"bsdf_per_sr": [[1.0, -1.0, 0.0, 0.0]] * 2}), "bsdf_per_sr"),
    ],
)  # fmt: skip
def test_no_face_scatters_more_light_than_it_takes(section: Callable[[], object], message: str) -> None:
    with pytest.raises((ValueError, InputError), match=message):
        section()


def test_a_table_of_scatter_is_read_from_its_file(tmp_path: Path) -> None:
    rows = [(i, s, MEASURED["bsdf_per_sr"][k][j]) for k, i in enumerate((0.0, 40.0)) for j, s in enumerate(ANGLES)]
    text = "incidence_deg,scattering_deg,bsdf\n" + "".join(f"{i},{s},{v}\n" for i, s, v in rows)
    (tmp_path / "film.csv").write_text(text)
    (tmp_path / "gap.csv").write_text(text.rsplit("\n", 2)[0] + "\n")
    read = TableScatter.model_validate({"kind": "table", "file": tmp_path / "film.csv"})
    assert read == TableScatter(kind="table", **MEASURED)
    with pytest.raises(
        (ValueError, InputError), match="7 rows for 2 angles of incidence and 4 of scattering; must be one a pair"
    ):
        TableScatter.model_validate({"kind": "table", "file": tmp_path / "gap.csv"})
