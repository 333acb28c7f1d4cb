"""The flat top's gradient step by the compiled kernels and in torch, on the CPU and on a CUDA device if present.

    python benchmarks/device_step.py [--rays 524288] [--repeat 3]

Prints the median over the repeats of forward and gradient, and the agreement of loss and gradients with the kernels.
"""

import lensforge  # noqa: F401  before torch, whose idle threads then sleep

# isort: split
import argparse
from dataclasses import replace
from functools import partial

import torch
from gradient_step import Step, median_seconds

from lensforge.search.merit import MeritFunction


def gradients(step: Step, merit: MeritFunction) -> list[torch.Tensor]:
    """The loss, and its gradients by weights and offsets, on the CPU: the device has finished."""
    parameters = step.weights, step.offsets
    # in the uniformity stage light outweighs the constraints, so that the agreement is that of the light
    loss = merit.step_loss(*parameters, step.bundle, step.constraints, uniform=True).loss
    return [loss.detach(), *torch.autograd.grad(loss, parameters)]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rays", type=int, default=2**19)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    step = Step(options.rays)
    print(f"{options.rays} rays, {torch.get_num_threads()} threads, float64, torch {torch.__version__}")
    seconds = median_seconds(partial(gradients, step, step.merit), options.repeat)
    wanted = gradients(step, step.merit)
    print(f"{'kernels':24s} {1e3 * seconds:9.1f} ms")
    for name in ("cpu", *(["cuda"] if torch.cuda.is_available() else [])):
        light = replace(step.merit.light, device=torch.device(name))
        work = partial(gradients, step, replace(step.merit, light=light))
        seconds = median_seconds(work, options.repeat)
        errors = ((a - b).norm() / b.norm() for a, b in zip(work(), wanted, strict=True))
        label = torch.cuda.get_device_name() if name == "cuda" else "torch on the CPU"
        print(f"{label:24s} {1e3 * seconds:9.1f} ms  loss, gradients to {', '.join(f'{e:.0e}' for e in errors)}")


if __name__ == "__main__":
    main()
