"""Light on escape routes: plain loops over a crooked lamp, closed forms, both sides of each limit, and its files."""

from math import atan2, cos, hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from application_pixels import judged_both_ways, values_of
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.addons.escape.route_light import RouteJudgement, RouteLight
from lensforge.addons.escape.route_section import RouteSection
from lensforge.errors import InputError
from lensforge.light.by_intensities import of_file
from lensforge.scene.intensity_limit import CandelaSum
from lensforge.sources.photometric.photometric_io import read_photometric

ROUTE: dict[str, Any] = {"lamp_height_m": 2.6, "spacing_m": 11.0, "width_m": 1.8}
STREET_DEG = 90.0  # of lens azimuths, from which those of a file are counted


def lobe(azimuth: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Candela by the azimuth from x, along the route, and the angle from the axis (rad): more to one end, and aside."""
    along = 1.0 + 0.7 * np.sin(gamma) ** 2 * np.cos(2.0 * azimuth - 0.3) + 0.4 * np.sin(gamma) * np.cos(azimuth - 0.8)
    return 60.0 * along * np.maximum(np.cos(gamma), 0.0) ** 0.5


def judged(factor: float = 1.0, **fields: object) -> RouteJudgement:
    def candela(light: CandelaSum) -> np.ndarray:
        intensity = lobe(np.radians(light.azimuth_deg + STREET_DEG), np.radians(light.gamma_deg))
        return factor * intensity[None]

    return RouteLight(RouteSection(**ROUTE | fields)).judged(candela, "route")


def lux(x: float, y: float) -> float:
    """Of eleven lamps on either side of the point, as far as the point sees them within twelve heights."""
    high, spacing = ROUTE["lamp_height_m"], ROUTE["spacing_m"]
    light = 0.0
    for number in range(-11, 12):
        east = x - number * spacing
        level = hypot(east, y)
        if level <= 12.0 * high:
            gamma = atan2(level, high)
            candela = float(lobe(np.array(atan2(y, east)), np.array(gamma)))
            light += candela * cos(gamma) ** 3 / high**2
    return light


def test_a_crooked_lamp_lights_a_route_as_plain_loops_say() -> None:
    """Steps of a tenth of the height at most, an even number of them; the band is half of the width."""
    count = 2 * int(np.ceil(0.5 * 11.0 / 0.26))
    places = np.linspace(0.0, 11.0, count + 1)
    line = [lux(x, 0.0) for x in places]
    band = [lux(x, y) for x in places for y in (-0.45, -0.225, 0.0, 0.225, 0.45)]
    judgement = judged(maintenance_factor=0.7)
    least, of_band, diversity, glare = (limit.value for limit in judgement.limits)
    assert least == pytest.approx(0.7 * min(line), rel=1e-9)
    assert of_band == pytest.approx(0.7 * min(band), rel=1e-9) and of_band < least
    assert diversity == pytest.approx(max(line) / min(line), rel=1e-9)
    assert judgement.line_lx.value == pytest.approx(0.7 * np.mean(line), rel=1e-9)
    steep = [lobe(np.radians(c), np.radians(g)) for c in np.arange(0.0, 360.0, 2.5) for g in range(60, 91)]
    assert glare == pytest.approx(max(steep), rel=1e-9), "of a new lamp"


@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("off", [1e-6, -1e-6])
def test_each_limit_is_held_on_one_side_of_its_number_alone(number: int, off: float) -> None:
    """A required illuminance just below what there is, and just above; a lamp just bright enough to glare."""
    whole = [limit.value for limit in judged().limits]
    match number:
        case 0:
            judgement = judged(line_lx=whole[0] * (1.0 - off))
        case 1:
            judgement = judged(line_lx=2.0 * whole[1] * (1.0 - off))
        case 2:
            judgement = judged(spacing_m=_spacing_at(40.0) * (1.0 - off))
        case _:
            judgement = judged(900.0 / whole[3] * (1.0 - off))
    assert judgement.limits[number].holds == (off > 0.0)
    assert judgement.reached == ("escape route" if all(limit.holds for limit in judgement.limits) else "none")


def _spacing_at(diversity: float) -> float:
    """Spacing at which the largest light is so many times the least, by bisection."""
    low, high = 5.0, 60.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if judged(spacing_m=middle).limits[2].value < diversity else (low, middle)
    return low


@pytest.mark.parametrize(
    ("height_m", "most"), [(2.4, 500.0), (2.5, 900.0), (3.2, 1600.0), (3.5, 2500.0), (4.4, 3500.0), (4.5, 5000.0)]
)
def test_higher_lamps_may_be_brighter(height_m: float, most: float) -> None:
    """EN 1838, table 1."""
    assert RouteSection(lamp_height_m=height_m, spacing_m=9.0).most_cd == most


def test_a_wider_route_is_several() -> None:
    with pytest.raises(InputError, match="width_m"):
        RouteSection(**ROUTE | {"width_m": 2.1})


def spec_of(lamp_lm: float) -> lf.Spec:
    far = {"kind": "far_field", "name": "sky", "half_angle_deg": 90.0, "targets": [{"kind": "beam", "fwhm_deg": 60.0}]}
    return small_spec(target=None, receivers=[far], routes=[ROUTE | {"lamp_lm": lamp_lm}])


def test_the_evaluation_the_photometry_and_the_file_have_one_figure(tmp_path: Path) -> None:
    spec = spec_of(200.0).replace(evaluate={"rays": 1024, "pixels": 16, "window_mm": None})
    preset = FEW.replace("escape", photometry_rays=(2**12, 2**12))
    lens = lf.Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), spec, 3, preset)
    light, far = lf.evaluate(lens), lf.photometry(lens)
    (route,) = far.routes
    by_light = [(limit.label, limit.value, limit.standard_error) for limit in light.limits]
    assert by_light == [(f"route: {limit.label}", limit.value, limit.standard_error) for limit in route.limits]
    assert len(by_light) == 4 and all(error > 0.0 for _, _, error in by_light)
    far.save(tmp_path / "lens.ies")
    lamp = of_file(read_photometric(tmp_path / "lens.ies"), -spec.photometry.street_side_deg, 200.0)
    read = RouteLight(spec.routes[0]).judged(lamp, "route")
    figures, stated = ([limit.metric.value for limit in judged.limits] for judged in (read, route))
    np.testing.assert_allclose(figures, stated, rtol=1e-3)


def test_pixels_of_the_far_field_read_the_same_route() -> None:
    spec = spec_of(1.0)
    by_pixels, by_table = judged_both_ways(spec, lobe, 512)
    np.testing.assert_allclose(values_of(by_pixels), values_of(by_table), rtol=0.01)
    assert by_pixels[0].label == "route: centre line"
