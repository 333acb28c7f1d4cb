"""Faces that scatter: closed forms, energy, the proof's own facets and rings, and what no facets do."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chains import clear, upwards
from scipy.integrate import quad
from scipy.stats import kstest

from lensforge.errors import InputError
from lensforge.kernels.facet_normals import seen_slope
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import FaceScatter, Media
from lensforge.optics.scattering import FacetTurn, GaussianFacets, RingScatter, gaussian, lambertian
from lensforge.proof.facet_tilt import Arrival, slopes_of, tilted
from lensforge.proof.refraction import LitRays
from lensforge.proof.ring_spread import Spreading, spread
from lensforge.scene.made_part import AsMade
from lensforge.scene.rough_faces import facet_slopes, roughness, with_facets
from lensforge.sources.build_source import build_source
from lensforge.spec.scatter_section import AbgScatter, GaussianScatter, LambertianScatter, TableScatter
from lensforge.spec.source_sections import SquareSource
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

N, GRID = 1.49, TableGrid(161)
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
    assert exits.flux[out] == pytest.approx(RAYS.flux[out], rel=1e-12), "no light is made or lost"
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
    slope, ratio = media.scatter[0].model.slope, (1.0 / N if face == "inner" else N)

    def passed(m: float) -> float:
        c, s = np.cos(m), ratio * np.sin(m)
        if s >= 1.0:
            return 0.0
        q = np.sqrt(1.0 - s * s)
        reflected = [((ratio * c - q) / (ratio * c + q)) ** 2, ((c - ratio * q) / (c + ratio * q)) ** 2]
        return 1.0 - 0.5 * sum(reflected)

    def weighted(x: float) -> float:
        return passed(np.arctan(slope * x)) * x * np.exp(-0.5 * x * x)

    found = TracedBundle.of(SPHERES, Scene(media, GRID), RAYS).exits
    wanted = quad(weighted, 0.0, 12.0, epsabs=1e-12)[0]
    if face == "outer":
        wanted *= 4.0 * N / (N + 1.0) ** 2
        assert found.flux[found.left_lens].sum() == pytest.approx(wanted, abs=2e-4)
    else:
        lit = LitRays.of(with_facets(RAYS, 1), media, ("inner", "outer"))
        facets = tilted(Arrival(*[RAYS.directions] * 3), lit.slopes, np.zeros(len(RAYS), dtype=int), 0)
        angles = np.arccos(np.minimum((facets * RAYS.directions).sum(axis=1), 1.0))
        assert np.mean([passed(m) for m in angles[:20_000]]) == pytest.approx(wanted, abs=2e-4)


@pytest.mark.parametrize("rms", [1e-3, 0.05, 0.3])
@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 60.0, 85.0, 89.9, 120.0])
def test_light_sees_the_facets_that_face_it(rms: float, angle_deg: float) -> None:
    """Mean slope along the light of normal slopes, each by the area that the light sees: of Rayleigh's at grazing."""
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    area = [lambda x, k=k: x**k * max(abs(cosine) + rms * x * sine, 0.0) * np.exp(-0.5 * x * x) for k in (0, 1)]
    bend = max(-abs(cosine) / (rms * max(sine, 1e-9)), -9.0)
    lit, along = (quad(each, -9.0, 9.0, points=[bend], epsabs=1e-13)[0] for each in area)
    assert abs(seen_slope.py_func(rms**2, cosine)[0] * sine) == pytest.approx(rms * along / lit, rel=0.08, abs=1e-12)
    assert (seen_slope.py_func(rms**2, cosine)[0] > 0.0) == (cosine > 0.0)


def test_oblique_light_leaves_as_the_facets_that_it_sees_send_it() -> None:
    """At 30 degrees to the outer face, in the lens: what passes, and its mean direction, by quadrature over slopes."""
    turn, media = np.radians(30.0), replace(frosted("outer", 4.0), cavity_index=N)
    place = np.tile([3.0 * np.sin(turn), 0.0, 0.1], (len(RAYS), 1))
    numbers = np.random.default_rng(1).random((len(RAYS), 2))
    rays = replace(RAYS, origins=place, directions=np.tile([0.0, 0.0, 1.0], (len(RAYS), 1)), facets=numbers)
    tables = np.stack([tabulate(GRID, sphere(radius)) for radius in (2.0, 3.0)])
    exits = TracedBundle.of(tables, Scene(media, GRID, fresnel=False), rays).exits
    x, y = np.meshgrid(*[media.scatter[0].model.slope * np.linspace(-6.0, 6.0, 601)] * 2)
    facets = np.stack([x, y, np.ones_like(x)], axis=-1) / np.sqrt(1.0 + x**2 + y**2)[..., None]
    way = np.array([np.sin(turn), 0.0, np.cos(turn)])  # in the frame of the face; x as light goes along it
    weights = np.exp(-0.5 * (x**2 + y**2) / media.scatter[0].model.slope ** 2) * (way[2] + x * way[0])
    c = facets @ way
    q = np.sqrt(np.maximum(1.0 - N**2 * (1.0 - c**2), 0.0))
    behind, passes = N * way + (q - N * c)[..., None] * facets, weights * (q > 0.0)
    share = passes.sum() / weights.sum()
    assert exits.left_lens.mean() == pytest.approx(share, abs=3e-3)
    mean = (behind * passes[..., None]).sum(axis=(0, 1)) / passes.sum()
    left = exits.directions[exits.left_lens].mean(axis=0)
    found = left @ np.column_stack(
        [[-np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [np.sin(turn), 0.0, np.cos(turn)]]
    )
    assert found == pytest.approx(mean, abs=2e-3)


def test_a_ray_meets_the_same_facets_alone_and_among_others() -> None:
    media, rays = frosted("outer", 4.0), upwards(3000, 2, 0.4)
    scene, order = Scene(media, GRID), np.random.default_rng(3).permutation(3000)
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
    drawn = facet_slopes(RAYS, (GaussianFacets(0.1), None, GaussianFacets(0.1)))
    assert not drawn[:, 2:4].any()
    assert np.abs(np.corrcoef(drawn[:, [0, 1, 4, 5]].T) - np.eye(4)).max() < 0.012, "each face has its own"


def test_the_proof_draws_facets_of_its_own_with_the_same_light() -> None:
    media = frosted("outer", 8.0)
    own, design = (slopes_of(with_facets(RAYS, 1), media, ("inner", "outer"), seed=seed) for seed in (7, None))
    assert np.abs(own - design).max() > 0.1
    normals, faces = RAYS.directions, np.ones(len(RAYS), dtype=int)
    facets = [tilted(Arrival(*[normals] * 3), each, faces, 1) for each in (own, design)]
    angles = [np.arccos((each * normals).sum(axis=1)) for each in facets]
    assert kstest(*angles).statistic < 1.95 * np.sqrt(2.0 / len(RAYS))
    away = tilted(Arrival(normals, -normals, normals), design, faces, 1)
    assert np.array_equal(away, facets[1]), "a facet has one normal, from both sides"


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
    scattered = facet_slopes(rays, (GaussianFacets(0.1), GaussianFacets(0.1), GaussianFacets(0.1)))
    assert np.abs(scattered.std(axis=0) - 0.1).max() < 0.004 and np.abs(scattered[:, :4].mean(axis=0)).max() < 1e-4


def test_facets_of_a_made_part_add_to_those_of_the_design() -> None:
    made, media = AsMade(slopes={"outer": 0.08, "inner": 0.0}), frosted("outer", 2.0)
    both = roughness(media, ("inner", "outer"), RAYS, made)
    assert not both.noise[:, :2].any()
    rms = np.hypot(0.08, media.scatter[0].model.slope)
    assert (both.noise * np.repeat(both.slopes, 2))[:, 2:].std(axis=0) == pytest.approx([rms, rms], rel=0.01)
    other = roughness(media, ("inner", "outer"), replace(RAYS, origins=RAYS.origins + 1e-9), made, before=1)
    assert np.abs(other.noise - both.noise).max() > 0.1


def test_the_proof_meets_the_facets_of_the_design_on_the_lens_and_on_a_body() -> None:
    """Ray by ray: a double lens, and the third face that scatters, on a body behind it; at a second event, too.

    Light comes at 40 degrees: the facets that it sees have a mean slope along the face, of about s^2 tan 40 deg.
    """
    rays, names = with_facets(upwards(500, 4, 0.4), 3), ("inner", "outer")
    facets, faces = (GaussianFacets(0.05), GaussianFacets(0.1)), np.tile([0, 1], 250)
    media = replace(clear(N), scatter=tuple(FaceScatter(*each) for each in zip(names, facets, strict=True)))
    normals, (cosine, sine) = rays.directions, (np.cos(np.radians(40.0)), np.sin(np.radians(40.0)))
    sideways = np.cross(normals, [0.6, 0.8, 0.0])
    sideways /= np.linalg.norm(sideways, axis=1)[:, None]
    ways = cosine * normals + sine * sideways
    for before, kinds in ((0, facets), (2, (None, facets[0]))):
        seen = replace(media, scatter=tuple(FaceScatter(n, f) for n, f in zip(names, kinds, strict=True) if f))
        slopes = slopes_of(rays, seen, names, before)
        own, rms = slopes.reshape(500, 2, 3)[:, :, :2], np.array([0.0 if f is None else f.slope for f in kinds])[faces]
        assert own.reshape(500, 4) == pytest.approx(facet_slopes(rays, kinds, before), abs=1e-14)
        for event in (0, 1, 2, 3, 4):
            found = tilted(Arrival(normals, normals, ways), slopes, faces, event)
            x, y = own[np.arange(500), faces].T
            wanted = np.column_stack([x, y, 0.0 * x])
            quarter = (event - faces) % 4
            wanted[:, 0], wanted[:, 1] = (
                np.choose(quarter, [x, -y, -x, y]),
                np.choose(quarter, [y, x, -y, -x]),
            )
            along = (wanted[:, :2] * normals[:, :2]).sum(axis=1) / (1.0 + normals[:, 2])
            wanted = normals + wanted - along[:, None] * (normals + np.eye(3)[2])
            wanted += (rms**2 * sine / np.sqrt(cosine**2 + 2.0 / np.pi * (rms * sine) ** 2))[:, None] * sideways
            wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
            assert np.abs(found - wanted).max() < 1e-13


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
    assert exits.flux == pytest.approx(RAYS.flux, rel=1e-12), "no light is made or lost"
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
    assert [each[-1] for each in model.shares] == pytest.approx(rows[::-1], rel=1e-4)
    cosines = cosines_behind(model)
    assert np.mean(cosines < 1.0 - 1e-12) == pytest.approx(rows[0], abs=3e-3)
    number = np.full(1, 0.9)
    steep, straight = model.amounts(number)[0]
    middle = 0.5 * (1.0 + np.cos(np.radians(40.0)))
    met = Spreading(model, np.array([[0.9, 0.0]]), np.array([[0.0, 0.0, 1.0]]), np.array([middle]), np.array([0]))
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
    points, ways, wanted = plain.points[left], plain.directions[left], rough.directions[left]
    normals = (points - [0.0, 0.0, -2.5]) / 6.0
    met = Arrival(points, -normals, refracted(ways, normals))
    found, again = (spread(ways, Spreading.of(model, rays.facets[left], met, turns)) for turns in (0, 1))
    assert left.sum() > 3500 and found == pytest.approx(wanted, abs=2e-5), "of the tables"
    assert np.abs(again - wanted).max() > 0.1, "another shift when met again"
    assert rough.flux == pytest.approx(plain.flux, rel=1e-12)


def refracted(outside: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Directions in the body of light that leaves it so: Snell backwards."""
    along = (outside * normals).sum(axis=1)
    squared = 1.0 - (1.0 - along**2) / N**2
    return outside / N + (np.sqrt(squared) - along / N)[:, None] * normals


def test_light_beyond_grazing_comes_back_by_as_much() -> None:
    """Of shift 0.9 along x on a direction of 0.5 along it, 1.4 is folded to 1/1.4; azimuth 0 by the numbers."""
    model = RingScatter((0.0, 0.9), ((0.0, 1.0),))
    met = Spreading(model, np.array([[1.0 - 1e-15, 0.0]]), np.eye(3)[2:], np.array([0.9]), np.array([0]))
    found = spread(np.array([[0.5, 0.0, np.sqrt(0.75)]]), met)
    assert found[0] == pytest.approx([1.0 / 1.4, 0.0, np.sqrt(1.0 - 1.4**-2)], abs=1e-9)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        (lambda: AbgScatter(kind="abg", a=0.05, b=1e-4, g=2.0).model(FacetTurn(N)), "scatter 1.45 .*up to 0.0346"),
        (lambda: TableScatter(kind="table", incidence_deg=[0.0], scattering_deg=[0.0, 90.0], bsdf_per_sr=[[0.4, 0.4]])
            .model(FacetTurn(N)), "bsdf_per_sr at incidence_deg = 0: the face would scatter 1.26 of its light"),
        (lambda: TableScatter(kind="table", **MEASURED | {"bsdf_per_sr": [[1.0, 1.0]]}), "must be 2 rows"),
        (lambda: TableScatter(kind="table", **MEASURED | {"scattering_deg": [5.0, 6.0, 7.0, 8.0]}), "must rise from 0"),
        (lambda: TableScatter(kind="table", **MEASURED | {"bsdf_per_sr": [[1.0, -1.0, 0.0, 0.0]] * 2}), "bsdf_per_sr"),
    ],
)  # fmt: skip
def test_no_face_scatters_more_light_than_it_takes(section: Callable[[], object], words: str) -> None:
    with pytest.raises((ValueError, InputError), match=words):
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
