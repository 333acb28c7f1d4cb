"""Our Adam against torch's, to the last bit, and without what torch's loads."""

import subprocess
import sys

import pytest
import torch

from lensforge.search.search_state import Adam

BETAS, EPS = (0.9, 0.99), 1e-7
STEPS = 40


def _start() -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(3)
    return [torch.randn(size, dtype=torch.float64, generator=generator).requires_grad_() for size in ((50, 2), (2,))]


def _loss(parameters: list[torch.Tensor], step: int) -> torch.Tensor:
    weights, offsets = parameters
    return ((weights - 0.1 * step) ** 4).sum() + torch.sin(3.0 * weights[:2] * offsets).sum()


def _rate(step: int) -> float:
    return 0.01 * (1.0 - step / STEPS)


def test_the_steps_are_those_of_torch_to_the_last_bit() -> None:
    ours, theirs = _start(), _start()
    optimiser, reference = Adam(ours, BETAS, EPS), torch.optim.Adam(theirs, betas=BETAS, eps=EPS)
    for step in range(STEPS):
        for group in reference.param_groups:
            group["lr"] = _rate(step)
        for parameters, own in ((ours, optimiser), (theirs, reference)):
            own.zero_grad()
            _loss(parameters, step).backward()
        optimiser.step(_rate(step))
        reference.step()
        assert all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))


@pytest.fixture(scope="module")
def loaded_by_a_step() -> set[str]:
    """Modules that are there after a step in a process of its own."""
    code = (
        "import sys, torch; from lensforge.search.search_state import Adam; "
        "x = torch.ones(3, requires_grad=True); own = Adam([x], (0.9, 0.99), 1e-7); "
        "own.zero_grad(); x.sum().backward(); own.step(0.1); print(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    return set(run.stdout.split())


@pytest.mark.parametrize("unwanted", ["torch._dynamo", "sympy"])
def test_a_step_does_not_load_the_compiler_of_torch(loaded_by_a_step: set[str], unwanted: str) -> None:
    assert "lensforge.search.search_state" in loaded_by_a_step
    assert unwanted not in loaded_by_a_step
