from pathlib import Path

import numpy as np
import pytest
from nightly import NIGHTLY
from presets import FEW
from scenes import hemisphere_directions, small_spec
from search_scenes import require_same_bits_after
from tir_lenses import spot, spot_lens

from lensforge.errors import Cancelled
from lensforge.results.arguments import threads_of_torch
from lensforge.scene.lens import Lens
from lensforge.search.design_result import ENOUGH, Progress, design_facts, limits_of
from lensforge.search.optimiser import search
from lensforge.search.parameters import fit_surface
from lensforge.search.schedule import fixed_schedule
from lensforge.search.searches import design
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.bicubic_table import evaluate_table
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface


def test_a_design_gets_better_and_keeps_its_history() -> None:
    spec = small_spec(optimise__steps_per_level=[15, 15], optimise__rays=2048)
    result = search(spec, build_source(spec.source), accuracy=FEW)
    nmse = [value for level in result.history for value in level.nmse]
    assert len(nmse) == 30
    assert np.mean(nmse[-5:]) < 0.8 * np.mean(nmse[:5])
    assert result.steps == 30
    assert all(len(level.efficiency) == len(level.loss) == 15 for level in result.history)
    assert all(len(values) == 15 for level in result.history for values in level.constraints.values())
    last = {name: values[-1] for name, values in result.history[-1].constraints.items()}
    kept = {limit.key: result.constraints.at(limit) for limit in limits_of(result.lens.spec)}
    assert last == pytest.approx(kept, abs=0.03), "one small step before the end"
    turned = result.model_copy(update={"lens": spot_lens()})
    for record, where in ((result, "Outer radius"), (turned, "Outer radius")):
        assert design_facts(record)[0].facts[0].label == where


def test_an_interrupted_design_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    often = FEW.replace("often", effort={"multiplier_steps": 2})
    spec = small_spec(constraints__min_thickness_mm=2.97)
    source = build_source(spec.source)
    whole = search(spec, source, accuracy=often, seed=3)
    assert whole.history[0].constraints["wall_margin_mm"][1] < 0.0, "multipliers are not 0 at the first stop"

    for stop_at in (2, 4, 7) if NIGHTLY else (4,):  # within a level, at its end, within the last
        require_same_bits_after(stop_at, spec, source, tmp_path / f"{stop_at}.bin", whole, 3, often)


def test_the_plan_is_coarse_to_fine_and_the_spec_outranks_the_preset() -> None:
    stages = fixed_schedule(small_spec(), PRESETS["draft"], last_only=False).stages
    assert [stage.functions for stage in stages] == [9, 34]
    assert [stage.steps for stage in stages] == [4, 4]
    assert stages[0].learning_rate > stages[1].learning_rate > stages[1].rate(3)
    assert stages[0].rays == 1024


def test_the_first_steps_of_profiles_are_as_large_as_their_light_bears() -> None:
    """Of a lens for total internal reflection; those of the usual lens are the same for all light."""
    preset = PRESETS["draft"]
    tir = (spot(), (0.25,), (2.0,)), (spot(levels=[9]), (2.0, 0.5), (2.0,))
    for spec, pattern, share in (*tir, (small_spec(), (1.0,), (1.0,))):
        for aim, factors in (("pattern", pattern), ("share", share)):
            aimed = spec.replace({"optimise.aim": aim})
            first = [stage for stage in fixed_schedule(aimed, preset, last_only=False).stages if stage.level == 0]
            rates = [stage.learning_rate / preset.effort.learning_rate for stage in first]
            assert rates == pytest.approx(factors, rel=1e-12)
            assert sum(stage.steps for stage in first) == (aimed.optimise.steps_per_level or ())[0]
            assert all(stage.steps > 0 for stage in first)


def test_a_search_is_as_precise_as_its_preset_says() -> None:
    assert [name for name, preset in PRESETS.items() if not preset.single] == ["reference"]
    spec = small_spec(optimise__steps_per_level=[1, 1])
    weights = []
    for single in (True, False):
        accuracy = FEW.replace("own", single=single)
        weights.append(search(spec, build_source(spec.source), accuracy=accuracy).lens.outer.weights_mm)
    assert 0.0 < np.abs(weights[0] - weights[1]).max() < 1e-5 * np.abs(weights[1]).max()


def test_a_search_from_a_lens_begins_with_that_lens() -> None:
    spec = small_spec(lens__symmetry="none")
    source = build_source(spec.source)
    first = search(spec, source, accuracy=FEW)
    begun: list[Lens] = []
    still = FEW.replace("still", effort={"learning_rate": 1e-12})
    further = search(spec, source, accuracy=still, start=first.lens, progress=lambda step: begun.append(step.lens()))
    assert [level.level for level in further.history] == [1], "all functions move from the first step on"
    for side in ("inner", "outer"):
        before = getattr(first.lens, side)
        after = getattr(begun[0], side)
        assert np.allclose(after.weights_mm, before.weights_mm, rtol=0.0, atol=1e-9)
    assert further.history[0].nmse[0] == pytest.approx(first.history[-1].nmse[-1], rel=0.2)


def test_a_lens_of_other_functions_is_fitted_as_a_start() -> None:
    """A surface of 25 functions in the basis of 9 and 81: its form is what counts, within the basis's reach."""
    source = SrbfSurface(SrbfBasis((9, 25), 1.75), 0.02 * np.sin(np.arange(34.0)), 5.0)
    fitted = fit_surface(SrbfBasis((9, 81, 289), 1.75), source)
    u = hemisphere_directions(2000, 5)
    assert np.abs(fitted.radius(u) - source.radius(u)).max() < 2e-3
    assert np.abs(source.radius(u) - 5.0).max() > 3e-2


def test_a_search_has_the_same_bits_on_any_number_of_threads() -> None:
    """Of a lens whose tables torch multiplies and adds up."""
    spec = spot()
    hashes = set[str]()
    source = build_source(spec.source)

    def keep_second(step: Progress) -> bool:
        if step.steps_done == 2:
            hashes.add(step.lens().sha256)
        return step.steps_done < 2

    for threads in (1, 2):
        with threads_of_torch(threads), pytest.raises(Cancelled):
            search(spec, source, accuracy=FEW, progress=keep_second)
    assert len(hashes) == 1


def test_an_observer_that_has_enough_ends_the_search_and_its_checkpoint_goes_on_to_the_same_bits(
    tmp_path: Path,
) -> None:
    """Its pictures are those of the merit: the share of the flux on the pixels is the efficiency."""
    spec = small_spec()
    kept = tmp_path / "checkpoint.bin"
    shown = list[Progress]()

    def three_steps(step: Progress) -> object:
        shown.append(step)
        return ENOUGH if step.steps_done == 3 else None

    whole = design(spec, accuracy=FEW)
    result = design(spec, accuracy=FEW, checkpoint=kept, progress=three_steps)
    assert result.steps == len(shown) == 3
    assert result.ended is not None and result.ended.endswith("ended by its observer after 3 steps")
    assert [step.images[0].sum() for step in shown] == pytest.approx([step.efficiency for step in shown], rel=1e-12)
    grid, tables = shown[1].tables() if shown[1].tables is not None else (None, ())
    directions = hemisphere_directions(200, 7)
    for table, surface in zip(tables, shown[1].lens().surfaces.values(), strict=True):
        assert evaluate_table(grid, table, directions) == pytest.approx(surface.radius(directions), rel=2e-3)
    assert design(spec, accuracy=FEW, checkpoint=kept).lens.sha256 == whole.lens.sha256


def test_what_a_spec_leaves_open_is_that_of_the_preset_and_a_round_lens_needs_a_quarter_of_the_rays() -> None:
    """Of a pattern it needs twice the steps, as each is small; and as many rays of a file as another lens."""
    preset = PRESETS["draft"]
    left_open = {"optimise.rays": None, "optimise.steps_per_level": None}
    pattern, shares = (spot().replace({"optimise.aim": aim}) for aim in ("pattern", "share"))
    for spec, rays, more in ((small_spec(), 1, 1), (shares, 4, 1), (pattern, 4, 2)):
        stages = fixed_schedule(spec.replace(left_open), preset, last_only=False).stages
        assert {stage.rays for stage in stages} == {preset.design_rays // rays}
        of_file = fixed_schedule(spec.replace(left_open), preset, last_only=False, measured=True).stages
        assert {stage.rays for stage in of_file} == {preset.design_rays}
        *coarse, fine = (stage.steps for stage in stages)
        assert fine == more * preset.fine_steps and set(coarse) <= {preset.coarse_steps}
        given = fixed_schedule(spec.replace({**left_open, "optimise.rays": 3000}), preset, last_only=False).stages
        assert {stage.rays for stage in given} == {3000}
