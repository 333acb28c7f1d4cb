"""Gradient of a search beside walls that reflect, against differences of the merit by the same rays.

    python benchmarks/wall_slopes.py    # 131,072 rays, eight random changes of the lens of ``bezel``: a minute

For each body, and for the same in black: how far slopes are off, RMS over RMS.
"""

import argparse
from collections.abc import Mapping

import numpy as np
import torch
from gradient_step import BEZEL, Step

from lensforge.spec import load_spec

RING = {"kind": "cylinder", "name": "wall", "bore_radius_mm": 30.0, "radius_mm": 32.0, "length_mm": 30.0,
        "centre_mm": [0.0, 0.0, 60.0]}  # fmt: skip
WALL = {"kind": "box", "name": "wall", "size_mm": [2.0, 60.0, 60.0], "centre_mm": [30.0, 0.0, 60.0]}
BODIES = {"ring": RING, "flat wall": WALL}
FINISHES: tuple[Mapping[str, object], ...] = (
    {},
    {"surface": "mirror", "reflectance": 0.8},
    {"surface": "diffuse", "reflectance": 0.8},
)
CHANGE = 2e-4  # of the weights, relative: each way


def off(step: Step, directions: int) -> float:
    """Slopes along random ``directions`` against differences, RMS over RMS."""
    step.gradient()
    assert step.weights.grad is not None
    random = np.random.default_rng(1)
    slopes = []
    differences = []
    for _ in range(directions):
        along = torch.from_numpy(random.normal(size=tuple(step.weights.shape)))
        slopes.append(float((step.weights.grad * along).sum()))
        differences.append(difference(step, along))
    apart = np.array(slopes) - np.array(differences)
    return float(np.sqrt(np.mean(apart**2) / np.mean(np.square(differences))))


def difference(step: Step, along: torch.Tensor) -> float:
    """Slope of the merit by two evaluations."""
    start = step.weights.detach().clone()
    merits = []
    with torch.no_grad():
        for sign in (1.0, -1.0):
            step.weights.copy_(start + sign * CHANGE * along)
            merits.append(float(step.evaluate()))
        step.weights.copy_(start)
    return (merits[0] - merits[1]) / (2.0 * CHANGE)


def main() -> None:
    """Print a row for each body and finish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=2**17)
    parser.add_argument("--directions", type=int, default=8)
    options = parser.parse_args()
    spec = load_spec(BEZEL).replace({"lens.symmetry": "none"})
    for name, body in BODIES.items():
        for finish in FINISHES:
            step = Step(options.rays, spec=spec.replace(scene=[{**body, **finish}]))
            print(
                f"{name:10s} {finish.get('surface', 'black'):8s} {100.0 * off(step, options.directions):6.2f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
