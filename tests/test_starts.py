"""The best of several searches, and what is stated of all of them."""

from pathlib import Path

import pytest
from presets import FEW
from scenes import small_spec

import lensforge as lf
from lensforge import seeds
from lensforge.errors import InputError
from lensforge.report.stored import load_results
from lensforge.search.design_result import Start
from lensforge.search.other_rays import light_by_other_rays
from lensforge.search.searches import SeededSearch
from lensforge.surfaces.imported_face import LENS_FILE


def test_the_best_of_the_starts_is_the_design_of_its_seed(tmp_path):
    spec, messages = small_spec(), []
    result = lf.best_design(spec, starts=2, seed=5, accuracy=FEW, announce=messages.append)
    assert [start.seed for start in result.starts] == [5, 6]
    best = min(result.starts, key=lambda start: (start.missed, start.merit))
    alone = lf.design(spec, seed=best.seed, accuracy=FEW)
    assert result.lens == alone.lens
    judged, chosen = lf.evaluate(alone.lens), lf.evaluate(alone.lens, seed=seeds.of_choice(5))
    assert (best.nmse, best.efficiency) == (chosen.nmse, chosen.efficiency), "by the same rays for every start"
    assert best.nmse != judged.nmse, "and not by those that judge the best"
    assert result.spread > 0.0
    assert alone.spread is None
    result.lens.save(tmp_path / LENS_FILE)
    result.write(tmp_path)
    assert load_results(tmp_path).design == result
    assert len(messages) == 2
    assert messages[0].startswith("start 1 of 2: seed 5, NMSE ")


@pytest.mark.nightly("three searches")
def test_rays_of_a_file_that_judge_the_best_do_not_choose_it(monkeypatch):
    """The rays that are held back are in no evaluation of the starts."""
    rays = Path(__file__).parents[1] / "examples" / "led.tm25ray"
    spec = small_spec(source={"kind": "rayfile", "model": "rays", "file": str(rays), "origin": "virtual_focus"})
    monkeypatch.setattr("lensforge.light.evaluation.held_back", lambda _: pytest.fail("held back"))
    result = lf.best_design(spec, starts=2, accuracy=FEW, force=True)
    assert len(result.starts) == 2


def test_limits_that_a_start_misses_with_the_second_led_count():
    """Of two LEDs the second has a quarter of the lumens, by half the flux and half the efficacy: it is too dim."""
    square = {"kind": "square", "side_mm": 1.0}
    leds = [
        {"name": name, "source": {**square, "flux_w": flux_w, "luminous_efficacy_lm_per_w": efficacy}}
        for name, flux_w, efficacy in (("a", 2.0, 100.0), ("b", 1.0, 50.0))
    ]
    limit = {"kind": "points", "at_mm": [[0.0, 0.0]], "unit": "lx", "at_least": 3000.0}
    spec = small_spec(source=None, sources=leds, target__uniform_mm=None, limits=[limit])
    result, start = SeededSearch(spec, FEW, (), None, 7).made(0)
    states = [limit.state for light in light_by_other_rays(result.lens, 7) for limit in light.limits]
    assert states == ["pass", "fail"] and start.missed == 1 + sum(not criterion.holds for criterion in result.criteria)


def test_a_lens_that_misses_a_constraint_is_no_better_for_its_light():
    light = lf.Metric(value=0.1)
    figures = {"seed": 0, "nmse": light, "efficiency": light, "seconds": 0.0}
    assert Start(merit=2.0, missed=0, **figures).rank < Start(merit=1.0, missed=1, **figures).rank


@pytest.mark.parametrize(("starts", "seed"), [(0, 0), (1001, 0), (2, 2**64)])
def test_starts_out_of_range_are_refused(starts, seed):
    with pytest.raises(InputError):
        lf.best_design(small_spec(), starts=starts, seed=seed)


def test_several_starts_do_not_resume(tmp_path):
    with pytest.raises(InputError, match="without start, checkpoint"):
        lf.run(small_spec(), tmp_path, starts=2, checkpoint=tmp_path / "checkpoint.bin")
