"""Robust searches: the merit that they lower is the mean over parts, exact in its gradient; what they gain and keep."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from nightly import first_by_day
from presets import FEW, FEW_STEPS
from scenes import NO_TOLERANCES, small_spec, tolerance_changes
from search_scenes import LARGE, STATES, Step, require_same_bits_after

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.merit import SampledLight
from lensforge.search.optimiser import search
from lensforge.search.problem import Problem, Problems, ValidationRays
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec


def robust(**changes: Any) -> Spec:
    return small_spec(optimise__robust=True, **changes)


def problem_of(spec: Spec) -> Problem:
    return Problems(spec, build_source(spec.source, spec.lens.dispersion), 3.0, None).of((9, 25))


class RobustStep(Step):
    """A step of a robust search."""

    def __init__(self, tolerances: dict[str, float], **changes: Any) -> None:
        super().__init__({"optimise__robust": True, **tolerance_changes(tolerances), **changes})
        self.merit = self.problem.merit
        self.weights, self.offsets = self.parameters

    def designed(self) -> torch.Tensor:
        """The merit of the lens as designed."""
        return self.merit.step_loss(*self.parameters, self.rays, self.problem.constraints, True).loss


@pytest.mark.parametrize("changes", [{}, STATES, {**STATES, "optimise__over_sources": "worst"}])
def test_without_deviations_it_is_the_merit_of_the_lens_as_designed(changes: dict[str, Any]) -> None:
    none = {**NO_TOLERANCES, "source_shift_mm": 1e-10, "outer_form_um": 1e-7, "index": 1e-12}
    step = RobustStep(none, **changes)
    with torch.no_grad():
        assert step.loss().item() == pytest.approx(step.designed().item(), rel=1e-9)


def test_the_merit_of_a_pair_is_the_mean_over_its_parts() -> None:
    step = RobustStep(LARGE)
    ((part, mirrored),) = step.problem.parts.of_step(0, 3)
    losses = []
    for pair in ((part, mirrored), (part, part), (mirrored, mirrored)):
        step.pairs = (pair,)
        with torch.no_grad():
            losses.append(step.loss().item())
    assert losses[0] == pytest.approx(0.5 * (losses[1] + losses[2]), rel=1e-12)
    assert abs(losses[1] - losses[2]) > 1e-3 * losses[0]


@pytest.mark.parametrize("robustly", [True, 0.9])
def test_a_part_is_one_lens_in_all_its_states(robustly: bool | float) -> None:
    """Two states that are alike, to 1e-12 mm, have the merit of one by half of the rays, and its gradient."""
    zone = {"kind": "zone", "zone": {"kind": "disc", "diameter_mm": 120.0}, "at_least_share": 0.5}
    changes = {"limits": [zone], "optimise__robust": robustly}
    alone = RobustStep(LARGE, **changes)
    states = [{"name": "one", "weight": 2.0}, {"name": "other", "shift_mm": [0.0, 0.0, 1e-12]}]
    both = RobustStep(LARGE, states=states, **changes)
    alone.rays = build_source(alone.problem.spec.source).sample(512, 1)
    for value, wanted in zip(both.values(), alone.values(), strict=True):
        assert torch.allclose(value, wanted, rtol=1e-9, atol=1e-9 * float(wanted.abs().max()))
    loss = alone.loss().item()
    alone.pairs = ()
    assert abs(alone.loss().item() - loss) > 1e-3 * loss, "the parts count"


def test_an_led_is_off_by_the_same_in_every_state_about_its_own_place() -> None:
    """The light of a part whose LED is out of place is that of rays moved by hand through the lens as designed."""
    step = RobustStep(
        {**NO_TOLERANCES, "source_shift_mm": 0.1, "source_height_mm": 0.05, "source_tilt_deg": 5.0}, **STATES
    )
    tables = step.problem.parametrisation.tables(*step.parameters).detach()
    ((part, _),) = step.pairs
    off = part.made.source
    assert min(map(abs, (*off.origin_mm[:2], *off.axis[:2]))) > 1e-3
    members, leds = step.merit.members, step.problem.merit.source
    for member, rays in zip(members, leds.shared_out(step.rays), strict=True):
        place = np.array(member.spec.source.position_mm)
        moved = replace(
            rays, origins=place + off.points(rays.origins - place), directions=off.directions(rays.directions)
        )
        image, wanted = (
            member.light_of(tables, light, pairs).images[0] for light, pairs in ((rays, ((part, part),)), (moved, ()))
        )
        before = member.light_of(tables, rays).images[0]
        assert float((image - wanted).abs().max()) < 1e-9 * float((before - wanted).abs().max())


def test_slices_of_a_sample_join_to_its_light() -> None:
    step = RobustStep(LARGE)
    tables = step.problem.parametrisation.tables(*step.parameters).detach()
    whole = step.merit.light_of(tables, step.rays)
    parts = [step.merit.light_of(tables, part) for part in step.rays.divided(4)]
    joined = SampledLight.joined(parts, 2.0 * whole.emitted_w)
    assert torch.allclose(joined.images[0], 2.0 * whole.images[0], rtol=1e-9, atol=1e-12)
    assert joined.terms.item() == pytest.approx(2.0 * whole.terms.item())
    pair = step.merit.light_of(tables, step.rays, step.pairs)
    joined = SampledLight.joined([pair], 2.0 * pair.emitted_w)
    assert torch.equal(joined.pairs[0].images[0], 2.0 * pair.pairs[0].images[0])


def test_steps_draw_other_parts_and_the_same_again() -> None:
    parts, again = (problem_of(robust()).parts for _ in range(2))
    assert parts is not None and again is not None
    far = parts.of_step(1, 5000)[0][0].made  # of another block than the first
    made = [parts.of_step(1, number)[0][0].made for number in range(3)]
    assert len({str(part) for part in (*made, far)}) == 4
    assert [again.of_step(1, number)[0][0].made for number in range(3)] == made
    assert again.of_step(1, 5000)[0][0].made == far
    assert parts.of_step(2, 0)[0][0].made != made[0]
    assert parts.of_validation(1, 2)[0][0].made != made[0]
    ((drawn, mirrored),) = parts.of_step(1, 0)
    assert np.allclose(np.array(drawn.made.source.origin_mm), -np.array(mirrored.made.source.origin_mm))
    assert np.allclose(drawn.errors["outer"], -mirrored.errors["outer"]) and drawn.index == -mirrored.index
    assert drawn.made.slopes == mirrored.made.slopes


def test_fine_errors_scatter_as_roughness() -> None:
    plain, rough = (
        problem_of(robust(**tolerance_changes(NO_TOLERANCES | amounts))).parts
        for amounts in ({"outer_form_um": 1.0}, {"outer_waviness_um": 1.0})
    )
    assert plain is not None and rough is not None
    assert plain.of_step(0, 0)[0][0].made.slopes["outer"] == 0.0
    part = rough.of_step(0, 0)[0][0]
    assert "outer" not in part.errors and 1e-4 < part.made.slopes["outer"] < 1e-2


def test_a_spec_without_deviations_is_refused_in_one_line() -> None:
    spec = robust(**tolerance_changes(NO_TOLERANCES))
    with pytest.raises(InputError, match="tolerances: all of them are 0"):
        search(spec, build_source(spec.source), accuracy=FEW)


@pytest.mark.parametrize("levels", first_by_day(1, [[9, 25], "auto"], "three seconds"))
def test_an_interrupted_search_goes_on_to_the_same_bits(levels: Any, tmp_path: Path) -> None:
    given = {"optimise__steps_per_level": None, "optimise__rays": None} if levels == "auto" else {}
    spec = robust(lens__levels=levels, **tolerance_changes(LARGE), **given)
    path = tmp_path / "checkpoint.bin"
    source = build_source(spec.source)
    whole = search(spec, source, accuracy=FEW_STEPS, seed=3)
    require_same_bits_after(5, spec, source, path, whole, 3, FEW_STEPS)
    other = spec.replace({"tolerances.source_shift_mm": 0.1})
    with pytest.raises(InputError, match="belongs to another spec"):
        search(other, source, accuracy=FEW_STEPS, seed=3, checkpoint=path, resume=True)


@pytest.mark.nightly("two searches of seventy steps")
def test_a_robust_lens_is_better_on_average_over_other_parts() -> None:
    changes = {"optimise__steps_per_level": [30, 40], "optimise__rays": 4096, "optimise__pixels": 16}
    changes |= {"tolerances": {"source_shift_mm": 0.5, "lens_shift_mm": 0.3}}
    expected = []
    for robustly in (False, True):
        spec = small_spec(optimise__robust=robustly, **changes)
        lens = search(spec, build_source(spec.source), accuracy="draft").lens
        expected.append(expected_merit(lens))
    assert expected[1] < 0.98 * expected[0]


def expected_merit(lens: Lens) -> float:
    """Mean merit over parts and rays that no search has seen."""
    spec = lens.spec.replace(optimise={"robust": True})
    problem = problem_of(spec)
    validation, _ = ValidationRays.of(build_source(spec.source), 2**15, 77)
    judgement, _ = validation.judge(problem, *problem.parametrisation.parameters_of(lens), False)
    return judgement.merit
