"""The temperature of the lens as a tolerance: the part's light is that of the lens at that temperature."""

from dataclasses import replace

import numpy as np
import pytest
from presets import FEW
from scenes import NO_TOLERANCES, random_surface, small_spec, tolerance_changes

import lensforge as lf
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.scene.lens_at_temperature import at_temperature
from lensforge.search.light_path import SearchParts
from lensforge.search.problem import parameters_of

PLASTIC = {"lens__index_per_k": -1.1e-4, "lens__expansion_per_k": 7e-5}
ALONE = tolerance_changes({**NO_TOLERANCES, "temperature_k": 30.0})
GLASS = {"lens__refractive_index": None, "lens__material": "N-BK7"}


def lens_of(**changes):
    faces = (random_surface(seed, 3.0 * seed, 0.01, (9,)) for seed in (1, 2))
    return lf.Lens.double(*faces, small_spec(**changes), 0, FEW)


@pytest.mark.parametrize("at_work", [{}, {"lens__temperature_c": 45.0}])
@pytest.mark.parametrize("material", [PLASTIC, GLASS])
def test_a_warm_part_sends_each_ray_where_the_lens_at_that_temperature_does(material, at_work) -> None:
    content = {name: value for name, value in {**material, **at_work, **ALONE}.items() if value is not None}
    lens = lens_of(**content)
    study = PartStudy(Recipe(lens, 1, 512, 0, 512))
    assert [factor.name for factor in study.factors] == ["temperature_k"]
    (led,) = study.leds
    celsius = (lens.spec.lens.temperature_c or 20.0) + 17.0
    warm = at_temperature(lens, celsius)
    exits = led.light.exit_rays(led.made([{"temperature_k": np.array([17.0])}])[0])
    wanted = led.light.nominal.at_work(warm.spec).trace(led.light.held.rays)
    np.testing.assert_allclose(exits.points, wanted.points, atol=1e-11)
    np.testing.assert_allclose(exits.directions, wanted.directions, atol=1e-12)
    cold = led.light.exit_rays(None)
    assert np.abs(exits.directions - cold.directions).max() > 1e-5


def test_sensitivity_states_both_ends_of_it() -> None:
    """Warm plastic bends less, cold one more: the changes have opposite signs, and those of the lens at both ends."""
    lens = lens_of(**PLASTIC, **ALONE)
    sensitivity = lf.sensitivity(lens, rays=2**14)
    assert [(row.name, row.amount, row.unit) for row in sensitivity.rows] == [
        ("temperature of the lens", amount, "K") for amount in (30.0, -30.0)
    ]
    for row in sensitivity.rows:
        light = lf.evaluate(lens, temperature_c=20.0 + row.amount, rays=2**14, pixels=16)
        assert row.metrics.efficiency.value == pytest.approx(light.efficiency.value, abs=2e-4)
    warm, cold = (row.change.efficiency.value for row in sensitivity.rows)
    assert warm > 1e-4 and cold < -1e-4


def test_yield_spreads_by_it_and_a_robust_search_draws_it() -> None:
    uniform = {"tolerances__temperature_k": {"amount": 30.0, "distribution": "uniform"}}
    lens = lens_of(**{**PLASTIC, **ALONE, **uniform})
    study = lf.tolerance(lens, parts=40, rays=512, budget=False)
    kelvin = study.table[:, study.columns.index("temperature_k")]
    assert np.abs(kelvin).max() <= 30.0 and kelvin.std() == pytest.approx(30.0 / np.sqrt(3.0), rel=0.1)
    assert np.corrcoef(kelvin, study.table[:, study.columns.index("efficiency")])[0, 1] > 0.95
    parts = SearchParts.of(lens.spec, parameters_of(lens.spec.with_levels((9,)), 3.0))
    assert {factor.name for factor in parts.factors} == {"temperature_k"}
    first, second = next(iter(parts.of_validation(0, 1)))
    assert first.index == -second.index != 0.0 and first.made.scale != 1.0


def test_a_spread_of_the_index_is_drawn_as_the_batch_has_it_and_the_light_follows() -> None:
    """By the study's light at an index: that of the lens with it, to the errors of its rays."""
    spread = {"tolerances__index": {"amount": 0.01, "distribution": "normal"}}
    lens = lens_of(**{**tolerance_changes(NO_TOLERANCES), **spread})
    study = lf.tolerance(lens, parts=60, rays=512, budget=False)
    drawn = study.table[:, study.columns.index("index")]
    assert drawn.std() == pytest.approx(0.005, rel=0.1) and abs(drawn.mean()) < 1e-3
    rows = lf.sensitivity(lens, rays=2**14).rows
    assert [(row.name, row.amount) for row in rows] == [("refractive index", 0.01), ("refractive index", -0.01)]
    for row in rows:
        index = lens.spec.lens.refractive_index + row.amount
        light = lf.evaluate(lens_of(lens__refractive_index=index), rays=2**14, pixels=16)
        assert row.metrics.efficiency.value == pytest.approx(light.efficiency.value, abs=2e-4)
    parts = SearchParts.of(lens.spec, parameters_of(lens.spec.with_levels((9,)), 3.0))
    first, second = next(iter(parts.of_validation(0, 1)))
    assert first.index == -second.index != 0.0


def test_it_needs_to_be_known_how_the_material_changes() -> None:
    with pytest.raises(lf.InputError, match=r"tolerances.temperature_k: .*give lens.index_per_k .* and lens.expansion"):
        small_spec(**ALONE)
    plate = {"lamps": {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 40.0}, "plate": {"thickness_mm": 2.0}}
    with pytest.raises(lf.InputError, match="plate: its lenses are at the temperature of reference"):
        small_spec(**PLASTIC, **ALONE, base={"kind": "none"}, **plate)
    assert replace(lens_of()).spec.part_tolerances.tolerance("temperature_k").amount == 0.0
