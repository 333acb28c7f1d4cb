"""One lens for several LEDs: rays shared out, the mean or the worst merit, and the light of each."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from chains import upwards
from presets import FEW
from scenes import small_spec, tolerance_changes
from search_scenes import LARGE, require_same_bits_after

import lensforge as lf
from lensforge.light.lens_light import searched_source, source_of
from lensforge.light.light_facts import light_reasons
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.light_path import SearchParts
from lensforge.search.merit import MeritFunction
from lensforge.search.merit_of_sources import MeritOfSources
from lensforge.search.optimiser import search
from lensforge.search.parameters import SphereParameters
from lensforge.search.problem import Problems, ValidationRays
from lensforge.sources.measured_rays import held_back, searched, smoothed
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.several_sources import SeveralSources
from lensforge.spec import Spec

LEFT = {"kind": "square", "side_mm": 1.0, "flux_w": 2.0}
RIGHT = {
    "kind": "rectangle", "width_mm": 0.6, "height_mm": 1.2, "flux_w": 0.5, "position_mm": [0.1, -0.2, 0.0],
    "tilt_deg": [0.0, 25.0],
}  # fmt: skip
LEDS = [{"name": "left", "share": 3.0, "source": LEFT}, {"name": "right", "source": RIGHT}]


def _spec(**changes: Any) -> Spec:
    return small_spec(**{"source": None, "sources": LEDS, "target__uniform_mm": None, **changes})


def test_a_sample_has_rays_of_each_in_turn_and_each_is_a_sample_of_its_own() -> None:
    spec = _spec()
    source = searched_source(spec)
    assert isinstance(source, SeveralSources) and source.flux_w == pytest.approx(2.5)
    rays = source.sample(101, 7)
    assert np.array_equal(rays.of_source, np.tile([0, 1], 51))
    for bundle, alone in zip(source.shared_out(rays), map(source_of, spec.by_state.values()), strict=True):
        wanted = alone.sample(51, 7)
        for name in ("origins", "directions", "flux"):
            assert np.array_equal(getattr(bundle, name), getattr(wanted, name))
    for part in rays.divided(3):
        assert len({len(sample) for sample in source.shared_out(part)}) == 1


def test_the_symmetry_is_what_all_have() -> None:
    several = searched_source(small_spec(source=None, sources=[LEDS[0], {"name": "x", "source": {
        "kind": "rectangle", "width_mm": 1.0, "height_mm": 0.5}}]))  # fmt: skip
    assert (several.symmetry, searched_source(_spec()).symmetry) == ("rectangle", "none")


BLUE = {"kind": "gaussian", "peak_nm": 450.0, "fwhm_nm": 20.0}
ONE_WITH_WAVELENGTHS = {"sources": [LEDS[0], {**LEDS[1], "source": {**RIGHT, "spectrum": BLUE}}], "source": None}
GREEN_PMMA = {"lens__material": "PMMA", "lens__design_wavelength_nm": 520.0, "target__uniform_mm": None}


def test_an_led_without_wavelengths_beside_one_with_them_has_that_of_the_design() -> None:
    source = searched_source(small_spec(**ONE_WITH_WAVELENGTHS, **GREEN_PMMA))
    rays = source.sample(4096, 7)
    plain, blue = source.shared_out(rays)
    assert source.without_wavelengths == (0,) and set(plain.wavelengths_nm) == {520.0}
    plain_too = {**LEDS[0], "name": "third"}
    three = small_spec(**GREEN_PMMA, source=None, sources=[*ONE_WITH_WAVELENGTHS["sources"], plain_too])
    assert searched_source(three).without_wavelengths == (0, 2)
    assert blue.wavelengths_nm.mean() == pytest.approx(450.0, abs=0.5)
    assert (
        searched_source(_spec()).without_wavelengths == ()
        and searched_source(_spec()).sample(4, 0).wavelengths_nm is None
    )
    with pytest.raises(lf.Cancelled), pytest.warns(lf.SourceWarning, match="^left: no wavelengths, as other LEDs have"):
        lf.design(small_spec(**ONE_WITH_WAVELENGTHS, **GREEN_PMMA), accuracy=FEW, progress=lambda _: False)


@pytest.mark.parametrize("name", ["wavelengths_nm", "of_source", "tristimulus"])
def test_bundles_of_which_one_has_no_wavelength_number_or_colour_are_not_joined(name: str) -> None:
    without = replace(searched_source(_spec()).sample(8, 0), waves=None, of_source=None, tristimulus=None)
    ones = np.ones(8)
    with_it = without.with_wavelengths(ones) if name == "wavelengths_nm" else replace(without, **{name: ones})
    for pair in ((with_it, without), (without, with_it)):
        with pytest.raises(ValueError, match=f"{name}: 1 of 2 bundles"):
            RayBundle.joined(pair)
    assert len(getattr(RayBundle.joined([with_it, with_it]), name)) == 16
    assert getattr(RayBundle.joined([without, without]), name) is None


HALF = {"kind": "zone", "zone": {"kind": "rectangle", "width_mm": 120.0, "height_mm": 120.0}, "at_least_share": 0.5}
OF_PARTS = {"optimise__robust": "yield", "limits": [HALF], **tolerance_changes(LARGE)}


OTHER = {"kind": "rectangle", "width_mm": 90.0, "height_mm": 60.0, "centre_mm": [20.0, 0.0],
         "distance_mm": 80.0, "receiver_mm": 150.0}  # fmt: skip
OF_STATES = {
    "source": LEFT, "sources": [], "limits": [HALF],
    "states": [{"name": "left", "weight": 3.0},
               {"name": "right", "source": RIGHT, "shift_mm": [0.1, 0.0, 0.2], "target": OTHER, "limits": []}],
}  # fmt: skip


@pytest.mark.parametrize(
    ("over", "changes"),
    [
        ("mean", {}),
        ("worst", {}),
        ("mean", {**ONE_WITH_WAVELENGTHS, **GREEN_PMMA}),
        ("mean", OF_PARTS),
        ("mean", OF_STATES),
        ("worst", OF_STATES),
        ("mean", OF_PARTS | OF_STATES),
        ("worst", OF_PARTS | OF_STATES),
    ],
)
def test_the_merit_is_the_mean_by_shares_or_the_worst(over: str, changes: dict[str, Any]) -> None:
    spec = _spec(**{"optimise__over_sources": over, **changes})
    source = searched_source(spec)
    parametrisation = SphereParameters.of(spec, 3.0)
    merit = MeritOfSources.of(spec, source, parametrisation)
    rng = np.random.default_rng(0)
    weights = torch.from_numpy(rng.normal(size=(parametrisation.basis.size, 2)) * 0.02).requires_grad_()
    offsets = torch.tensor([1.0, 1.05], dtype=torch.float64)
    rays = source.sample(4096, 1)
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    pairs = SearchParts.of(spec, parametrisation).of_step(0, 3) if spec.optimise.robust else ()
    step = merit.step_loss(weights, offsets, rays, constraints, False, pairs)
    alone = []
    for state in spec.by_state.values():
        led = source_of(state)
        alone.append(MeritFunction.of(state, led, parametrisation).step_loss(
            weights, offsets, led.sample(2048, 1), constraints, False, pairs
        ))  # fmt: skip
    term = constraints.term(step.fields)
    losses = [member.loss - term for member in alone]
    assert abs(losses[0] - losses[1]) > 0.01
    shares = [0.75, 0.25]
    if over == "worst":
        shares = np.exp([4.0 * loss.item() / step.nmse for loss in losses])
        shares /= shares.sum()
        assert max(shares) > 0.6 and np.argmax(shares) == np.argmax([loss.item() for loss in losses])
    wanted = shares[0] * losses[0] + shares[1] * losses[1]
    assert (step.loss - term).item() == pytest.approx(wanted.item(), rel=1e-12)
    assert step.nmse == pytest.approx(0.75 * alone[0].nmse + 0.25 * alone[1].nmse, rel=1e-12)
    by_all, by_each = (
        torch.autograd.grad(total, weights, retain_graph=True)[0] for total in (step.loss, wanted + term)
    )
    assert torch.allclose(by_all, by_each, rtol=1e-9, atol=1e-14) and float(by_all.abs().max()) > 1e-3


@pytest.mark.parametrize("over", ["mean", "worst"])
def test_a_judgement_is_that_of_each_by_its_own_samples(over: str) -> None:
    spec = _spec(optimise__over_sources=over, optimise__steps_per_level=[4], lens__levels=[9])
    source = searched_source(spec)
    problem = Problems(spec, source, 3.0, None).of((9,))
    weights, offsets = problem.parametrisation.start()
    judged, _ = ValidationRays.of(source, 4096, 0)[0].judge(problem, weights, offsets, False)
    judgements = []
    for state in spec.by_state.values():
        led = source_of(state)
        alone = Problems(state, led, 3.0, None).of((9,))
        judgements.append(ValidationRays.of(led, 2048, 0)[0].judge(alone, weights, offsets, False)[0])
    missing = float(problem.constraints.penalty_alone(problem.constraints.fields(problem.parametrisation.tables(
        weights, offsets))))  # fmt: skip
    merits = [judgement.merit - missing for judgement in judgements]
    wanted = max(merits) if over == "worst" else 0.75 * merits[0] + 0.25 * merits[1]
    assert judged.merit - missing == pytest.approx(wanted, rel=1e-9)
    for slice_number, value in enumerate(judged.without):
        without = [judgement.without[slice_number] - missing for judgement in judgements]
        wanted = max(without) if over == "worst" else 0.75 * without[0] + 0.25 * without[1]
        assert value - missing == pytest.approx(wanted, rel=1e-9)


def test_files_of_rays_are_divided_each_by_itself(examples: Path) -> None:
    led = {"kind": "rayfile", "model": "rays", "file": str(examples / "led.tm25ray")}
    files = [{"name": name, "source": led | {"flux_w": flux}}
             for name, flux in (("a", 1.0), ("b", 2.0))]  # fmt: skip
    source = searched_source(small_spec(source=None, sources=files))
    count = source_of(small_spec(source=files[0]["source"])).ray_count
    assert count is not None and source.ray_count == 2 * count
    unequal = SeveralSources(tuple(RaySetEmitter(upwards(rays, rays), 1.0) for rays in (90, 31, 47)), 550.0)
    assert unequal.ray_count == 3 * 31 and len(np.unique(unequal.sample(93, 0).directions, axis=0)) == 93
    assert replace(unequal, sources=(*unequal.sources, source_of(_spec()))).ray_count == 4 * 31
    sizes = ({"side_mm": 1.0}, {"side_mm": 0.3}, {"side_mm": 2.0})
    squares = [source_of(small_spec(source={"kind": "square", **size})) for size in sizes]
    assert np.ptp(SeveralSources(tuple(squares), 550.0).outline(), axis=0)[:2] == pytest.approx([0.3, 0.3])
    steps = searched(source)
    judging = held_back(source)
    assert isinstance(steps, SeveralSources) and isinstance(judging, SeveralSources)
    assert [led.ray_count for led in (*steps.sources, *judging.sources)] == [14000, 14000, 6000, 6000]
    turned = smoothed(steps)
    assert turned.ray_count is None and turned.sample(100, 0).flux.sum() == pytest.approx(3.0)


def test_the_pictures_of_two_leds_add_up_to_that_of_their_joint_rays() -> None:
    spec = _spec()
    source = searched_source(spec)
    parametrisation = SphereParameters.of(spec, 3.0)
    assert isinstance(source, SeveralSources)
    rays = source.sample(6000, 5)
    tables = parametrisation.tables(*parametrisation.start())
    merit = MeritOfSources.of(spec, source, parametrisation)
    columns = rays.origins, rays.directions, rays.flux[:, None]
    joint = spec.replace(source=lf.RaySource(np.hstack(columns)), sources=())
    together = MeritFunction.of(joint, source_of(joint), parametrisation).light_of(tables, rays).images[0]
    lights = merit.light_of(tables, rays).lights
    assert min(float(light.images[0].sum()) for light in lights) > 0.2
    assert torch.allclose(sum(light.images[0] for light in lights), together, rtol=0.0, atol=1e-13)


def test_the_light_of_every_led_is_its_own_evaluation_and_is_judged() -> None:
    limit = {"kind": "zone", "at_least_share": 0.3}
    spec = _spec(limits=[limit], optimise__steps_per_level=[2, 2])
    made = lf.design(spec, accuracy=FEW)
    light = lf.evaluate(made.lens)
    assert list(light.by_led) == ["left", "right"]
    for led in spec.sources:
        alone = lf.evaluate(made.lens, source=led.source)
        result = light.by_led[led.name]
        assert (result.nmse, result.efficiency, result.limits) == (alone.nmse, alone.efficiency, alone.limits)
        assert np.array_equal(result.map, alone.map)
    assert light.by_led["right"].nmse != light.nmse and str(light).count("with right") == 1
    assert list(light_reasons(light, made.lens)) == []
    missed = replace(light.others[0].limits[0], limit=0.999).judged()
    other = light.others[0].model_copy(update={"limits": (missed,)})
    ((state, reason),) = light_reasons(light.model_copy(update={"others": (other,)}), made.lens)
    assert state == "fail" and ", right = " in reason


def test_the_cavity_has_room_for_the_largest_and_an_led_that_cannot_be_is_named() -> None:
    lens = {"levels": [9, 25], "symmetry": "none"}
    sizes = {"cavity_height_mm": None, "cavity_radius_mm": None, "min_thickness_mm": None, "max_radius_mm": 7.0}
    several = _spec(constraints=sizes, lens=lens).constraints
    alone = [small_spec(source=led["source"], constraints=sizes, lens=lens).constraints for led in LEDS]
    assert several.cavity_radius_mm == max(source.cavity_radius_mm for source in alone)
    assert alone[0].cavity_radius_mm != alone[1].cavity_radius_mm
    backwards = [LEDS[0], {"name": "right", "source": {**RIGHT, "tilt_deg": [180.0, 0.0]}}]
    with pytest.raises(lf.InputError, match=r"at least 10 % must enter; .*the LED is right"):
        lf.design(small_spec(source=None, sources=backwards), accuracy=FEW)


def test_an_interrupted_search_ends_with_the_same_bits(tmp_path: Path) -> None:
    spec = _spec()
    source = searched_source(spec)
    whole = search(spec, source, accuracy=FEW, seed=3)
    require_same_bits_after(5, spec, source, tmp_path / "checkpoint.bin", whole, seed=3)


def test_a_search_sees_the_lens_as_it_is_at_work() -> None:
    """Expansion alone conserves the light of a scene that is as much smaller, about a seat at the origin."""
    e = 0.03
    changes = {"target__uniform_mm": None, "base": {"kind": "none"}}
    law = {"lens__index_per_k": 0.0, "lens__expansion_per_k": 3e-4, "lens__temperature_c": 120.0}
    target = {"kind": "flat_top", "width_mm": 160.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    smaller = {name: value if name == "kind" else value / (1.0 + e) for name, value in target.items()}
    warm = small_spec(target=target, **law, **changes)
    cold = small_spec(target=smaller, source={"kind": "square", "side_mm": 1.0 / (1.0 + e)}, **changes)
    images = []
    for spec in (warm, cold):
        parametrisation = SphereParameters.of(spec, 3.0)
        source = source_of(spec)
        weights = 0.02 * torch.sin(torch.arange(2.0 * spec.lens.basis.size, dtype=torch.float64)).reshape(-1, 2)
        tables = parametrisation.tables(weights, torch.tensor([3.0, 6.0], dtype=torch.float64))
        light = MeritFunction.of(spec, source, parametrisation).light_of(tables, source.sample(512, 3))
        images.append(light.images[0].numpy())
    np.testing.assert_allclose(images[0], images[1], rtol=1e-7, atol=1e-12)
    assert images[0].max() > 0.0
