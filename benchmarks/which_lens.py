"""Which lens for which beam: both kinds of lens for half angles from 3 to 60 degrees, with the same chip and radius.

python benchmarks/which_lens.py [--accuracy draft] [--radius 15]        # one to three minutes for each lens

Each is searched for the largest share of the light within the beam. Rays that the search has not used judge it.
"""

import argparse
import time

import lensforge as lf
from lensforge.errors import LensforgeError

HALF_ANGLES_DEG = (3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0)
KINDS = ("double", "tir")


def beam(kind: str, half_angle_deg: float, radius_mm: float) -> lf.Spec:
    """A lens of a kind for a 1 mm chip and as much light as possible within a cone."""
    return lf.Spec.model_validate(
        {
            "name": kind,
            "source": {"kind": "square", "side_mm": 1.0},
            "lens": {"kind": kind, "refractive_index": 1.4936},
            "constraints": {"max_radius_mm": radius_mm},
            "target": {
                "kind": "disc",
                "diameter_deg": 2.0 * half_angle_deg,
                "half_angle_deg": min(max(2.0 * half_angle_deg, 15.0), 80.0),
            },
            "optimise": {"aim": "share"},
        }
    )


def main() -> None:
    """A row of the table for each beam and kind of lens."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--accuracy", choices=("draft", "standard"), default="draft")
    parser.add_argument("--radius", type=float, default=15.0)
    options = parser.parse_args()
    print("| half angle | lens | within the beam | possible | height (mm) | search |\n|---|---|---|---|---|---|")
    for half_angle_deg in HALF_ANGLES_DEG:
        for kind in KINDS:
            begun = time.perf_counter()
            try:
                design = lf.design(beam(kind, half_angle_deg, options.radius), accuracy=options.accuracy)
                seconds = time.perf_counter() - begun
                light = lf.evaluate(design.lens, accuracy=options.accuracy).receivers[0]
            except LensforgeError as error:
                print(f"| {half_angle_deg:g}° | {kind} | {error} | | | |", flush=True)
                continue
            print(
                f"| {half_angle_deg:g}° | {kind} | {light.share_in_target.value:.4f} "
                f"± {light.share_in_target.standard_error:.0e} | {light.possible.share_in_target:.3f} "
                f"| {design.height_mm:.1f} | {seconds:.0f} s |",
                flush=True,
            )


if __name__ == "__main__":
    main()
