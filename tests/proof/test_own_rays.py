"""Rays that verification draws itself: their moments by closed forms, and a broken sampler that they alone catch."""

import numpy as np
import pytest
from lens_meshes import lambertian
from nightly import first_by_day
from scenes import small_spec

import lensforge as lf
from lensforge.light.lens_light import source_of
from lensforge.proof import independent_draws
from lensforge.proof.acceptance import MOST_APART
from lensforge.proof.part_comparison import RAYS, emission_difference
from lensforge.proof.proof_inputs import independent_rays
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.spec import Spec

COUNT = 200_000
OWN = {"own_rays_emission", "own_rays_efficiency", "own_rays_nmse"}


def random() -> np.random.Generator:
    return np.random.default_rng(1)


def near(values: np.ndarray, wanted: float) -> bool:
    """True where the mean of ``values`` is ``wanted`` within five standard errors."""
    return bool(abs(values.mean() - wanted) < 5.0 * values.std() / np.sqrt(len(values)) + 1e-12)


def test_a_picture_is_upright_and_as_bright_as_its_pixels() -> None:
    points = independent_draws.in_picture(random(), COUNT, np.array([[0.0, 3.0, 0.0], [1.0, 0.0, 0.0]]), 3.0)
    top = points[:, 1] > 0.0
    assert near(top.astype(float), 0.75)
    assert near(points[top, 0], 0.0) and near(points[~top, 0], -1.0) and near(points[top, 1], 0.5)


def test_a_table_of_a_cosine_is_that_cosine_and_its_half_planes_lie_where_they_say() -> None:
    gamma = np.linspace(0.0, 90.0, 361)
    lambert = np.cos(np.radians(gamma))
    z = independent_draws.along_table(random(), COUNT, np.zeros(1), gamma, lambert[None])[:, 2]
    assert near(z, 2.0 / 3.0) and near(z**2, 0.5)
    planes = np.array([0.0, 90.0, 180.0, 270.0, 360.0])
    lobes = np.outer([1.0, 2.0, 1.0, 0.0, 1.0], lambert)  # 1 + sin(C), linear in between
    y = independent_draws.along_table(random(), COUNT, planes, gamma, lobes)
    turn = np.arctan2(y[:, 1], y[:, 0])
    # The mean of sin(C) under 1 + the triangle wave: the wave's first harmonic is 8 / pi^2, half of it is left.
    assert near(np.sin(turn), 4.0 / np.pi**2) and near(np.cos(turn), 0.0)


def test_a_radiance_is_even_in_its_cells_and_lambertian_where_it_is_constant() -> None:
    x = np.array([0.0, 1.0, 3.0])
    y = np.array([-1.0, 0.0])
    gamma = np.array([0.0, 45.0, 90.0])
    radiance = np.array([1.0, 2.0])[None, :, None, None] * np.ones((1, 2, 1, 3))
    rows = independent_draws.of_radiance(random(), COUNT, (x, y), np.zeros(1), gamma, radiance)
    right = rows[:, 0] > 1.0
    assert near(right.astype(float), 0.8)  # twice as wide and twice as bright
    assert near(rows[:, 1], -0.5) and near(rows[:, 4], 2.0 / 3.0) and near(rows[:, 4] ** 2, 0.5)


def test_wavelengths_follow_a_density_that_is_linear_between_nodes() -> None:
    nodes = np.array([400.0, 500.0, 700.0])
    density = np.array([0.0, 1.0, 0.0])
    waves = independent_draws.wavelengths(random(), COUNT, nodes, density)
    assert near(waves, (400.0 + 500.0 + 700.0) / 3.0)
    assert near((waves < 500.0).astype(float), 1.0 / 3.0)
    assert set(independent_draws.wavelengths(random(), 5, np.array([633.0]), np.ones(1))) == {633.0}


def spec_of(source: dict[str, object]) -> Spec:
    return small_spec(source=source)


SOURCES = {
    "square": {"kind": "square", "side_mm": 2.0, "flux_w": 3.0},
    "rectangle": {"kind": "rectangle", "width_mm": 2.0, "height_mm": 1.0, "intensity": {"kind": "cosine", "power": 3}},
    "disc": {"kind": "disc", "diameter_mm": 1.5},
    "chips": {
        "kind": "chips",
        "chips": [
            {"x_mm": 1.0, "y_mm": 0.5, "width_mm": 0.5, "height_mm": 1.0, "flux_w": 2.0},
            {"x_mm": -1.0, "y_mm": 0.0, "width_mm": 1.0, "height_mm": 1.0},
        ],
    },
    "array": {
        "kind": "chip_array", "columns": 3, "rows": 2, "width_mm": 0.5, "height_mm": 0.4, "pitch_mm": [0.7, 0.9],
        "intensity": {"kind": "table", "gamma_deg": [0.0, 30.0, 80.0], "intensity": [1.0, 3.0, 0.0]},
    },
    "placed": {
        "kind": "disc", "diameter_mm": 1.0, "rotate_z_deg": 20.0, "tilt_deg": [30.0, -40.0],
        "position_mm": [0.1, 0.2, 0.3],
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SOURCES)
def test_the_design_draws_the_same_light(name: str) -> None:
    """First and second moments of position and direction, within the noise of independent rays."""
    spec = spec_of(SOURCES[name])
    source = source_of(spec)
    proof_rays = independent_rays(spec, source, COUNT, 1)
    design = source.sample(2**16, 2)
    assert proof_rays.flux.sum() == pytest.approx(source.flux_w, rel=1e-12)
    columns, wanted = (np.column_stack([rays.origins, rays.directions]) for rays in (proof_rays, design))
    for k in range(6):
        for m in range(k, 6):
            assert near(columns[:, k] * columns[:, m], float(np.mean(wanted[:, k] * wanted[:, m]))), (k, m)


def test_rays_of_a_file_are_drawn_by_their_flux() -> None:
    rays = lambertian(50, 1.0)
    flux = np.linspace(0.0, 2.0, 50)
    emitter = RaySetEmitter(RayBundle(rays.origins, rays.directions, flux), 4.0)
    drawn = independent_rays(spec_of(SOURCES["square"]), emitter, COUNT, 1)
    assert drawn.flux.sum() == pytest.approx(4.0)
    assert near(drawn.directions[:, 0], float(rays.directions[:, 0] @ flux / flux.sum()))


class TwiceAsLarge:
    """The sampler of the square with a broken line: start points twice as far out."""

    @staticmethod
    def sample(emitter: SquareEmitter, count: int, seed: int) -> RayBundle:
        rays = TRUE_SAMPLE(emitter, count, seed)
        return RayBundle(2.0 * rays.origins, rays.directions, rays.flux)


class Narrower:
    """The sampler with a wrong exponent: cosines with a power of 1.5 in place of 1."""

    @staticmethod
    def sample(emitter: SquareEmitter, count: int, seed: int) -> RayBundle:
        rays = TRUE_SAMPLE(emitter, count, seed)
        cosine = rays.directions[:, 2:] ** (2.0 / 2.5)
        across = rays.directions[:, :2]
        across = across / np.linalg.norm(across, axis=1, keepdims=True) * np.sqrt(1.0 - cosine**2)
        return RayBundle(rays.origins, np.hstack([across, cosine]), rays.flux)


TRUE_SAMPLE = SquareEmitter.sample


@pytest.mark.parametrize("broken", [TwiceAsLarge, Narrower])
def test_a_broken_sampler_is_many_standard_errors_off(broken: type) -> None:
    emitter = SquareEmitter(2.0, 3.0)
    spec = spec_of(SOURCES["square"])
    proof_rays = independent_rays(spec, emitter, RAYS, 1)
    assert emission_difference(proof_rays, emitter.sample(RAYS, 2)) < MOST_APART
    assert emission_difference(proof_rays, broken.sample(emitter, RAYS, 2)) > 3.0 * MOST_APART


def test_their_light_is_among_what_every_proof_is_judged_by(small_run: lf.Run) -> None:
    """On the first receiver and on further ones, on both sides of each limit."""
    proof = small_run.proof
    assert {criterion.key for criterion in proof.criteria} >= OWN
    first = proof.first
    own_rays = first.own_rays
    assert own_rays is not None and own_rays.nmse_less_noise is not None
    second = first.model_copy(update={"name": "wall"})
    limits = {criterion.key: criterion.limit for criterion in proof.criteria}
    assert limits["own_rays_emission"] == MOST_APART
    for factor, sign, passed in ((0.99, 1.0, True), (1.01, 1.0, False), (0.99, -1.0, True), (1.01, -1.0, False)):
        light = own_rays.efficiency_design.value + sign * factor * limits["own_rays_efficiency"]
        worse = {
            "efficiency": own_rays.efficiency.model_copy(update={"value": light}),
            "nmse_less_noise": own_rays.nmse_less_noise.model_copy(update={"value": factor * limits["own_rays_nmse"]}),
        }
        far = second.model_copy(update={"own_rays": own_rays.model_copy(update=worse)})
        altered = proof.model_copy(
            update={"receivers": (first, far), "emission_apart": factor * limits["own_rays_emission"]}
        )
        judged = {criterion.key: criterion.holds for criterion in altered.judge()}
        assert judged["own_rays_efficiency"] and judged["own_rays_nmse"]
        for name in ("own_rays_emission", "wall: own_rays_efficiency", "wall: own_rays_nmse"):
            assert judged[name] == passed, name


@pytest.mark.parametrize("broken", first_by_day(0, [Narrower, TwiceAsLarge], "half a minute each"))
def test_a_broken_sampler_is_seen_by_these_rays_alone(
    small_run: lf.Run, monkeypatch: pytest.MonkeyPatch, broken: type
) -> None:
    monkeypatch.setattr(SquareEmitter, "sample", broken.sample)
    light = lf.evaluate(small_run.lens, rays=2**16)
    proof = lf.verify(small_run.part, light.model_copy(update={"conditions": None}))
    missed = {criterion.key for criterion in proof.criteria if not criterion.holds}
    assert "own_rays_emission" in missed and missed <= OWN
    assert broken is TwiceAsLarge or "own_rays_nmse" in missed
    own_rays = proof.first.own_rays
    assert (
        own_rays is not None
        and own_rays.efficiency.standard_error is not None
        and own_rays.efficiency.standard_error < 0.005
    )
    assert sum(own_rays.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("power", [0.0, 1.0, 2.5, 300.0])
def test_cosines_have_the_moments_of_their_power(power: float) -> None:
    z = independent_draws.along_cosine(random(), COUNT, power)[:, 2]
    assert near(z, (power + 1.0) / (power + 2.0)) and near(z**2, (power + 1.0) / (power + 3.0))


def test_a_disc_is_round_and_even() -> None:
    points = independent_draws.in_disc(random(), COUNT, 2.0)
    square = (points**2).sum(axis=1)
    assert square.max() <= 4.0 and near(square, 2.0) and near(points[:, 0], 0.0) and near(square**2, 16.0 / 3.0)


def test_rectangles_share_the_flux() -> None:
    centres = np.array([[-1.0, 0.0], [2.0, 3.0]])
    sides = np.array([[1.0, 2.0], [0.5, 0.25]])
    points = independent_draws.in_rectangles(random(), COUNT, centres, sides, np.array([3.0, 1.0]))
    first = points[:, 0] < 0.0
    assert near(first.astype(float), 0.75)
    assert near((points[first, 0] + 1.0) ** 2, 1.0 / 12.0) and near((points[~first, 1] - 3.0) ** 2, 0.0625 / 12.0)


def test_rays_of_each_chip_have_its_spectrum_and_its_share() -> None:
    chips = [
        {"x_mm": 0.8, "y_mm": -0.3, "width_mm": 0.4, "height_mm": 0.2, "flux_w": 3.0,
         "spectrum": {"kind": "line", "wavelength_nm": 450.0}},
        {"x_mm": -0.5, "y_mm": 0.4, "width_mm": 0.6, "height_mm": 0.3, "flux_w": 1.0,
         "spectrum": {"kind": "line", "wavelength_nm": 620.0}},
    ]  # fmt: skip
    spec = small_spec(source={"kind": "chips", "chips": chips}, lens__material="PMMA")
    rays = independent_rays(spec, source_of(spec), 4000, 1)
    first = (np.abs(rays.origins[:, :2] - [0.8, -0.3]) <= [0.2, 0.1]).all(axis=1)
    assert near(first.astype(float), 0.75)
    assert rays.wavelengths_nm is not None
    assert set(rays.wavelengths_nm[first]) == {450.0} and set(rays.wavelengths_nm[~first]) == {620.0}
