"""From a micrometre to kilometres, from one ray and one pixel to millions: the same physics, to rounding."""

from typing import Any

import numpy as np
import pytest
import torch
from extremes import fuzzed, quick_table_of
from hypothesis import given
from hypothesis import strategies as st
from known_refraction import normal_transmittance
from landed import by_kernels
from nightly import NIGHTLY, first_by_day
from presets import FEW
from scenes import random_surface, small_spec, sphere

from lensforge.errors import InputError
from lensforge.light import simulation
from lensforge.light.evaluation import evaluate_lens
from lensforge.light.evaluation_result import Light
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.optics.pose import Pose
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import PixelGrid, Window, bin_flux, flux_in, splat_flux
from lensforge.scene.receiver import Landings
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.target_pattern import target_light
from lensforge.search.collected_light import Collected, collected
from lensforge.search.optimiser import search
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.spec import CrossTarget, FlatTopTarget, Spec, TargetSection, TextTarget, parse_spec
from lensforge.surfaces.bicubic_table import TableGrid

COARSE = FEW.replace("coarse", evaluate_nodes_per_sigma=3.0, single=False)
SIZE = st.floats(-3.0, 4.0).map(lambda exponent: 10.0**exponent)  # 1e-3 to 1e4


def _times(length: Any, factor: float) -> Any:
    """A length, or a position, times ``factor``."""
    return [value * factor for value in length] if isinstance(length, list) else length * factor


def _scaled(spec: Spec, factor: float) -> Spec:
    """Every length of source, lens, constraints and target times ``factor``."""

    def grown(table: dict[str, Any]) -> dict[str, Any]:
        return {k: _times(v, factor) if k.endswith("_mm") and v is not None else v for k, v in table.items()}

    content = spec.model_dump(mode="json")
    for section in ("source", "constraints", "target"):
        content[section] = grown(content[section])
    for face in ("inner", "outer"):
        content["lens"][face]["offset_mm"] *= factor
    if spec.constraints.keep_out is None:
        del content["constraints"]["keep_out_margin_mm"]
    return parse_spec(content, "scaled")


def _point_spec(**changes: Any) -> Spec:
    return small_spec(**{"source": {"kind": "square", "side_mm": 0.0}, "target__uniform_mm": None} | changes)


def _complete(light: Light, rounding: float = 1e-12) -> None:
    """All flux accounted for; every image finite (the record sees to its numbers)."""
    assert sum(light.flux.model_dump().values()) == pytest.approx(1.0, abs=rounding)
    assert all(np.isfinite(image).all() for image in (light.map, light.raw_map, light.target_map))


@fuzzed(15)
@given(SIZE, st.integers(0, 2**31))
def test_a_scaled_lens_gives_scaled_hits_and_equal_gradients(size: float, seed: int) -> None:
    surfaces = random_surface(seed, 0.8, 0.01, (9, 25)), random_surface(seed + 1, 2.45, 0.01, (9, 25))
    rays, grid = SquareEmitter(0.8).sample(128, seed), TableGrid(40)
    results = []
    for factor in (1.0, size):
        tables = [(quick_table_of(s, grid) * factor).requires_grad_() for s in surfaces]
        moved = RayBundle(rays.origins * factor, rays.directions, rays.flux)
        arrivals = by_kernels(tables, Scene(Media(Medium(1.4936)), grid), moved, 100.0 * factor)
        by_table = torch.autograd.grad((arrivals.hits * torch.tensor([0.3, -0.7])).sum(), tables)
        results.append((arrivals.fates, arrivals.hits / factor, arrivals.carried, arrivals.sin2_exit, *by_table))
    assert torch.equal(results[0][0], results[1][0])
    for value, scaled in zip(results[0][1:], results[1][1:], strict=True):
        assert torch.allclose(value, scaled, rtol=1e-9, atol=1e-10 * float(value.detach().abs().max()))


@pytest.mark.parametrize("size", first_by_day(1, [1e-3, 1e4]))
def test_a_scaled_scene_is_designed_and_judged_alike(size: float) -> None:
    """Neither the search nor the judgement knows how long a millimetre is."""
    spec = small_spec(optimise__steps_per_level=[2, 2], optimise__rays=256)
    histories, lights = [], []
    for case in (spec, _scaled(spec, size)):
        source = SquareEmitter(case.source.side_mm)
        result = search(case, source, accuracy=COARSE)
        histories.append(np.concatenate([level.nmse for level in result.history]))
        lights.append(evaluate_lens(result.lens, source, COARSE, rays=4096))
    assert np.allclose(*histories, rtol=1e-7)
    for name in ("efficiency", "nmse", "uniformity"):
        assert getattr(lights[0], name).value == pytest.approx(getattr(lights[1], name).value, rel=1e-6)


# By day each distance and each angle; all pairs nightly.
RECEIVERS = [(1e-2, 80.0), (1e3, 30.0), (1e7, 1.0)]
RECEIVERS += [(far, angle) for far in (1e-2, 1e3, 1e7) for angle in (1.0, 30.0, 80.0) if (far, angle) not in RECEIVERS]


@pytest.mark.parametrize(("distance", "half_angle_deg"), first_by_day(3, RECEIVERS))
def test_a_lambertian_point_on_receivers_of_any_size(distance: float, half_angle_deg: float) -> None:
    """Share on a parallel square: (4/pi) A atan(A), A = X/sqrt(1+X^2), X = half side over distance."""
    x = np.tan(np.radians(half_angle_deg))
    radius = min(1.0, 0.1 * distance)
    spec = _point_spec(
        lens__inner__offset_mm=0.5 * radius,
        lens__outer__offset_mm=radius,
        constraints={
            "cavity_height_mm": 0.1 * radius,
            "cavity_radius_mm": 0.2 * radius,
            "min_thickness_mm": 0.1 * radius,
            "max_radius_mm": radius,
        },
        target__distance_mm=distance,
        target__receiver_mm=2.0 * x * distance,
        target__width_mm=2.0 * x * distance,
    )
    light = evaluate_lens(
        Lens.double(sphere(0.5 * radius), sphere(radius), spec, 0, "draft"), SquareEmitter(0.0), COARSE, rays=2**15
    )
    _complete(light)
    a = x / np.hypot(1.0, x)
    expected = 4.0 / np.pi * a * np.arctan(a) * normal_transmittance(1.4936) ** 2
    efficiency = light.efficiency
    assert efficiency.value == pytest.approx(expected, abs=5 * efficiency.standard_error + 1e-4)
    assert light.raw_map.sum() * (2e-3 * x * distance / 16) ** 2 == pytest.approx(efficiency.value, rel=1e-9)


def _collected(hits: torch.Tensor, flux: torch.Tensor, sin2_exit: torch.Tensor, grid: PixelGrid) -> Collected:
    every = torch.ones(len(flux), dtype=torch.bool)
    whole = Window(*grid.size)
    return collected(Landings(hits, flux, every, ~every), sin2_exit, torch.ones_like(flux), grid, whole)


@fuzzed(40)
@given(
    st.sampled_from([1, 2, 3, 64]),
    st.sampled_from([1e-2, 1.0, 300.0, 1e7]),
    st.floats(-0.6, 0.6),
    st.sampled_from(["inside", "edge", "centre", "far"]),
)
def test_splat_and_bins_on_any_receiver(pixels: int, side: float, where: float, kind: str) -> None:
    grid = PixelGrid.square(side, pixels)
    x = {"inside": where, "edge": round(where * pixels) / pixels, "centre": 0.5 / pixels - 0.5, "far": where * 1e100}[
        kind
    ]
    hits = torch.tensor([[x * side, -x * side], [0.0, 0.0]], dtype=torch.float64, requires_grad=True)
    flux = torch.tensor([0.25, 0.75], dtype=torch.float64, requires_grad=True)
    light = _collected(hits, flux, torch.zeros(2, dtype=torch.float64), grid)
    image = light.image
    splat = splat_flux(hits.detach().numpy(), flux.detach().numpy(), grid)
    assert np.allclose(image.detach().numpy(), splat)
    assert (image >= 0.0).all() and image.sum().item() <= 1.0 + 1e-12
    if abs(x) <= 0.5 - 0.5 / pixels:  # between the outermost pixel centres nothing is lost
        assert image.sum().item() == pytest.approx(1.0, rel=1e-12)
    mixed = (image * torch.rand_like(image)).sum() + light.outside_receiver + light.in_window
    gradients = torch.autograd.grad(mixed, (hits, flux))
    assert all(torch.isfinite(g).all() for g in gradients)
    binned = bin_flux(hits.detach().numpy(), flux.detach().numpy(), grid)
    assert binned.sum() == pytest.approx(1.0 if -0.5 <= x < 0.5 and -0.5 <= -x < 0.5 else 0.75)
    assert flux_in(hits.detach().numpy(), flux.detach().numpy(), Window(3.0 * side, 3.0 * side)) >= 0.75


PLACE = {"distance_mm": 100.0, "receiver_mm": 300.0}


def light_on(side: float, pixels: int, target: TargetSection) -> np.ndarray:
    plane = Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), PixelGrid.square(side, pixels))
    return target_light((target,), plane)


@pytest.mark.parametrize(
    ("target", "pixels"),
    [
        (FlatTopTarget(kind="flat_top", width_mm=2e-6, exponent=200.0, **PLACE), 2048),
        (CrossTarget(kind="cross", length_mm=1e-6, stroke_mm=1e-6, **PLACE), 64),
        (TextTarget(kind="text", text="I", width_mm=1e-6, **PLACE), 1),
    ],
)
def test_a_target_too_small_to_see_is_refused(target: TargetSection, pixels: int) -> None:
    with pytest.raises(InputError, match="dark everywhere on the receiver"):
        light_on(300.0, pixels, target)


@pytest.mark.parametrize("ray_count", [1, 15, 17])
def test_a_measured_source_of_a_few_rays(ray_count: int) -> None:
    """Fewer rays than replicates: their flux still adds up to the source's."""
    bundle = SquareEmitter(0.5).sample(ray_count, 1)
    source = RaySetEmitter(bundle, 1.0)
    spec = _point_spec(target__receiver_mm=1e6, target__width_mm=8e5)
    light = evaluate_lens(Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft"), source, COARSE, rays=1000)
    _complete(light)
    assert light.rays == ray_count
    assert light.flux.detected + light.flux.outside + light.flux.missed > 0.9


@pytest.mark.parametrize("at_once", [2**20, 100, 1])
def test_rays_traced_in_parts_agree_with_all_at_once(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """What bounds the memory of many rays changes nothing but the sample."""
    monkeypatch.setattr(simulation, "_MOST_RAYS_AT_ONCE", at_once)
    count = 2**24 if NIGHTLY and at_once > 100 else 2**10 if at_once > 1 else 2**8
    spec = _point_spec()
    light = evaluate_lens(
        Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft"), SquareEmitter(0.0), COARSE, rays=count
    )
    _complete(light, 1e-17 * count + 1e-12)  # of equal terms, each rounded alike
    a = 1.0 / np.sqrt(2.0)  # the receiver is twice as wide as it is far
    expected = 4.0 / np.pi * a * np.arctan(a) * normal_transmittance(1.4936) ** 2
    assert light.efficiency.value == pytest.approx(expected, abs=5.0 * light.efficiency.standard_error)
