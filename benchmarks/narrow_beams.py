"""Share of a chip's light in a narrow beam: the lens for a point source, and the one that the search makes of it.

python benchmarks/narrow_beams.py [--accuracy standard]        # two minutes for each lens

Both are traced with the same rays, which neither has seen, Fresnel losses counted.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import lensforge as lf
from lensforge.light.simulation import TracedLens
from lensforge.scene.body import Body
from lensforge.search.start_faces import start_faces
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS

EXAMPLES = Path(__file__).parents[1] / "examples"
CASES = (("spot", 5.0, 15.0), ("spot", 5.0, 11.0), ("spot_10", 10.0, 6.5), ("spot_10", 10.0, 4.7))
SCRAMBLES, RAYS, SEED = 8, 2**18, 9_000


def share(traced: TracedLens, spec: lf.Spec, half_angle_deg: float) -> tuple[float, float]:
    """Share of the flux within the half angle, and its standard error from independent scrambles of the rays."""
    found = []
    for number in range(SCRAMBLES):
        rays = build_source(spec.source, None).sample(RAYS, SEED + number)
        exits = traced.trace(rays)
        inside = exits.left_lens & (exits.directions[:, 2] > np.cos(np.radians(half_angle_deg)))
        found.append(exits.flux[inside].sum() / rays.flux.sum())
    return float(np.mean(found)), float(np.std(found, ddof=1) / SCRAMBLES**0.5)


def main() -> None:
    """Measure all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--accuracy", choices=("draft", "standard"), default="draft")
    options = parser.parse_args()
    nodes = PRESETS[options.accuracy].evaluate_nodes_per_sigma
    print("spec     half angle  radius   for a point   designed              height  search")
    for name, half_angle_deg, radius_mm in CASES:
        spec = lf.load_spec(EXAMPLES / f"{name}.toml").replace({"constraints.max_radius_mm": radius_mm})
        start = Body.of(start_faces(spec), spec.lens.body_roles)
        point = TracedLens.of_body(start, spec.lens.media, spec.lens.most_events, nodes)
        begun = time.perf_counter()
        design = lf.design(spec, accuracy=options.accuracy)
        seconds = time.perf_counter() - begun
        (before, _), (after, error) = (
            share(each, spec, half_angle_deg) for each in (point, TracedLens.of(design.lens, nodes))
        )
        print(
            f"{name:8s} {half_angle_deg:7.0f}°  {radius_mm:6.1f} mm  {before:10.4f}  {after:10.5f} ± {error:.5f} "
            f"{design.height_mm:7.2f} mm {seconds:5.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
