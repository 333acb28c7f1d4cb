from dataclasses import replace

import numpy as np
import pytest
import trimesh
from lens_meshes import DISTANCE, INDEX, INNER, OUTER, Quadric, lambertian, oracle, right
from nightly import first_by_day

from lensforge.errors import InputError
from lensforge.optics.media import FaceScatter, Media, Medium
from lensforge.optics.scattering import GaussianFacets, RingScatter
from lensforge.proof.acceptance import brep_criteria
from lensforge.proof.cast_results import BrepCast
from lensforge.proof.facet_casting import Grid
from lensforge.proof.optical_faces import USUAL_LENS
from lensforge.proof.part_comparison import Expected, IndependentLight
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_result import Proof
from lensforge.proof.receiver_screen import FarFieldScreen, Screen
from lensforge.proof.sequential_cast import send_through
from lensforge.proof.verification import FilesOfPart, LightOfDesign, Referees, verify_part
from lensforge.results import Metric
from lensforge.scene.rough_faces import with_facets

SIDE = 300.0
PIXELS = 64
RAYS = lambertian(8000, 2.0, seed=1)
HITS, WEIGHTS, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
SCREEN = Screen.square(DISTANCE, SIDE, PIXELS)


def moved(surface, axis, by):
    centre = np.array(surface.centre)
    centre[axis] += by
    return Quadric(tuple(centre), surface.semi_axes)


@pytest.fixture(scope="module")
def design_irradiance():
    many = lambertian(400_000, 2.0, seed=2)
    landings, flux, _ = oracle(INNER, OUTER, many, INDEX, DISTANCE)
    return SCREEN.irradiance(landings, flux)


@pytest.fixture
def verify(design_irradiance):
    right = Expected(SCREEN, design_irradiance, HITS, WEIGHTS)

    def run(mesh, plain_rays=20, index=INDEX, inputs=None, step=None, rays=RAYS, **changes):
        files = FilesOfPart(mesh.export(file_type="stl"), step, inputs=inputs or {})
        light = LightOfDesign(rays, Media(Medium(index)), [replace(right, **changes)])
        return verify_part(files, light, Referees(plain_rays))

    return run


MADE_FROM = dict.fromkeys(("lens", "export", "evaluate"), "0" * 64)


def failed(result):
    return {criterion.key for criterion in result.criteria if not criterion.holds}


def test_the_right_lens_passes_and_is_the_same_when_read_back(verify, tmp_path, design_irradiance):
    result = verify(right(), inputs=MADE_FROM)
    assert failed(result) == set()
    assert result.inputs == MADE_FROM
    result.write(tmp_path)
    assert Proof.read(tmp_path) == result
    assert result.first.irradiance.shape == (PIXELS, PIXELS)
    np.testing.assert_array_equal(result.first.design_irradiance, design_irradiance)
    assert sum(result.first.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    assert result.efficiency == pytest.approx(np.nansum(WEIGHTS[np.abs(HITS).max(axis=1) <= SIDE / 2]), rel=1e-4)
    assert result.nmse_vs_design == pytest.approx(result.noise_floor_nmse, rel=0.25)
    assert result.first.nmse_same_rays < 0.01 * result.noise_floor_nmse
    assert result.deviation_mm.rms < result.deviation_mm.p99 < result.deviation_mm.max < 0.05
    assert result.plain_cast.casts == 40
    assert result.plain_cast.disagreements == 0


@pytest.mark.parametrize(
    ("model", "spread_rad"),
    [(GaussianFacets(0.1), (INDEX - 1.0) * 0.1), (RingScatter((0.0, 0.2), ((0.0, 1.0),)), 0.1)],
)
def test_rays_of_a_lens_that_scatters_are_compared_one_by_one_where_it_is_polished(
    design_irradiance, model, spread_rad
):
    """The light is that behind facets or rings; the limit leaves a hundredth of the spread."""
    light = Expected(SCREEN, design_irradiance, HITS, WEIGHTS)
    media = Media(Medium(INDEX), scatter=(FaceScatter("outer", model),))
    file = FilesOfPart(right().export(file_type="stl"))
    seen = with_facets(RAYS, 1)
    plain, rough, wrong = (
        verify_part(file, design, Referees(20)).first
        for design in (
            LightOfDesign(RAYS, Media(Medium(INDEX)), [light]),
            LightOfDesign(seen, media, [light], [light]),
            LightOfDesign(seen, media, [light]),
        )
    )
    assert rough.against_design == plain.against_design and wrong.against_design.rms > 10.0
    assert rough.flux != plain.flux and rough.nmse_same_rays > 100.0 * plain.nmse_same_rays
    more = 1.0 + 0.01 * spread_rad / 1e-4
    assert rough.deviation_limit_mm == pytest.approx(more * plain.deviation_limit_mm, rel=1e-12)


def test_own_rays_meet_the_rough_faces_of_a_part_by_facets_of_their_own():
    """By other rays and other facets a frosted lens has the light of the design; a polished lens has other light."""
    media = Media(Medium(INDEX), scatter=(FaceScatter("outer", GaussianFacets(0.6)),))
    screen = Screen.square(DISTANCE, SIDE, 12)
    mesh = right().export(file_type="stl")
    part = read_part_mesh(mesh, USUAL_LENS)
    many = send_through(part, Grid(part.mesh), with_facets(lambertian(40_000, 2.0, seed=5), 1), media).landed(screen)
    seen = with_facets(RAYS, 1)
    independent = IndependentLight(
        lambertian(20_000, 2.0, seed=6), ((Metric(value=0.9, standard_error=0.001), 0.0),), 7
    )
    design = Expected(screen, screen.irradiance(many.landings, many.flux), HITS, WEIGHTS)
    frosted, polished = (
        verify_part(
            FilesOfPart(mesh), LightOfDesign(seen, finish, [design], [design], independent=independent), Referees(20)
        ).first
        for finish in (media, media.polished)
    )
    off = frosted.own_rays.nmse_less_noise
    assert abs(off.value) < 0.002 + 4.0 * off.standard_error, "the noise of the design's rays"
    assert polished.own_rays.nmse_less_noise.value > 0.3


def test_a_step_file_is_refused_before_any_ray_is_cast(verify, monkeypatch):
    def cast(*_):
        raise AssertionError("cast")

    monkeypatch.setattr("lensforge.proof.verification.send_through", cast)
    with pytest.raises(InputError, match="STEP"):
        verify(right(), step=b"no STEP file")


WRONG = {
    "mirrored": lambda: right().apply_transform(np.diag([-1.0, 1.0, 1.0, 1.0])),
    "upside down": lambda: right().apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1.0, 0.0, 0.0])),
    "turned": lambda: right().apply_transform(trimesh.transformations.rotation_matrix(0.01, [0.0, 0.0, 1.0])),
    "raised 20 um": lambda: right().apply_translation([0.0, 0.0, 0.02]),
    "inner 20 um to +x": lambda: right(inner=moved(INNER, 0, 0.02)),
    "inner 20 um up": lambda: right(inner=moved(INNER, 2, 0.02)),
    "outer 20 um to -y": lambda: right(outer=moved(OUTER, 1, -0.02)),
    "outer 20 um down": lambda: right(outer=moved(OUTER, 2, -0.02)),
}


@pytest.mark.parametrize("name", first_by_day(3, WRONG, "other ways to be wrong"))
def test_a_lens_exported_wrongly_fails(verify, name):
    result = verify(WRONG[name](), plain_rays=1)
    assert "deviation_rms" in failed(result)
    assert sum(result.first.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)


def test_facets_that_face_inwards_are_named(verify):
    mesh = right()
    mesh.invert()
    missed = [criterion for criterion in verify(mesh, plain_rays=1).criteria if not criterion.holds]
    assert missed and any("facets face inwards" in str(criterion) for criterion in missed)


def test_a_mesh_too_coarse_for_the_light_is_told_of_a_finer_one(verify):
    missed = [str(criterion) for criterion in verify(right(rings=8), plain_rays=1).criteria if not criterion.holds]
    assert any("finer mesh: without --rings" in message for message in missed)


def test_the_deviation_of_landings_is_their_root_mean_square(verify):
    """One landing of ten is 1 mm off, the others by what the facets of the mesh make: less than a tenth of it."""
    off = np.zeros_like(HITS)
    off[::10, 0] = 1.0
    deviation = verify(right(), plain_rays=1, landings=HITS + off).deviation_mm
    assert deviation.rms == pytest.approx(np.sqrt(0.1), rel=0.05)
    assert deviation.p99 == pytest.approx(1.0, abs=0.1)


def directions_of(ways):
    """Places of directions on the chart of the far field: a radius of 2 sin(gamma / 2)."""
    return ways[:, :2] * np.sqrt(2.0 / (1.0 + ways[:, 2:]))


def test_gaps_of_directions_are_mm_at_one_metre(verify):
    """The outer face is off by so much that its light is by more than a STEP file's may be, and less than a mesh's."""
    chart = 4.0 * np.sin(np.radians(30.0))
    far = FarFieldScreen((0.0,) * 3, (0.0, 0.0, 1.0), 0.0, chart, chart, 16, 16, (None, None, 1.0))
    wrong = moved(OUTER, 1, -0.002)
    _, flux, ways = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
    _, _, others = oracle(INNER, wrong, RAYS, INDEX, DISTANCE)
    here = directions_of(ways)
    there = directions_of(others)
    both = (abs(here).max(axis=1) < chart / 2) & (abs(there).max(axis=1) < chart / 2)
    gaps = 1000.0 * np.linalg.norm(here - there, axis=1)[both]
    light = far.irradiance(here, flux)
    judgement = verify(right(48, outer=wrong), plain_rays=1, screen=far, landings=here, irradiance=light).first
    assert judgement.against_design.rms == pytest.approx(np.sqrt(np.mean(gaps**2)), rel=0.02)
    assert judgement.against_design.p99 == pytest.approx(np.quantile(gaps, 0.99), rel=0.05)
    assert judgement.against_design.max == pytest.approx(gaps.max(), rel=0.1)
    assert judgement.deviation_limit_mm == pytest.approx(0.1) and 0.05 < judgement.against_design.rms < 0.1
    cast = BrepCast(
        rays=1024, seconds=1.0, against_design=judgement.against_design, against_mesh=judgement.against_design
    )
    limits = {criterion.key: (criterion.limit, criterion.holds) for criterion in brep_criteria(cast, 1000.0)}
    assert limits["brep_deviation_rms"] == (pytest.approx(0.05), False), "half of the mesh's"


def test_a_wrong_index_fails(verify):
    assert "deviation_rms" in failed(verify(right(), index=INDEX + 0.001, plain_rays=1))


def test_light_that_meets_the_wall_of_the_opening_is_lost_at_the_base(verify):
    """A thousand rays go level half a millimetre below z = 0, where the base's opening has its wall."""
    turn = np.linspace(0.0, 2.0 * np.pi, 1000)
    origins = RAYS.origins.copy()
    directions = RAYS.directions.copy()
    origins[:1000, 2] = -0.5
    directions[:1000] = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    hits = HITS.copy()
    flux = WEIGHTS.copy()
    hits[:1000] = np.nan
    flux[:1000] = 0.0
    rays = replace(RAYS, origins=origins, directions=directions)
    first = verify(right(), landings=hits, flux=flux, plain_rays=1, rays=rays).first
    assert first.flux.missed == pytest.approx(0.125, abs=2e-3)  # others meet it as they did
    assert sum(first.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)


def test_a_window_smaller_than_the_receiver_counts_less(verify):
    result = verify(right(), screen=replace(SCREEN, window=(100.0, 100.0, None)), plain_rays=1)
    assert result.efficiency == pytest.approx(np.nansum(WEIGHTS[np.abs(HITS).max(axis=1) <= 50.0]), rel=1e-2)
    assert result.efficiency < 0.5 * np.nansum(WEIGHTS[np.abs(HITS).max(axis=1) <= SIDE / 2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"landings": HITS[:-1]}, "expected landings: shape"),
        ({"flux": WEIGHTS[:-1]}, "expected flux: shape"),
        ({"irradiance": np.ones((3, 3))}, "expected irradiance: shape"),
        ({"irradiance": np.zeros((PIXELS, PIXELS))}, "must be above 0"),
    ],
)
def test_what_does_not_fit_is_input_error(verify, change, message):
    with pytest.raises(InputError, match=message):
        verify(right(rings=6), **change, plain_rays=1)
