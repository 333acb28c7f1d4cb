"""The best of several searches, and what is stated of all of them."""

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.optimisation.design import Start


def test_the_best_of_the_starts_is_the_design_of_its_seed():
    spec, said = small_spec(), []
    found = lf.best_design(spec, starts=3, seed=5, accuracy="draft", announce=said.append)
    assert [start.seed for start in found.starts] == [5, 6, 7]
    best = min(found.starts, key=lambda start: (start.missed, start.merit))
    alone = lf.design(spec, seed=best.seed, accuracy="draft")
    assert found.lens == alone.lens
    light = lf.evaluate(alone.lens)
    assert (best.nmse, best.efficiency) == (light.nmse, light.efficiency)
    assert found.spread > 0.0
    assert alone.spread is None
    assert len(said) == 3
    assert said[0].startswith("start 1 of 3: seed 5, NMSE ")


def test_a_lens_that_misses_a_constraint_is_no_better_for_its_light():
    light = lf.Metric(value=0.1)
    figures = {"seed": 0, "nmse": light, "efficiency": light, "seconds": 0.0}
    assert Start(merit=2.0, missed=0, **figures).rank < Start(merit=1.0, missed=1, **figures).rank


def test_the_record_of_a_run_has_all_starts(tmp_path, undrawn):
    run = lf.run(small_spec(), tmp_path / "best", accuracy="draft", starts=2)
    again = lf.load(tmp_path / "best")
    assert again.design == run.design
    assert len(again.design.starts) == 2


@pytest.mark.parametrize(("starts", "seed"), [(0, 0), (1001, 0), (2, 2**64)])
def test_starts_out_of_range_are_refused(starts, seed):
    with pytest.raises(InputError):
        lf.best_design(small_spec(), starts=starts, seed=seed)


def test_several_starts_do_not_resume(tmp_path):
    with pytest.raises(InputError, match="without start, checkpoint"):
        lf.run(small_spec(), tmp_path, starts=2, checkpoint=tmp_path / "checkpoint.bin")
