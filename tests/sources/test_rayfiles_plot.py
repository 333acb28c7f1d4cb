"""The picture of a ray file: its histograms hold all of the flux, and the command writes it."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from nightly import first_by_day
from PIL import Image
from rayfile_samples import rays

from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.sources.ray_file_statistics import describe
from lensforge.sources.ray_file_summary import Histograms, draw
from lensforge.sources.rayfiles.ray_file_io import write_rayfile


def _lambertian(count=200_000):
    random = np.random.default_rng(8)
    sine, azimuth = np.sqrt(random.random(count)), 2.0 * np.pi * random.random(count)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.sqrt(1.0 - sine**2)], axis=1)
    positions = random.uniform(-1.0, 1.0, (count, 3)) * [1.0, 0.5, 0.0]
    flux = np.full(count, 2.0 / count)
    return replace(rays(count), positions_mm=positions, directions=directions, flux=flux, header_flux_w=2.0)


def test_intensity_of_a_lambertian_emitter_is_its_closed_form():
    histograms = Histograms.of(_lambertian())
    gamma = np.deg2rad(np.arange(90) + 0.5)
    np.testing.assert_allclose(histograms.intensity()[5:80], 2.0 / np.pi * np.cos(gamma)[5:80], rtol=0.1)
    assert histograms.intensity()[90:].max() == 0.0
    assert histograms.rings.sum() == pytest.approx(2.0)
    lit = histograms.cosines[histograms.cosines > 0.0]
    assert lit.sum() == pytest.approx(2.0)  # a Lambertian emitter fills the unit disc evenly
    assert np.count_nonzero(histograms.cosines) / 64**2 == pytest.approx(np.pi / 4, rel=0.05)


@pytest.mark.parametrize("role", first_by_day(1, ["total", "scale"]))
def test_intensity_is_absolute_where_the_fluxes_of_the_rays_are_relative(role):
    """Fluxes that add up to 10,000 in a file of 2 W: the scale of the picture is that of 2 W."""
    relative = replace(_lambertian(), flux=_lambertian().flux * 5000.0, header_role=role)
    expected = Histograms.of(_lambertian())
    for name in ("front", "side", "cosines", "rings"):
        np.testing.assert_allclose(getattr(Histograms.of(relative), name), getattr(expected, name), rtol=1e-9)
    rays_line, lambertian = describe(relative).plot(which="intensity").lines
    assert rays_line.get_ydata()[5:60].mean() == pytest.approx(lambertian.get_ydata()[5:60].mean(), rel=0.02)
    assert lambertian.get_ydata()[0] == pytest.approx(2.0 / np.pi, rel=1e-4)


def test_the_frame_keeps_proportions_and_leaves_stray_light_out():
    led = _lambertian(1000)
    led.positions_mm[0] = 500.0
    histograms = Histograms.of(led)
    assert np.ptp(histograms.high - histograms.low) == 0.0
    assert histograms.front.sum() == pytest.approx(2.0 * 999 / 1000)
    wide, high = np.ptp(np.nonzero(histograms.front), axis=1)
    assert wide / high == pytest.approx(2.0, rel=0.05)


def test_the_command_draws(tmp_path):
    write_rayfile(tmp_path / "led", rays(300), "tm25")
    result = CliRunner().invoke(cli, ["rays", str(tmp_path / "led"), "--plot", str(tmp_path / "led.png")])
    assert result.exit_code == 0
    assert any(line.split() == ["rays", "in", "the", "file", "300"] for line in result.output.splitlines())
    with Image.open(tmp_path / "led.png") as picture:
        assert picture.size == (1650, 1350)
    with pytest.raises(InputError, match="suffix"):
        draw(rays(3), tmp_path / "led.txt")
    with pytest.raises(InputError, match="usable"):
        draw(replace(rays(3), positions_mm=np.full((3, 3), np.nan)), tmp_path / "led.png")
