"""The yield of a road: the share of parts that hold its class, and what decides on it."""

import numpy as np
import pytest
from parts import lens_with

from lensforge.addons.road.road_classes import THRESHOLD_INCREMENT
from lensforge.light.judged_limits import limit_value
from lensforge.made import yield_study
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.spec.quantities import LeastOverMost, RatioOfTwo, RelativeLight

FAR = {"kind": "beam", "fwhm_deg": 60.0, "half_angle_deg": 90.0}
ROAD = {"lighting_class": "M6", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0, "lamp_lm": 3e3}


def measured_inside(study: PartStudy) -> np.ndarray:
    """Figures of parts that meet every limit by far, without errors."""
    measured = np.zeros((study.recipe.parts, len(study.names), 2))
    for bound in study.bounds:
        measured[:, study.names.index(bound.metric), 0] = bound.bound * (2.0 if bound.sense == ">=" else 0.5)
    return measured


def on_road(parts: int = 40) -> PartStudy:
    lens = lens_with({"source_flux": 0.05, "index": 1e-9}, target=FAR, roads=[ROAD | {"glare_percent": 20.0}])
    return PartStudy(Recipe(lens, parts, 512, 0, 1024))


def test_a_part_that_misses_one_bound_of_several_does_not_pass_and_is_among_the_worst() -> None:
    study = on_road()
    measured = measured_inside(study)
    for part, bound in ((7, study.bounds[0]), (11, study.bounds[-1])):
        measured[part, study.names.index(bound.metric), 0] = bound.bound * (0.9 if bound.sense == ">=" else 1.1)
    (first, second, third), _ = yield_study._worst(study, measured)
    assert {first.part, second.part} == {7, 11} and [worst_part.passes for worst_part in (first, second, third)] == [
        False,
        False,
        True,
    ]
    (road,) = yield_study._applications(study, measured)
    assert road.pass_rate.value == 38 / 40
    values = np.column_stack([[1.0, 2.0, 4.0, 9.0], [0.5, 1.5, 1.0, 2.0]])
    assert yield_study._true_spread(values) == pytest.approx(np.sqrt(38.0 / 3.0 - (0.25 + 2.25 + 1.0 + 4.0) / 4.0))


@pytest.mark.parametrize(("noise", "decided"), [(0.02, True), (0.1, False)])
def test_causes_of_a_road_are_sought_where_the_spread_is_larger_than_the_noise_of_its_figure(
    noise: float, decided: bool
) -> None:
    """Glare of 20 % is the nearest figure of each part, and differs by 2 % of it; all else is far from its bound."""
    study = on_road()
    measured = measured_inside(study)
    glare = next(study.names.index(bound.metric) for bound in study.bounds if bound.unit == "%")
    measured[:, glare, 0] = 20.0 * (0.9 + 0.5 * study.draws.numbers["source_flux"][:, 0] * 0.1)
    measured[:, glare, 1] = 20.0 * noise * 0.5
    (road,) = yield_study._applications(study, measured)
    assert road.nearest == study.names[glare] and (road.variance is not None) == decided
    assert 0.02 < measured[:, glare, 0].std() / 20.0 < 0.03


def test_limits_read_at_once_are_those_read_one_by_one() -> None:
    """Of all replicates, and with each left out; a figure over the maximum of the picture needs the whole picture."""
    glare = {"kind": "glare", "from_deg": 60.0, "unit": "relative", "at_most": 0.3}
    wanted = {"target": FAR, "roads": [ROAD], "limits": [glare]}
    light = PartStudy(Recipe(lens_with({"source_flux": 0.05}, **wanted), 2, 4096, 0, 4096)).leds[0].light
    received = light.received(None)
    images = received[0].images
    assert {limit.quantity for limit in light.limits} >= {
        RelativeLight(),
        RatioOfTwo(),
        THRESHOLD_INCREMENT,
        LeastOverMost(),
    }
    for limit, values in zip(light.limits, light.measured(received).limits, strict=True):
        kept = [images, *(np.delete(images, k, axis=0) for k in range(len(images)))]
        np.testing.assert_array_equal(
            values, [limit_value(limit, replicates).value for replicates in kept], err_msg=limit.name
        )
