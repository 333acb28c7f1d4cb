"""Steps of a search: their rates, and our Adam against torch's, to the last bit."""

import subprocess
import sys

import pytest
import torch
from scenes import small_spec

import lensforge as lf
from lensforge.search.optimiser import _shorten
from lensforge.search.problem import Problems
from lensforge.search.schedule import Stage
from lensforge.search.search_state import Adam, Parameters
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import preset_of


@pytest.mark.parametrize("steps", [40, 100])
def test_the_rate_falls_by_half_a_cosine_to_a_twentieth(steps: int) -> None:
    stage = Stage(0, (9,), 9, steps, 64, 0.2, uniform=False)
    rates = [stage.rate(quarter * steps // 4) for quarter in range(5)]
    shares = [1.0, 0.05 + 0.95 * (0.5 + 8.0**-0.5), 0.525, 0.05 + 0.95 * (0.5 - 8.0**-0.5), 0.05]
    assert rates == pytest.approx([0.2 * share for share in shares], rel=1e-12)


BETAS = (0.9, 0.99)
EPS = 1e-7
ADAM_STEPS = 40


def _start() -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(3)
    return [torch.randn(size, dtype=torch.float64, generator=generator).requires_grad_() for size in ((50, 2), (2,))]


def _loss(parameters: list[torch.Tensor], step: int) -> torch.Tensor:
    weights, offsets = parameters
    return ((weights - 0.1 * step) ** 4).sum() + torch.sin(3.0 * weights[:2] * offsets).sum()


def _rate(step: int) -> float:
    return 0.01 * (1.0 - step / ADAM_STEPS)


def test_the_steps_are_those_of_torch_to_the_last_bit() -> None:
    ours = _start()
    theirs = _start()
    optimiser = Adam(*ours, BETAS, EPS)
    reference = torch.optim.Adam(theirs, betas=BETAS, eps=EPS)
    for step in range(ADAM_STEPS):
        for group in reference.param_groups:
            group["lr"] = _rate(step)
        for parameters, adam in ((ours, optimiser), (theirs, reference)):
            adam.zero_grad()
            _loss(parameters, step).backward()
        optimiser.step(_rate(step))
        reference.step()
        assert all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))


@pytest.mark.nightly("a process that loads torch")
def test_a_step_does_not_load_the_compiler_of_torch() -> None:
    code = (
        "import sys, torch; from lensforge.search.search_state import Adam; "
        "x, y = (torch.ones(3, requires_grad=True) for _ in range(2)); own = Adam(x, y, (0.9, 0.99), 1e-7); "
        "own.zero_grad(); (x + y).sum().backward(); own.step(0.1); print(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    loaded = set(run.stdout.split())
    assert "lensforge.search.search_state" in loaded
    assert not loaded & {"torch._dynamo", "sympy"}


def test_a_resumed_adam_takes_the_same_steps() -> None:
    one = _start()
    whole = Adam(*one, BETAS, EPS)
    _take(3, one, whole)
    two = [tensor.detach().clone().requires_grad_() for tensor in one]
    resumed = Adam(*two, BETAS, EPS, 3, whole.moments)
    _take(4, one, whole)
    _take(4, two, resumed)
    pairs = (*zip(one, two, strict=True), *zip(whole.moments, resumed.moments, strict=True))
    assert all(torch.equal(left, right) for left, right in pairs)


def _take(count: int, parameters: list[torch.Tensor], optimiser: Adam) -> None:
    for _ in range(count):
        optimiser.zero_grad()
        _loss(parameters, 1).backward()
        optimiser.step(0.1)


@pytest.mark.parametrize(("face", "times", "left"), [(1, 0.9, 0.9), (0, 1.9, 0.95), (0, 2.1, 0.525), (1, 1e6, 0.0)])
def test_a_step_to_a_face_without_a_radius_is_halved_or_taken_back(face: int, times: float, left: float) -> None:
    spec = small_spec()
    problem = Problems(spec, build_source(spec.source), 2.5, None).of((9,))
    start = Parameters(*problem.parametrisation.start())  # two spheres, whose radii are in proportion to their offsets
    moved = Parameters(start.weights.clone(), start.offsets.clone())
    moved.offsets[face] -= times * start.offsets[face]
    _shorten(problem, start, moved, start.weights[9:])
    assert problem.can_be_traced(*moved)
    assert (1.0 - moved.offsets / start.offsets)[[face, 1 - face]].tolist() == pytest.approx([left, 0.0], abs=1e-12)


@pytest.mark.parametrize("rate", [0.3, 0.5, 1.0])
def test_a_search_by_any_rate_ends_with_a_lens(rate: float) -> None:
    far = preset_of("draft").replace("far", effort={"learning_rate": rate})
    even = {"kind": "zone", "zone": {"kind": "disc", "diameter_mm": 20.0}, "at_least_min_over_mean": 0.7}
    ended = lf.design(small_spec(optimise__steps_per_level=[8, 1], limits=[even]), accuracy=far)
    assert ended.kept_start and ended.steps == 9, "its first steps lead to faces without a radius"
