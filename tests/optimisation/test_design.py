from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.accuracy import PRESETS
from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.checkpoint import FILE_NAME
from lensforge.optimisation.objective import Objective
from lensforge.optimisation.optimiser import Progress, design
from lensforge.optimisation.parameters import Parametrisation
from lensforge.optimisation.schedule import plan
from lensforge.errors import InputError
from lensforge.sources.build import build_source


def test_the_objective_s_gradient_is_its_derivative() -> None:
    """Through constraints, pulls, image and tracer, for weights and offsets of both surfaces."""
    spec = small_spec()
    source = build_source(spec.source)
    parametrisation = Parametrisation.of(spec, 4.0)
    objective = Objective.of(spec, source, parametrisation)
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    rng = np.random.default_rng(0)
    weights = torch.from_numpy(rng.normal(size=(34, 2)) * 0.01).requires_grad_()
    offsets = torch.tensor([1.0, 1.2], dtype=torch.float64, requires_grad=True)  # g3 is violated: the term is active
    rays = source.sample(2048, 1)

    def loss(w: torch.Tensor, h: torch.Tensor) -> torch.Tensor:
        return objective.evaluate(w, h, rays, constraints, uniform=True).loss

    by_weights, by_offsets = torch.autograd.grad(loss(weights, offsets), (weights, offsets))
    dw, dh = torch.from_numpy(rng.normal(size=(34, 2))), torch.from_numpy(rng.normal(size=2))
    step = 1e-8
    with torch.no_grad():
        along_w = (loss(weights + step * dw, offsets) - loss(weights - step * dw, offsets)) / (2 * step)
        along_h = (loss(weights, offsets + step * dh) - loss(weights, offsets - step * dh)) / (2 * step)
    assert along_w.item() == pytest.approx((by_weights * dw).sum().item(), rel=1e-4)
    assert along_h.item() == pytest.approx((by_offsets * dh).sum().item(), rel=1e-4)


def test_a_design_gets_better_and_keeps_its_history() -> None:
    spec = small_spec(optimise__steps_per_level=[25, 25], optimise__rays=4096)
    result = design(spec, build_source(spec.source), accuracy="draft")
    nmse = [value for stage in result.history for value in stage["nmse"]]
    assert len(nmse) == 50
    assert np.mean(nmse[-5:]) < 0.65 * np.mean(nmse[:5])
    assert result.to_json()["forward_evaluations"] == 50
    assert all(len(stage[name]) == 25 for stage in result.history for name in (*result.constraints, "efficiency"))
    last = {name: result.history[-1][name][-1] for name in result.constraints}
    assert last == pytest.approx(result.constraints, abs=0.03), "one small step before the end"


def test_an_interrupted_design_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    spec = small_spec()
    source = build_source(spec.source)
    whole = design(spec, source, accuracy="draft", seed=3)

    class Stop(KeyboardInterrupt):
        pass

    for stop_at in (2, 4, 7):  # within a level, at its end, within the last
        path = tmp_path / f"{stop_at}" / FILE_NAME

        def interrupt(progress: Progress, stop_at: int = stop_at) -> None:
            if progress.steps_done == stop_at:
                raise Stop

        with pytest.raises(Stop):
            design(spec, source, accuracy="draft", seed=3, checkpoint=path, observer=interrupt)
        resumed = design(spec, source, accuracy="draft", seed=3, checkpoint=path, resume=True)
        assert np.array_equal(resumed.lens.inner.weights, whole.lens.inner.weights)
        assert np.array_equal(resumed.lens.outer.weights, whole.lens.outer.weights)
        assert resumed.lens.outer.offset_mm == whole.lens.outer.offset_mm
        assert [stage["nmse"] for stage in resumed.history] == [stage["nmse"] for stage in whole.history]


def test_a_checkpoint_of_another_design_is_refused(tmp_path: Path) -> None:
    spec = small_spec()
    source = build_source(spec.source)
    path = tmp_path / FILE_NAME
    design(spec, source, accuracy="draft", checkpoint=path)
    with pytest.raises(InputError, match="belongs to another spec"):
        design(spec, source, accuracy="draft", seed=1, checkpoint=path, resume=True)
    path.write_bytes(b"not a checkpoint")
    with pytest.raises(InputError, match="damaged checkpoint"):
        design(spec, source, accuracy="draft", checkpoint=path, resume=True)
    path.unlink()
    with pytest.raises(InputError, match="no checkpoint"):
        design(spec, source, accuracy="draft", checkpoint=path, resume=True)


def test_the_plan_is_coarse_to_fine_and_the_spec_outranks_the_preset() -> None:
    stages = plan(small_spec(optimise__uniformity_steps=3), PRESETS["draft"])
    assert [stage.functions for stage in stages] == [9, 34]
    assert [stage.steps for stage in stages] == [4, 4]
    assert stages[0].learning_rate > stages[1].learning_rate > stages[1].rate(3)
    assert stages[1].uniformity_from == 1
    assert stages[0].rays == 1024
    assert plan(small_spec(), PRESETS["draft"], rays=77)[0].rays == 77


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lens__symmetry": "square", "target": {"kind": "text", "text": "L", "width_mm": 50.0, "distance_mm": 100.0,
          "receiver_mm": 200.0}}, "the target is not symmetric"),
    ],
)  # fmt: skip
def test_a_symmetry_that_the_scene_has_not_is_refused(changes: dict, message: str) -> None:
    spec = small_spec(**changes)
    with pytest.raises(InputError, match=message):
        design(spec, build_source(spec.source), accuracy="draft")


def test_any_number_of_threads_gives_the_same_lens() -> None:
    spec = small_spec(optimise__steps_per_level=[2, 2])
    threads = torch.get_num_threads()
    lenses = []
    for count in (1, 2):
        torch.set_num_threads(count)
        lenses.append(design(spec, build_source(spec.source), accuracy="draft").lens)
    torch.set_num_threads(threads)
    assert np.allclose(lenses[0].outer.weights, lenses[1].outer.weights, rtol=1e-9, atol=1e-12)
