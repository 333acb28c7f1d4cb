"""Images of maps in the page: stored with a palette, the same pixel for pixel."""

import base64
import io
import re

import numpy as np
from PIL import Image

from lensforge.report.light_figures import irradiance_map
from lensforge.results import figure_style
from lensforge.results.chart import Chart
from lensforge.results.figure_style import with_palettes


def embedded(svg):
    return [base64.b64decode(found) for found in re.findall(r"data:image/png;base64,([A-Za-z0-9+/=\s]+)", svg)]


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))


def test_maps_of_a_noisy_light_are_smaller_and_the_same(monkeypatch):
    light = np.random.default_rng(0).random((256, 256))
    figure = irradiance_map(light, Chart(200.0, 200.0), 1.0)
    small = embedded(figure_style.to_svg(figure, "map", ""))
    monkeypatch.setattr(figure_style, "with_palettes", lambda svg: svg)
    large = embedded(figure_style.to_svg(figure, "map", ""))
    assert len(small) == len(large) == 2, "the map and its scale"
    assert len(small[0]) < 0.6 * len(large[0])
    for one, other in zip(small, large, strict=True):
        np.testing.assert_array_equal(pixels(one), pixels(other))


def test_transparent_pixels_stay_transparent_and_photographs_stay_as_they_are():
    noise = np.random.default_rng(1)
    clear = np.zeros((64, 64, 4), dtype=np.uint8)
    clear[noise.random((64, 64)) > 0.5] = (200, 10, 20, 128)
    many = noise.integers(0, 256, (64, 64, 4), dtype=np.uint8)
    for image in (clear, many):
        buffer = io.BytesIO()
        Image.fromarray(image).save(buffer, format="png")
        svg = f'<image href="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"/>'
        np.testing.assert_array_equal(pixels(embedded(with_palettes(svg))[0]), image)
        assert (with_palettes(svg) == svg) == (image is many)
