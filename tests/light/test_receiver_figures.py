"""Light on one receiver, from pictures that are made: every figure of its record, and what the record refuses."""

import numpy as np
import pytest
from scenes import small_spec

from lensforge.kernels.fate import Fate
from lensforge.light.evaluation import _flux_budget, receiver_light
from lensforge.light.received_flux import (
    ABSORBED,
    BLOCKED,
    CAUSES,
    IN_GLASS,
    MISSED_RECEIVER,
    SECOND_WALL,
    ReceivedFlux,
)
from lensforge.light.receiver_light import EstimatedLight, ReceiverLight, by_pixels, possible_share
from lensforge.optics.exit_space import ExitBall
from lensforge.optics.media import Media, Medium
from lensforge.results.estimates import nmse, nmse_estimate, relative_deviation, uniformity
from lensforge.scene.pixel_grid import gaussian3
from lensforge.scene.possible_light import PossibleLight, SourceLight
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import coarser_target, drawn_target
from lensforge.sources.build_source import SquareEmitter
from lensforge.spec import Spec


def spec_of(**target: object) -> Spec:
    wall = {"kind": "plane", "centre_mm": [0.0, 0.0, 50.0], "width_mm": 60.0, "height_mm": 40.0}
    shape = {"kind": "rectangle", "width_mm": 30.0, "height_mm": 20.0} | target
    return small_spec(target=None, receivers=[{**wall, "window_mm": [30.0, 30.0], "targets": [shape]}])


def lit(images: np.ndarray, spec: Spec, emitted_w: float = 2.0) -> tuple[ReceiverLight, np.ndarray]:
    receiver = receivers_of(spec, 6)[0]
    by_fate = np.zeros((len(images), CAUSES))
    by_fate[:, Fate.LEFT_LENS] = images.sum(axis=(1, 2))
    whole = images.sum(axis=(1, 2))
    drawn = drawn_target(spec.all_receivers[0].targets, receiver)
    received = ReceivedFlux(images, by_fate, 0.7 * whole, 0.3 * whole, 0.4 * whole[:, None], (drawn,))
    light = SourceLight.of(SquareEmitter(1.0), Media(Medium(1.5)), 256)
    result = receiver_light(
        spec.all_receivers[0], PossibleLight(light, receiver, ExitBall(7.0)), received, 1.0, emitted_w
    )
    return result, drawn.light


@pytest.mark.parametrize("uniform_mm", [None, [30.0, 20.0]])
def test_the_light_on_a_receiver_is_that_of_its_pictures(uniform_mm: list[float] | None) -> None:
    spec = spec_of(uniform_mm=uniform_mm)
    images = np.random.default_rng(0).uniform(0.5, 1.5, (5, 4, 6)) / 40.0
    smooth = np.stack([gaussian3(image, 1.0) for image in images])
    light, target = lit(images, spec)
    # pixels of 10 mm
    measure = 1e-4
    mean = smooth.mean(axis=0)
    np.testing.assert_allclose(light.map, mean / measure)
    np.testing.assert_allclose(light.raw_map, images.mean(axis=0) / measure)
    np.testing.assert_allclose(light.target_map, target * mean.sum() / measure)
    inside = np.zeros((4, 6), dtype=bool)
    inside[1:3, 1:5] = True  # centres at 5 and 15 mm: the target ends on the latter
    share = 0.4 * images.sum(axis=(1, 2)) / 2.0
    assert light.share_in_target.value == pytest.approx(share.mean())
    assert light.share_in_target.standard_error == pytest.approx(share.std(ddof=1) / np.sqrt(5.0))
    coarse = gaussian3(images.reshape(5, 2, 2, 3, 2).sum(axis=(2, 4)), 1.0)
    half = nmse_estimate(coarse, coarser_target(spec.all_receivers[0].targets, receivers_of(spec, 6)[0]).light).metric()
    assert light.nmse_of_raster == pytest.approx(light.nmse.value - half.value)
    assert by_pixels(light) == f"; depends on the pixels: {half.value:.2g} with pixels twice as wide"
    assert light.efficiency.value == pytest.approx(0.7 * images.sum() / 5.0 / 2.0)
    assert light.raw.nmse == pytest.approx(nmse(mean, target))
    noise = np.sum([(image - mean) ** 2 for image in smooth]) / 4.0 / 5.0 / np.sum(mean**2)
    assert light.nmse_of_noise == pytest.approx(noise)
    assert (light.name, light.kind, light.width, light.height) == ("plane", "plane", 60.0, 40.0)
    assert (light.window.width, light.window.height, light.window.radius) == (30.0, 30.0, None)
    assert light.flux.detected == light.efficiency.value and light.wanted_in_target == pytest.approx(1.0)
    assert light.flux.outside == pytest.approx(0.3 * images.sum() / 5.0 / 2.0)
    region = light.in_region
    assert region is not None and region.region == ("bright" if uniform_mm is None else "uniform")
    assert region.mean.value == pytest.approx(mean[inside].mean() / measure) and region.mean.unit == "W/m²"
    if uniform_mm is None:
        assert light.uniformity is None and light.raw.rsd is None and light.rsd is None
    else:
        assert light.raw.uniformity == pytest.approx(uniformity(mean, inside))
        assert light.raw.rsd == pytest.approx(relative_deviation(mean, inside))
    physics = light.possible
    assert physics.efficiency > 0.9 and physics.share_in_target > 0.9 and not physics.luminance_estimated


def test_a_receiver_without_light_has_no_figures_that_need_some() -> None:
    dark = np.zeros((5, 4, 6))
    light, _ = lit(dark, spec_of(uniform_mm=20.0))
    assert light.uniformity is None and light.in_region is None and light.nmse_of_noise is None
    assert light.nmse.value == 1.0 and light.wanted_in_target == 1.0
    assert light.flux.reflected == 1.0


def known_receiver() -> ReceiverLight:
    """Light whose target has 15 of 16.5 W above a tenth of its maximum."""
    light, _ = lit(np.ones((2, 4, 6)), spec_of(), 48.0)
    wanted = np.zeros((4, 6))
    wanted[0, :4] = 10.0, 5.0, 1.0, 0.5
    return light.model_copy(update={"target_map": wanted})


def test_the_wanted_light_in_the_target_is_that_above_a_tenth_of_the_maximum() -> None:
    light = known_receiver()
    assert light.wanted_in_target == pytest.approx(15.0 / 16.5)
    less = light.model_copy(update={"target_map": 1e-3 * light.target_map})
    assert less.wanted_in_target == pytest.approx(15.0 / 16.5)


def test_the_most_light_in_the_target_is_set_by_the_faces_or_by_the_law_of_physics() -> None:
    transmitted = 0.5 * 15.0 / 16.5
    for possible, most in ((0.4, 0.4), (transmitted, transmitted), (0.6, transmitted)):
        light = known_receiver()
        physics = light.possible.model_copy(update={"share_in_target": possible})
        share, law = possible_share(light.model_copy(update={"possible": physics}), 0.5)
        assert share == pytest.approx(most)
        faces = possible >= transmitted
        assert law == ("two faces transmit into the target" if faces else f"is the upper bound ({physics.law})")


@pytest.mark.parametrize(("bound", "estimate"), [(0.4, 0.3), (0.4, 0.45), (0.9, 0.44), (0.9, 0.47)])
def test_the_most_light_to_be_expected_is_the_least_of_faces_bound_and_estimate(bound: float, estimate: float) -> None:
    transmitted = 0.5 * 15.0 / 16.5
    light = known_receiver()
    of_source = EstimatedLight(efficiency=0.95, share_in_target=estimate, nmse=0.0)
    physics = light.possible.model_copy(update={"share_in_target": bound, "estimate": of_source})
    share, law = possible_share(light.model_copy(update={"possible": physics}), 0.5)
    assert share == pytest.approx(min(bound, estimate, transmitted))
    laws = {estimate: "étendue may leave, by an estimate", bound: f"is the upper bound ({physics.law})"}
    assert law == laws.get(share, "two faces transmit into the target") and physics.luminance_estimated


def test_every_fate_has_its_share_of_the_budget() -> None:
    by_fate = np.zeros((2, CAUSES + 2))  # two further bodies
    by_fate[:] = np.arange(1.0, CAUSES + 3.0) / 300.0
    inside = np.array([0.002, 0.004])
    landed = by_fate[:, Fate.LEFT_LENS]
    received = ReceivedFlux(np.zeros((2, 1, 1)), by_fate, inside, landed - inside, np.zeros((2, 0)))
    flux, missed = _flux_budget(received, 0.5)
    share = by_fate[0] / 0.5
    places = (MISSED_RECEIVER, ABSORBED, IN_GLASS, BLOCKED, SECOND_WALL, CAUSES)
    assert places == tuple(len(Fate) + k for k in range(6))
    expected = {
        "detected": 0.006, "outside": share[0] - 0.006, "total_reflection": share[4], "not_converged": share[5],
        "missed": share[[1, 2, 3, 6, 7, 8, 9]].sum(), "absorbed": share[10], "cover_glass": share[11],
        "housing": share[12], "second_wall": share[13], "bodies": share[14:].sum(), "reflected": 1.0 - share.sum(),
    }  # fmt: skip
    assert flux.model_dump() == pytest.approx(expected)
    causes = ("backward", "outside_cavity", "base", "surfaces_intersect", "event_limit", "flange", "missed_receiver")
    assert missed.model_dump() == pytest.approx(dict(zip(causes, share[[1, 2, 3, 6, 7, 8, 9]], strict=True)))
