"""Lenses designed with a frosted outer face against those designed polished and frosted afterwards.

    python benchmarks/frosted.py [flat_top pi cross] [--sigma 2 3 5] [--rays 2097152]

Standard designs; region of uniform light left out, so that the search lowers the NMSE alone. "floor": NMSE of the best
light, nowhere below 0, whose every direction is spread by a Gaussian of sigma: no lens reaches it, since facets spread
oblique light by more, and the LED adds its own image.
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.spec import Spec, load_spec

EXAMPLES = Path(__file__).parents[1] / "examples"
_PIXELS, _STEPS = 72, 150


def frosted(spec: Spec, sigma_deg: float) -> Spec:
    return spec.replace({"lens.outer.scatter": {"kind": "gaussian", "sigma_deg": sigma_deg}})


def floor(spec: Spec, sigma_deg: float) -> float:
    """By projected gradients (Beck and Teboulle, 2009) on a matrix of the spread between the pixels of a plane."""
    receiver, sigma = receivers_of(spec, _PIXELS)[0], np.radians(sigma_deg)
    wanted = target_light(spec.all_receivers[0].targets, receiver).ravel().astype(np.float32)
    side, distance = receiver.grid.width / _PIXELS, spec.target.distance_mm
    along = (np.arange(_PIXELS) - 0.5 * _PIXELS + 0.5) * side
    x, y = np.meshgrid(along, along)
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, distance)])
    away = np.linalg.norm(points, axis=1)
    ways = points / away[:, None]
    angles = np.arccos(np.clip(ways @ ways.T, -1.0, 1.0))
    solid = side**2 * distance / away**3
    spread = (np.exp(-0.5 * (angles / sigma) ** 2) / (2.0 * np.pi * sigma**2) * solid[:, None]).astype(np.float32)
    least, moved, last = wanted.copy(), wanted.copy(), 1.0
    for _ in range(_STEPS):
        found = np.maximum(moved - spread.T @ (spread @ moved - wanted), 0.0)
        new = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * last**2))
        moved, least, last = found + np.float32((last - 1.0) / new) * (found - least), found, new
    return float(np.sum((spread @ least - wanted) ** 2) / np.sum(wanted**2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=["flat_top", "pi", "cross"])
    parser.add_argument("--sigma", type=float, nargs="+", default=[2.0, 3.0, 5.0])
    parser.add_argument("--rays", type=int, default=2**21)
    options = parser.parse_args()
    for name in options.names:
        spec = load_spec(EXAMPLES / f"{name}.toml")
        if getattr(spec.target, "uniform_mm", None) is not None:
            spec = spec.replace({"target.uniform_mm": None})
        polished = lf.design(spec).lens
        light = lf.evaluate(polished, rays=options.rays)
        print(f"{name} polished: NMSE {light.nmse}, efficiency {light.efficiency}")
        for sigma in options.sigma:
            afterwards = lf.evaluate(replace(polished, spec=frosted(polished.spec, sigma)), rays=options.rays)
            within = lf.evaluate(lf.design(frosted(spec, sigma)).lens, rays=options.rays)
            print(f"{name} {sigma:g} deg: frosted afterwards {afterwards.nmse}, {afterwards.efficiency}; ", end="")
            print(f"designed frosted {within.nmse}, {within.efficiency}; floor {floor(spec, sigma):.4f}")


if __name__ == "__main__":
    main()
