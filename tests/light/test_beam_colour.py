"""Colour of beams in closed form, without the noise of its rays; its limits, facts and record."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from presets import FEW
from scenes import small_spec, sphere

from lensforge.errors import InputError
from lensforge.light.beam_colour import BeamColour
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate
from lensforge.light.light_facts import light_facts, light_reasons
from lensforge.optics.colorimetry import tristimulus_of, uv_of
from lensforge.scene.lens import Lens
from lensforge.sources.source_spectrum import spectrum_of
from lensforge.spec import Spec
from lensforge.spec.emitter_section import GaussianSpectrum

WARM = np.array([60.0, 50.0, 20.0])
COOL = np.array([50.0, 52.0, 60.0])
RED = {"kind": "gaussian", "peak_nm": 630.0, "fwhm_nm": 20.0}
BLUE = {"kind": "gaussian", "peak_nm": 455.0, "fwhm_nm": 24.0}


def pictures(light: np.ndarray, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Sixteen replicates of ``light`` [row, column, XYZ], whose mean has relative ``noise`` in each value."""
    rng = np.random.default_rng(seed)
    replicates = light * (1.0 + 4.0 * noise * rng.normal(size=(16, *light.shape)))
    return np.moveaxis(replicates, -1, 0)


def halves(side: int = 20) -> np.ndarray:
    """A square of two colours, the left half warm, in the dark."""
    light = np.zeros((side, side, 3))
    light[4:-4, 4 : side // 2] = WARM
    light[4:-4, side // 2 : -4] = COOL
    return light


def test_two_colours_side_by_side_in_closed_form() -> None:
    colour = BeamColour.of(pictures(halves()), 0.5)
    assert colour is not None
    mean = uv_of(WARM + COOL)
    apart = [float(np.linalg.norm(uv_of(light) - mean)) for light in (WARM, COOL)]
    assert (colour.u.value, colour.v.value) == pytest.approx(tuple(mean))
    assert colour.rms.value == pytest.approx(np.sqrt(np.mean(np.square(apart))))
    assert max(apart) * np.cos(np.pi / 32.0) - 1e-12 <= colour.worst.value <= max(apart) + 1e-12
    assert colour.pixels == 144
    assert colour.cct is not None and colour.cct.unit == "K" and 3000.0 < colour.cct.value < 7000.0


def test_the_beam_ends_at_its_level_of_the_peak() -> None:
    light = np.ones((21, 21, 1)) * WARM * np.linspace(1.0, 0.001, 21)[:, None, None]
    assert [colour.pixels for level in (0.5, 0.1) if (colour := BeamColour.of(pictures(light), level))] == [
        11 * 21,
        19 * 21,
    ]
    assert BeamColour.of(pictures(0.0 * light), 0.5) is None


def test_noise_of_the_rays_is_no_difference_of_colours() -> None:
    """Pictures of one colour with 2 % of noise in each value have as much Δu'v' to look at, and none without noise."""
    one_colour = np.broadcast_to(WARM, (40, 40, 3))
    beams = [BeamColour.of(pictures(one_colour, 0.02, seed), 0.5) for seed in range(24)]
    rms = np.array([beam.rms.value for beam in beams if beam])
    looks = uv_of(pictures(one_colour, 0.02).mean(axis=1).transpose(1, 2, 0)) - uv_of(WARM)
    assert np.sqrt((looks**2).sum(axis=-1).mean()) > 0.0028
    assert rms.mean() < 0.0007
    values, errors = np.array([(beam.worst.value, beam.worst.standard_error) for beam in beams if beam]).T
    assert 0.8 < np.sqrt((values**2).mean() / (errors**2).mean()) < 1.25, "its scatter about 0"
    assert np.median(values) < 0.5 * np.median(errors)
    assert (values < 4.5 * errors).all()


def test_differences_under_noise_are_the_true_ones_within_their_errors() -> None:
    truth = BeamColour.of(pictures(halves(40)), 0.5)
    colours = [BeamColour.of(pictures(halves(40), 0.02, seed), 0.5) for seed in range(16)]
    assert truth is not None
    for name in ("u", "v", "rms", "worst"):
        figures = [getattr(colour, name) for colour in colours if colour]
        values, errors = np.array([(figure.value, figure.standard_error) for figure in figures]).T
        scores = (values - getattr(truth, name).value) / errors
        assert abs(scores.mean()) < 1.0 and np.abs(scores).max() < 4.5, name


# Nine columns of either colour, all as far from their mean, between two of the directions in which the worst is sought.
AS_MUCH = COOL * (WARM @ [1, 15, 3]) / (COOL @ [1, 15, 3])
EVEN = np.where(np.arange(18)[:, None] < 9, AS_MUCH, WARM) * np.ones((20, 1, 1))


@pytest.mark.parametrize(
    ("light", "replicates", "noise"),
    [
        (EVEN, 16, 0.0),
        (EVEN, 3, 0.0),  # too few to take noise off
        (WARM * np.ones((20, 20, 1)), 16, 0.02),  # of one colour: noise alone
        (halves(40), 16, 0.1),
        (halves(40), 9, 0.1),
    ],
)
def test_no_pixel_farther_than_the_worst(light: np.ndarray, replicates: int, noise: float) -> None:
    """The largest of the distances is at least their root mean square."""
    for seed in range(12 if noise else 1):
        colour = BeamColour.of(pictures(light, noise, seed)[:, :replicates], 0.3)
        assert colour is not None and colour.worst.value >= colour.rms.value >= 0.0


def chip(x: float, spectrum: Any, flux_w: float = 1.0) -> dict[str, Any]:
    return {"x_mm": x, "y_mm": 0.0, "width_mm": 0.6, "height_mm": 0.6, "spectrum": spectrum, "flux_w": flux_w}


def spheres(*chips: dict[str, Any], **changes: Any) -> Lens:
    spec = small_spec(source={"kind": "chips", "chips": list(chips)}, base={"kind": "none"}, **changes)
    return Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW)


def lit(lens: Lens) -> Light:
    return evaluate(lens, rays=2**15, pixels=16)


def xyz(spectrum: dict[str, Any]) -> np.ndarray:
    table = spectrum_of(GaussianSpectrum.model_validate(spectrum))
    return tristimulus_of(table.wavelengths_nm, table.power_density)


def test_superposed_chips_have_their_mixed_colour_everywhere() -> None:
    light = lit(spheres(chip(0.0, RED, 1.0), chip(0.0, BLUE, 3.0), colour={}))
    colour = light.first.colour
    assert colour is not None
    mixed = uv_of(xyz(RED) + 3.0 * xyz(BLUE))
    for metric, wanted in zip((colour.u, colour.v), mixed, strict=True):
        assert abs(metric.value - wanted) < 4.0 * (metric.standard_error or 0.0)
    assert colour.rms.value < 3.0 * (colour.rms.standard_error or 0.0)
    assert colour.cct is None, "purple is no white"


@pytest.mark.parametrize("lamps", [None, {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 25.0}])
def test_the_light_of_chips_together_is_the_sum_of_each(lamps: dict[str, Any] | None) -> None:
    """Same flux of each, so that the chips share the rays of one sample; X, Y, Z add up within the noise."""
    more = {} if lamps is None else {"lamps": lamps}
    both = lit(spheres(chip(-0.5, RED), chip(0.5, BLUE), colour={}, **more)).first
    singles = [lit(spheres(chip(x, spectrum), colour={}, **more)).first for x, spectrum in ((-0.5, RED), (0.5, BLUE))]
    together, alone = (
        np.array([light.tristimulus_map.sum(axis=(1, 2)) for light in lights]) for lights in ([both], singles)
    )
    np.testing.assert_allclose(together[0], alone.sum(axis=0), rtol=3e-3)
    watts = both.map.sum()
    np.testing.assert_allclose(together[0] / watts, 0.5 * (xyz(RED) + xyz(BLUE)), rtol=5e-3)
    assert both.colour is not None and both.colour.rms.value > 10.0 * (both.colour.rms.standard_error or 0.0)


def test_chips_that_change_places_mirror_the_colours_of_the_far_field() -> None:
    far = {"kind": "disc", "half_angle_deg": 40.0, "diameter_deg": 60.0}
    ratios = []
    for left, right in ((RED, BLUE), (BLUE, RED)):
        light = lit(spheres(chip(-0.8, left), chip(0.8, right), target=far, colour={"within": "tenth"})).first
        x, _, z = light.tristimulus_map
        ratios.append((x[:, :8].sum() / z[:, :8].sum()) / (x[:, 8:].sum() / z[:, 8:].sum()))
        assert light.colour is not None and light.colour.level == 0.1
    assert ratios[0] > 1.1
    assert ratios[0] * ratios[1] == pytest.approx(1.0, abs=0.02)


def _reasons(light: Light, lens: Lens) -> Sequence[str]:
    return [reason for _, reason in light_reasons(light, lens)]


def test_limits_on_colour_are_judged_by_the_verdict() -> None:
    chips = (chip(-0.5, RED), chip(0.5, BLUE))
    alike = (chip(-0.5, RED), chip(0.5, RED))
    strict = {"within": "tenth", "max_rms_delta_uv": 0.005, "max_delta_uv": 0.9}
    lens = spheres(*chips, colour=strict)
    light = lit(lens)
    assert [limit.outcome for limit in light.limits] == ["missed", "held"]
    assert [limit.metric for limit in light.limits] == [light.first.colour.rms, light.first.colour.worst]
    assert [reason.split(" = ")[0] for reason in _reasons(light, lens)] == ["Δu′v′ rms within a tenth of the peak"]
    assert _reasons(light, lens)[0].endswith(
        ": take a larger lens, a softer edge of the target, or a face that scatters"
    )
    facts = {fact.key: fact for group in light_facts(light, lens) for fact in group.facts}
    assert {"colour_u", "colour_v", "cct", "rms_delta_uv", "worst_delta_uv"} <= set(facts)
    same = spheres(*alike, colour=strict)
    assert _reasons(lit(same), same) == []


def test_a_light_with_colours_is_kept_and_one_without_has_none(tmp_path: Path) -> None:
    chips = chip(-0.5, RED), chip(0.5, BLUE)
    light = lit(spheres(*chips, colour={}))
    plain = lit(spheres(*chips))
    light.write(tmp_path)
    assert Light.read(tmp_path) == light
    assert (plain.first.colour, plain.first.tristimulus_map) == (None, None)
    np.testing.assert_array_equal(plain.map, light.map)


def test_each_of_several_leds_has_its_colour() -> None:
    leds = [{"kind": "chips", "chips": [chip(0.0, spectrum)]} for spectrum in (RED, BLUE)]
    sources = [{"name": f"led_{number}", "source": led} for number, led in enumerate(leds)]
    spec = small_spec(sources=sources, source=None, colour={}, base={"kind": "none"})
    light = lit(Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW))
    colours = [result.receivers[0].colour for result in light.by_led.values()]
    assert [colour is not None and (colour.u.value, colour.v.value) for colour in colours] == [
        pytest.approx(tuple(uv_of(xyz(spectrum)))) for spectrum in (RED, BLUE)
    ]


def test_colour_of_a_source_without_a_spectrum_is_one_line_at_once() -> None:
    spec: Spec = small_spec(colour={}, base={"kind": "none"})
    with pytest.raises(InputError, match="source: its colour is not known; give its spectrum, or leave out"):
        lit(Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW))


def test_the_pixels_of_a_beam_are_those_of_the_mean_of_its_replicates() -> None:
    """A ramp whose replicates differ: each alone is dark in other pixels, and the mean of all is the ramp itself."""
    ramp = np.linspace(1.0, 0.1, 10)[None, :, None] * WARM * np.ones((6, 1, 1))
    uneven = np.array([0.4, 1.6, 1.3, 0.7])[:, None, None, None] * ramp
    uneven[0, :, 4:] *= 0.1
    uneven[1, :, 4:] *= (4.0 - 0.7 - 1.3 - 0.04) / 1.6
    colour = BeamColour.of(np.moveaxis(uneven, -1, 0), 0.45)
    assert colour is not None and colour.pixels == 6 * int((ramp[0, :, 1] >= 0.45 * WARM[1]).sum()) == 36
