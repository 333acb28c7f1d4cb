"""Light behind a lens, summed by hand over bundles: half of what rises steeply passes, and nothing else."""

import numpy as np
import pytest

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light import exit_light
from lensforge.light.exit_light import ExitLight, Goniophotometer, RaysOnSphere, _on_sphere, trace_exit_light
from lensforge.light.photometry_result import LostFlux
from lensforge.light.received_flux import ABSORBED, BLOCKED, CAUSES, IN_GLASS, MISSED_RECEIVER, SECOND_WALL, named_flux
from lensforge.light.simulation import TracedLens
from lensforge.scene.exit_rays import ExitRays
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.spec.lamps_section import Lamps
from lensforge.surfaces.mirror_group import shared_symmetry

SEED = 3
PARTS = 16
ROUNDS = 32
LENS = object.__new__(TracedLens)  # never looked at


def behind(rays: RayBundle) -> RayBundle:
    steep = rays.take(rays.directions[:, 2] > 0.5)
    return RayBundle(steep.origins, steep.directions, 0.5 * steep.flux)


def by_fate(rays: RayBundle) -> np.ndarray:
    flux = np.zeros(CAUSES)
    flux[Fate.LEFT_LENS] = behind(rays).flux.sum()
    flux[Fate.BASE] = rays.flux.sum() - flux[Fate.LEFT_LENS]
    return flux


@pytest.fixture(autouse=True)
def half_transparent(monkeypatch: pytest.MonkeyPatch) -> None:
    def traced(lens: TracedLens, rays: RayBundle, sphere_mm: float, lamps: Lamps, housing: None) -> RaysOnSphere:
        assert lens is LENS and sphere_mm == 7.0 and lamps.is_single and housing is None
        return RaysOnSphere(behind(rays), by_fate(rays))

    monkeypatch.setattr(exit_light, "exit_rays", traced)


def measured(
    source, rays: int | None = None, by_itself: tuple[int, int] = (4096, 4096), symmetry: str = "none"
) -> ExitLight:
    meter = Goniophotometer(sphere_mm=7.0, symmetry=symmetry, street_deg=90.0)
    return trace_exit_light(LENS, source, meter, rays=rays, by_itself=by_itself, seed=SEED)


def agrees(light: ExitLight, parts: list[list[RayBundle]]) -> None:
    """``parts``: of each sample its bundles, each of all the flux; weights are their numbers of rays."""
    exits = []
    fates = []
    for bundles in parts:
        weights = np.array([len(bundle) for bundle in bundles], dtype=float)
        exits.append(weights @ [behind(bundle).flux.sum() for bundle in bundles] / weights.sum())
        fates.append(weights @ np.array([by_fate(bundle) for bundle in bundles]) / weights.sum())
    assert light.rays == sum(len(bundle) for bundles in parts for bundle in bundles)
    assert light.exit_w.value == pytest.approx(np.mean(exits)) and light.exit_w.unit == "W"
    error = np.sqrt(np.var(exits, ddof=1) / len(exits)) if len(exits) > 1 else None
    assert light.exit_w.standard_error == pytest.approx(error, abs=1e-15)
    np.testing.assert_allclose(light.by_fate_w, np.mean(fates, axis=0), atol=1e-15)
    assert light.sample.flux.sum() == pytest.approx(light.exit_w.value)
    kept = RayBundle.joined([behind(bundles[0]) for bundles in parts])
    np.testing.assert_array_equal(light.sample.directions, kept.directions)
    np.testing.assert_allclose(light.sample.flux / light.sample.flux.sum(), kept.flux / kept.flux.sum())
    grid = light.intensity.grid
    flux = (light.intensity.values * grid.solid_angles).sum()
    assert flux == pytest.approx(np.mean(exits)) and len(light.intensity.samples) == len(parts)


def drawn(source: SquareEmitter, counts: list[int]) -> list[list[RayBundle]]:
    """Bundles of each sample, one for each round of ``counts`` rays, drawn by seeds that differ."""
    numbers = ((count, PARTS * number) for number, count in enumerate(counts))
    rounds = [(count, first) for count, first in numbers]
    return [
        [source.sample(count, seeds.of_far_field(SEED, PARTS * ROUNDS, first + part)) for count, first in rounds]
        for part in range(PARTS)
    ]


@pytest.mark.parametrize(("rays", "per_sample"), [(1, 1), (16, 1), (17, 2), (1000, 63)])
def test_rays_are_dealt_to_sixteen_samples_of_the_whole_flux(rays: int, per_sample: int) -> None:
    source = SquareEmitter(1.0, 2.0)
    agrees(measured(source, rays), drawn(source, [per_sample]))


def test_a_table_for_roads_has_steps_of_5_and_2_5_degrees_at_most() -> None:
    meter = Goniophotometer(sphere_mm=7.0, symmetry="none", street_deg=90.0, to_horizon=True)
    grid = trace_exit_light(LENS, SquareEmitter(1.0, 2.0), meter, rays=64, by_itself=(64, 64), seed=SEED).intensity.grid
    assert grid.planes == 72 and np.diff(grid.gamma_deg) == pytest.approx(2.5)


def test_many_rays_are_traced_in_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exit_light, "_MOST_AT_ONCE", 8)
    source = SquareEmitter(1.0, 2.0)
    agrees(measured(source, 300), drawn(source, [8, 8, 3]))


def test_more_rays_are_traced_until_the_noise_is_down_or_there_are_most() -> None:
    """From 256 by doublings: at 2,000 rays at most, 1024 in a second round."""
    source = SquareEmitter(1.0, 2.0)
    agrees(measured(source, by_itself=(256, 2000)), drawn(source, [16, 48]))
    agrees(measured(source, by_itself=(256, 200)), drawn(source, [13]))
    agrees(measured(source, by_itself=(256, 500)), drawn(source, [16]))


def ray_set(count: int) -> RaySetEmitter:
    rays = SquareEmitter(1.0, 1.0).sample(count, 1)
    return RaySetEmitter(RayBundle(rays.origins, rays.directions, np.arange(1.0, count + 1.0)), 2.0)


@pytest.mark.parametrize(("count", "rays", "taken"), [(60, None, 60), (60, 40, 40), (5, None, 5), (60, 100, 60)])
def test_the_rays_of_a_measured_source_are_dealt_at_random(count: int, rays: int | None, taken: int) -> None:
    source = ray_set(count)
    everything = source.sample(taken, SEED)
    order = np.random.default_rng(SEED).permutation(taken)
    parts = [everything.take(rows) for rows in np.array_split(order, min(PARTS, taken))]
    scaled = [RayBundle(part.origins, part.directions, 2.0 * part.flux / part.flux.sum()) for part in parts]
    agrees(measured(source, rays), [[bundle] for bundle in scaled])


def test_the_file_has_rays_of_every_sample_and_all_the_flux() -> None:
    source = SquareEmitter(1.0, 2.0)
    light = measured(source, 16 * 20_000)
    kept = [behind(bundles[0]).directions[:8192] for bundles in drawn(source, [20_000])]
    np.testing.assert_array_equal(light.sample.directions, np.concatenate(kept))
    assert light.sample.flux.sum() == pytest.approx(light.exit_w.value)


def test_the_light_is_the_mean_of_its_mirror_images() -> None:
    samples = measured(SquareEmitter(1.0), 640, symmetry="square").intensity.samples
    np.testing.assert_allclose(samples, np.roll(samples, samples.shape[1] // 4, axis=1), atol=1e-12)
    other = measured(SquareEmitter(1.0), 640).intensity.samples
    assert np.abs(other - np.roll(other, other.shape[1] // 4, axis=1)).max() > 0.01


def test_without_light_upwards_there_is_none_to_write() -> None:
    flat = RayBundle(np.zeros((4, 3)), np.tile([0.8, 0.0, 0.6], (4, 1)) * [1.0, 1.0, -1.0], np.ones(4))
    with pytest.raises(InputError, match="none of 4 rays leaves the lens upwards"):
        measured(RaySetEmitter(flat, 1.0))


def test_every_fate_has_its_own_loss() -> None:
    flux = np.arange(1.0, CAUSES + 3.0)  # the last two of bodies
    losses = named_flux(flux)
    assert set(LostFlux.model_fields) == set(losses) - {"left_lens"}
    expected = {fate.name.lower(): fate + 1.0 for fate in Fate}
    others = {"missed_receiver": MISSED_RECEIVER, "absorbed": ABSORBED, "cover_glass": IN_GLASS, "housing": BLOCKED}
    others["second_wall"] = SECOND_WALL
    bodies = {"bodies": flux[CAUSES:].sum()}
    assert losses == expected | bodies | {name: place + 1.0 for name, place in others.items()}


@pytest.mark.parametrize(
    ("source", "lens", "both"),
    [("square", "rectangle", "rectangle"), ("mirror_x", "rectangle", "mirror_x"), ("mirror_x", "mirror_y", "none")],
)
def test_light_has_the_mirrors_that_source_and_lens_share(source: str, lens: str, both: str) -> None:
    assert shared_symmetry([source, lens]) == both
    assert shared_symmetry([source, lens], lambda name: name == "none") == "none"


def test_rays_inside_a_sphere_leave_it_ahead_of_them() -> None:
    points = np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 3.0, 5.0]])
    ways = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    ends = _on_sphere(points, ways, 5.0)
    np.testing.assert_allclose(ends, [[3.0, 0.0, 4.0], [np.sqrt(24.0), 0.0, 1.0], [0.0, 3.0, -4.0]], atol=1e-12)
    beside = _on_sphere(np.array([[6.0, 0.0, 2.0]]), np.array([[0.0, 0.0, 1.0]]), 5.0)
    assert beside.tolist() == [[6.0, 0.0, 0.0]], "no chord: where it is closest"


def test_rays_are_dealt_to_lamps_evenly_and_carry_the_flux_of_all() -> None:
    class Upwards(TracedLens):
        def trace(self, rays: RayBundle) -> ExitRays:
            up = np.tile([0.0, 0.0, 1.0], (len(rays), 1))
            return ExitRays(0.0 * up, up, rays.flux, np.zeros(len(rays)), np.zeros(len(rays), dtype=np.int8))

    lamps = Lamps.level(((-3.0, 0.0), (1.0, 0.0), (2.0, 5.0)), (0.0, 30.0, 60.0))
    rays = bundle_of(12)
    bundle = exit_light._of_lamps(object.__new__(Upwards), rays, lamps)
    for x, _ in lamps.places_mm:
        assert np.count_nonzero(bundle.points[:, 0] == x) == 4
    np.testing.assert_allclose(bundle.flux, 3.0 * rays.flux)


def bundle_of(count: int) -> RayBundle:
    return RayBundle(np.zeros((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1)), np.arange(1.0, count + 1.0))
