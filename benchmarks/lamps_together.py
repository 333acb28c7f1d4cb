"""Lamps together: how even a backlight is, what a finite one loses at its rim, and what lamps cost in a search.

python benchmarks/lamps_together.py [--accuracy standard]       # ten minutes on one core
python benchmarks/lamps_together.py --thin                      # thin ones alone: five minutes
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
import statistics
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensforge.made.part_study import PartStudy, Recipe
from lensforge.search.problem import Problems
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.sources.build_source import build_source

EXAMPLES = Path(__file__).parents[1] / "examples"
BACKLIGHT = lf.load_spec(EXAMPLES / "backlight.toml")
THIN = lf.load_spec(EXAMPLES / "backlight_thin.toml")
HEAD = "pitch  min/max            min/mean           deviation          efficiency  of possible  search"
THIN_MM = {60.0: 0.98, 80.0: 0.95, 100.0: 0.90}  # pitch at a depth of 10 mm, and the min/max that is asked for
PITCHES_MM, RAYS, PIXELS = (20.0, 30.0, 40.0), 2**26, 64
LEVELS, STEP_RAYS = (25, 81, 289), 2**17


def square(side_mm: float, **lamps: object) -> dict[str, object]:
    """Changes of the backlight: other lamps, and a receiver of another side."""
    sizes = ("target.width_mm", "target.height_mm", "target.receiver_mm", "target.uniform_mm")
    return {"lamps": {"kind": "endless", **lamps}, **dict.fromkeys(sizes, side_mm)}


def evenness(accuracy: str) -> lf.Lens:
    """Search and evaluate the backlight at each pitch; the lens of the first."""
    print(HEAD)
    changes = ({**square(pitch_mm, pitch_mm=pitch_mm), "lens.levels": LEVELS} for pitch_mm in PITCHES_MM)
    lenses = [searched(BACKLIGHT.replace(change), accuracy) for change in changes]
    return lenses[0]


def thin(accuracy: str) -> None:
    """Search and evaluate the thin backlight at each pitch, for the evenness that is asked for there."""
    print(HEAD)
    for pitch_mm, bound in THIN_MM.items():
        limit = {"name": "evenness", "kind": "zone", "at_least_min_over_max": bound}
        searched(THIN.replace({**square(pitch_mm, pitch_mm=pitch_mm), "limits": [limit]}), accuracy)


def searched(spec: lf.Spec, accuracy: str) -> lf.Lens:
    """Search for ``spec``, print the row of its light, and return its lens."""
    begun = time.process_time()
    lens = lf.design(spec, accuracy=accuracy, force=True).lens
    seconds = time.process_time() - begun
    lit = lf.evaluate(lens, rays=RAYS, pixels=PIXELS).receivers[0]
    share = lit.efficiency.value
    print(
        f"{spec.lamps.pitch_mm:3.0f} mm {lit.in_region.u1!s:18s} {lit.in_region.u0!s:18s} {lit.rsd!s:20s} {share:8.4f} "
        f"{share / lit.possible.efficiency:10.4f} {seconds:10.0f} s of CPU",
        flush=True,
    )
    return lens


def rim(lens: lf.Lens, pitch_mm: float = 20.0, across: int = 6) -> None:
    """Light of a finite square of lamps above them, period by period, over that of a lattice without an end."""
    own = square(across * pitch_mm, kind="grid", columns=across, rows=across, pitch_mm=pitch_mm)
    lit = lf.evaluate(replace(lens, spec=lens.spec.replace({**own, "limits": ()})), rays=2**24, pixels=10 * across)
    endless = lf.evaluate(lens, rays=2**24, pixels=10).receivers[0].map.mean()
    cells = lit.receivers[0].map.reshape(across, 10, across, 10).mean(axis=(1, 3)) / endless
    print(f"{across} x {across} lamps, {lit.receivers[0].efficiency.value:.4f} of the light above them; by period:")
    print(np.array_str(cells[: across // 2, : across // 2], precision=3))


def kinds(pitch_mm: float = 20.0, across: int = 6) -> None:
    """Even light up to the rim of a finite square: by one lens for all lamps, and by lenses of three kinds by place."""
    side_mm = across * pitch_mm
    grid = {"kind": "grid", "columns": across, "rows": across, "pitch_mm": pitch_mm}
    spec = BACKLIGHT.replace({**square(side_mm), "lamps": grid, "limits": (), "lens.levels": LEVELS})
    for name in ("one", "place"):
        begun = time.process_time()
        lens = lf.design(spec.replace({"lamps.kinds": name}), accuracy="standard").lens
        seconds = time.process_time() - begun
        lit = lf.evaluate(lens, rays=2**24, pixels=10 * across).receivers[0]
        print(
            f"{name:5s} NMSE {lit.nmse!s}, efficiency {lit.efficiency!s} of {lit.possible.efficiency:.4f} possible, "
            f"min/max {lit.in_region.u1!s}, min/mean {lit.in_region.u0!s}, deviation {lit.rsd!s}, "
            f"{seconds:.0f} s of CPU",
            flush=True,
        )


def step(lamps: dict[str, object] | None, side_mm: float) -> tuple[float, ...]:
    """CPU seconds of gradient steps."""
    spec = BACKLIGHT.replace({**square(side_mm, pitch_mm=side_mm), "limits": ()})
    spec = spec.of_one_lamp if lamps is None else spec.of_one_lamp.replace({"lamps": lamps})
    source = build_source(spec.source, None)
    problem = Problems(settled_symmetry(spec.with_levels(LEVELS), source), source, 3.4, None).of(LEVELS)
    weights, offsets = (each.requires_grad_() for each in problem.parametrisation.start())
    rays = source.sample(STEP_RAYS, 0)
    times = []
    for _ in range(8):
        begun = time.process_time()
        problem.merit.step_loss(weights, offsets, rays, problem.constraints, False).loss.backward()
        times.append(time.process_time() - begun)
    return tuple(times[1:])


def costs() -> None:
    """Medians of a step with lamps over that of one lamp on the same receiver."""
    grid = {"kind": "grid", "columns": 6, "rows": 6}
    cases: dict[str, tuple[dict[str, object], float]] = {
        "6 x 6, six pitches wide": ({**grid, "pitch_mm": 20.0}, 120.0),
        "6 x 6, no common measure": ({**grid, "pitch_mm": 20.3}, 120.0),
        "6 x 6, three kinds of lens": ({**grid, "pitch_mm": 20.0, "kinds": "place"}, 120.0),
        "without an end": ({"kind": "endless", "pitch_mm": 20.0}, 20.0),
        "hexagon of 19": ({"kind": "hexagon", "rings": 2, "pitch_mm": 20.0}, 100.0),
        "ring of 12, each turned": ({"kind": "ring", "count": 12, "diameter_mm": 100.0}, 100.0),
    }
    for name, (lamps, side_mm) in cases.items():
        ratio = statistics.median(step(lamps, side_mm)) / statistics.median(step(None, side_mm))
        print(f"{name:26s} {ratio:5.2f} times a step of one", flush=True)


def apart() -> None:
    """CPU seconds of a part of a yield study, and the deviation over patches of a lattice of drawn lamps."""
    bins = {
        "tolerances": {"source_flux": {"amount": 0.05, "distribution": "uniform"}},
        "limits": (),
        "evaluate.pixels": 32,
    }
    lens = lf.design(BACKLIGHT.replace(bins), accuracy="draft").lens
    grid = {"kind": "grid", "columns": 6, "rows": 6, "pitch_mm": 20.0}
    for name, spec in (("one", lens.spec.of_one_lamp), ("6 x 6", lens.spec.replace({**square(60.0), "lamps": grid}))):
        for rays in (2**16, 2**18):
            study = PartStudy(Recipe(replace(lens, spec=spec), 40, rays, 0, 2**18))
            study.measure(0)
            begun = time.process_time()
            for number in range(1, 11):
                study.measure(number)
            print(f"{name:6s} {(time.process_time() - begun) / 10:6.3f} s of CPU a part of {rays} rays", flush=True)
    for periods in (1, 3, 4, 5):
        plate = {"thickness_mm": 2.0, "columns": periods, "rows": periods}
        study = PartStudy(Recipe(replace(lens, spec=lens.spec.replace({"plate": plate})), 24, 2**18, 0, 2**20))
        found = np.array([study.measure(number)[study.names.index("rsd"), 0] for number in range(24)])
        error = found.std(ddof=1) / len(found) ** 0.5
        print(f"{periods} x {periods} lamps: deviation {found.mean():.4f} ± {error:.4f}", flush=True)


def main() -> None:
    """Measure all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--accuracy", choices=("draft", "standard"), default="standard")
    parser.add_argument("--thin", action="store_true", help="the thin backlights alone")
    options = parser.parse_args()
    if options.thin:
        thin(options.accuracy)
        return
    costs()
    rim(evenness(options.accuracy))
    kinds()
    apart()


if __name__ == "__main__":
    main()
