"""Pictures of colours on a receiver: what they draw, and that the page has them."""

import numpy as np
import pytest
from result_folders import make_light, small_lens

from lensforge.light.beam_colour import BeamColour
from lensforge.optics.colorimetry import srgb_of, uv_of
from lensforge.report.colour_figures import colour_of_rings, colour_over_angle, delta_uv_map, true_colours
from lensforge.report.headline import required_facts
from lensforge.report.results import Results
from lensforge.results.chart import Chart

WARM, COOL = np.array([60.0, 50.0, 20.0]), np.array([50.0, 52.0, 60.0])
PLANE, SKY = Chart(100.0, 100.0), Chart(0.4, 0.4, True)


def rings(side: int = 40) -> np.ndarray:
    """A cool disc in a warm ring, in the dark: X, Y, Z on [3, row, column]."""
    place = np.abs(np.linspace(-1.0, 1.0, side))
    distance = np.hypot(place[:, None], place[None, :])
    light = np.where((distance < 0.4)[..., None], COOL, np.where((distance < 0.8)[..., None], WARM, 0.0))
    return np.moveaxis(light, -1, 0)


def beam(light: np.ndarray) -> BeamColour:
    colour = BeamColour.of(np.repeat(light[:, None], 16, axis=1), 0.5)
    assert colour is not None
    return colour


def test_the_light_has_its_colours_and_the_map_their_distances() -> None:
    light = rings()
    light[:, 0, -1] = (3.0, 5.5, 6.0)  # a tenth of the luminance of the peak, and less of its X
    light[:, -1, 0] = (9.0, 4.5, 6.0)
    colour = beam(light)
    image = true_colours(light, colour, PLANE).axes[0].images[0].get_array()
    np.testing.assert_allclose(image[20, 20], srgb_of(np.array([WARM, COOL]))[1], atol=1e-9)
    away = delta_uv_map(light, colour, PLANE).axes[0].images[0].get_array()
    mean = np.array([colour.u.value, colour.v.value])
    assert away[20, 20] == pytest.approx(float(np.linalg.norm(uv_of(COOL) - mean)))
    dark = np.ma.getmaskarray(np.ma.masked_invalid(away))
    assert dark[0, 0] and dark[-1, 0] and not dark[0, -1], "no colour in the dark, which luminance tells"


@pytest.mark.parametrize(("chart", "reach"), [(PLANE, 40.0), (SKY, 0.16)])
def test_rings_have_the_colour_of_their_light(chart: Chart, reach: float) -> None:
    radii, uv = colour_of_rings(rings(), chart)
    assert radii[-1] == pytest.approx(reach, rel=0.06)
    whole, _ = colour_of_rings(np.ones((3, 40, 40)), chart)
    assert whole[-1] == pytest.approx(1.25 * reach, rel=0.06), "to the edge of the chart"
    np.testing.assert_allclose(uv[0], uv_of(COOL))
    np.testing.assert_allclose(uv[np.searchsorted(radii, 0.75 * reach)], uv_of(WARM))
    axes = colour_over_angle(rings(), beam(rings()), chart).axes[0]
    assert len(axes.lines) == 2 and ("°" in axes.get_xlabel()) == chart.far_field


def test_a_colour_temperature_has_its_distance_from_planck_beside_it_and_the_worst_colour_the_rms() -> None:
    light = make_light(small_lens())
    coloured = light.first.changed(colour=beam(rings()), tristimulus_map=rings(16))
    results = Results(small_lens(), {"evaluate": light.changed(receivers=(coloured,))})
    keys = [fact.key for fact in required_facts(results)]
    assert keys[keys.index("cct") :][:4] == ["cct", "duv", "rms_delta_uv", "worst_delta_uv"]
