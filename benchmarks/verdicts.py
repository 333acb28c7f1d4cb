"""The verdict on the light of every shipped spec, and of lenses that are known to be useless: calibrates its bounds.

python benchmarks/verdicts.py --accuracy draft
python benchmarks/verdicts.py --accuracy standard pi flat_top_compact flat_top_milled "6 mm source in an 8 mm lens"

A row ends with the verdict that was expected where the verdict is another one. A shipped spec whose ray file comes from
a vendor and is not there is named and left out.
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lensforge.spec import Accuracy
from lensforge.verdict import verdict_on

EXAMPLES = Path(__file__).parents[1] / "examples"
COLUMNS = ("lens", "NMSE without noise", "share in the target", "efficiency", "light")


def useless() -> Iterator[tuple[str, lf.Spec]]:
    """Lenses that no customer would accept, each for another reason."""
    pi = lf.load_spec(EXAMPLES / "pi.toml")
    small_lens = {"cavity_radius_mm": 4.6, "max_radius_mm": 8.0}
    yield (
        "6 mm source in an 8 mm lens",
        pi.replace(
            source={"side_mm": 6.0},
            lens={"inner_offset_mm": 5.0, "outer_offset_mm": 7.7},
            constraints=small_lens,
        ),
    )
    yield "a word of three letters", pi.replace(target={"text": "LED"})
    least_mm = pi.constraints.cavity_radius_mm + pi.constraints.min_thickness_mm
    yield (
        "lens of 1.2 x the least size",
        pi.replace(
            lens={"inner_offset_mm": 1.8, "outer_offset_mm": 1.18 * least_mm},
            constraints={"max_radius_mm": 1.2 * least_mm},
        ),
    )
    yield (
        "3 mm COB onto 60 x 40 mm at 500 mm",
        pi.replace(
            source=lf.DiscSource(diameter_mm=3.0),
            lens={"inner_offset_mm": 5.0, "outer_offset_mm": 11.7},
            constraints={"cavity_radius_mm": 2.2, "max_radius_mm": 12.0},
            target=lf.ArrayTarget(np.ones((40, 60)), width_mm=60.0, distance_mm=500.0, receiver_mm=120.0),
        ),
    )


def cases() -> Iterator[tuple[str, lf.Spec, str]]:
    """Name, spec and expected verdict on the light."""
    for path in sorted(EXAMPLES.glob("*.toml")):
        yield path.stem, lf.load_spec(path), "pass"
    for name, spec in useless():
        yield name, spec, "fail"


def row(name: str, spec: lf.Spec, expected: str, accuracy: Accuracy) -> tuple[str, ...]:
    """The figures on which the verdict rests, and the verdict."""
    design = lf.design(spec, accuracy=accuracy, anyway=True)
    light = lf.evaluate(design.lens)
    verdict = verdict_on(design.lens, design, light, None, None, None).light
    figures = (light.nmse.value, light.share_in_target.value, light.efficiency.value)
    shown = verdict if verdict == expected else f"**{verdict}**, not {expected}"
    return name, *(f"{figure:.3f}" for figure in figures), shown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="shipped specs or useless lenses; default: all")
    parser.add_argument("--accuracy", choices=("draft", "standard", "reference"), default="draft")
    options = parser.parse_args()
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    for name, spec, expected in cases():
        if options.names and name not in options.names:
            continue
        try:
            print("| " + " | ".join(row(name, spec, expected, options.accuracy)) + " |", flush=True)
        except lf.InputError as error:
            print(f"{name}: left out: {error}", flush=True)


if __name__ == "__main__":
    main()
