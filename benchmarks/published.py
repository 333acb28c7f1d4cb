"""Designs of published papers beside what the papers state: designs them, prints the tables of docs/published.md.

python benchmarks/published.py                   # all of examples/published, into cad_out/published; half an hour
python benchmarks/published.py circle            # one of them
python benchmarks/published.py --table           # the tables alone, from the finished result folders

Figures of the light are those of evaluate.json. RSD and least over mean (U0) are wanted in two regions, and a spec
names one at most: the whole pattern, with the pixels on its edge, and the pattern less a margin all round. They are
taken here from the rays of evaluate.json, on the same pixels by the same filter, without ray noise; beside them those
of the spec's own pattern under that filter, which is what the soft edge and the filter alone cost.
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from results import shown

from lensforge.accuracy import PRESETS
from lensforge.evaluation.metrics import relative_deviation, uniformity
from lensforge.evaluation.minimum import uniformity_without_noise
from lensforge.evaluation.noise_free import rsd_without_noise
from lensforge.evaluation.replicate_metrics import filtered, mean_share
from lensforge.evaluation.simulate import TracedLens, simulate
from lensforge.receivers.build import receivers_of
from lensforge.receivers.pixels import gaussian3
from lensforge.sources.build import build_source
from lensforge.spec.shapes import DiscTarget, RectangleTarget
from lensforge.targets.pattern import target_light

ROOT = Path(__file__).parents[1]
SPECS, FOLDERS = ROOT / "examples" / "published", ROOT / "cad_out" / "published"
SECONDS = "command_seconds.json"  # beside the result folders: the time of each whole command


@dataclass(frozen=True)
class Published:
    """A design of a paper: where it stands, what it states, and the margin of the region without its edge."""

    paper: str
    states: str
    margin_mm: float = 0.0


CASES = {
    "rectangle_2mm": Published("Opt. Express 29, 13469", "10 mm high; 2,000 evaluations", 12.0),
    "rectangle_3mm": Published("Opt. Express 29, 13469", "10 mm high; 2,000 evaluations", 12.0),
    "compact_rectangle": Published("Opt. Express 24, A1489", "efficiency > 0.82, RSD < 0.2", 60.0),
    "compact_one_axis": Published("Opt. Express 24, A1489", "efficiency > 0.82, RSD < 0.2", 60.0),
    "circle": Published("J. Zhejiang Univ. Sci. C 13, 929", "RSD 0.0122; efficiency to 0.9388", 50.0),
    "street": Published("Opt. Express 19, A225", "efficiency > 0.83, nonuniformity < 9 %", 200.0),
    "two_numerals": Published("Photonics Research 9, 1775", "a collimated beam; in pictures alone"),
}
LIGHT = (
    "design",
    "published",
    "efficiency",
    "on the plane",
    "possible",
    "NMSE",
    "least",
    "search",
    "command",
    "r_max / height (mm)",
)
REGIONS = ("design", "region", "light in it", "RSD", "RSD of the pattern", "U0", "U0 of the pattern")


def design(name: str) -> None:
    """The whole command for one spec; its time goes beside the result folders."""
    folder, started = FOLDERS / name, time.perf_counter()
    command = ("-m", "lensforge", "design", SPECS / f"{name}.toml", "--out", folder)
    done = subprocess.run([sys.executable, *map(str, command)], cwd=ROOT, check=False)
    if done.returncode not in (0, 1):  # 1: a verdict, and all files are written
        raise SystemExit(done.returncode)
    file = FOLDERS / SECONDS
    seconds = json.loads(file.read_text()) if file.exists() else {}
    file.write_text(json.dumps({**seconds, name: time.perf_counter() - started}, indent=1))


def light_rows(name: str) -> Iterator[tuple[str, ...]]:
    """Figures of a finished folder, one row for each receiver."""
    run, published = lf.load(FOLDERS / name), CASES[name]
    seconds = json.loads((FOLDERS / SECONDS).read_text())[name]
    for light in run.light.receivers:
        many = len(run.light.receivers) > 1
        yield (
            f"{name}, {light.place}" if many else name,
            f"{published.paper}: {published.states}",
            f"{shown(light.efficiency, 4)} {light.where}",
            f"{light.flux.detected + light.flux.outside:.4f}",
            f"{light.possible.efficiency:.3f}",
            shown(light.nmse, 5),
            f"{light.possible.nmse:.4f}",
            f"{run.design.seconds:.0f} s",
            f"{seconds:.0f} s",
            f"{run.design.max_radius_mm:.2f} / {run.design.height_mm:.2f}",
        )


def region_rows(name: str) -> Iterator[tuple[str, ...]]:
    """Share of the light, RSD and least over mean in the pattern, with and without its edge."""
    run, margin = lf.load(FOLDERS / name), CASES[name].margin_mm
    spec, light = run.lens.spec, run.light
    target = spec.all_receivers[0].targets[0]
    if not isinstance(target, RectangleTarget | DiscTarget):
        return
    (receiver,) = receivers_of(spec, light.pixels)
    traced = TracedLens.of(run.lens, PRESETS[run.lens.accuracy].evaluate_nodes_per_sigma)
    simulation = simulate(traced, build_source(spec.source), (receiver,), light.rays, light.seed)
    (received,) = simulation.received
    images = filtered(received, spec.evaluate.filter_variance)
    wanted, grid = gaussian3(target_light((target,), receiver), spec.evaluate.filter_variance), receiver.grid
    x, y = target.about_centre(*receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y())))
    for less in (0.0, margin):
        if isinstance(target, DiscTarget):
            diameter = target.size("diameter") - 2.0 * less
            mask, words = np.hypot(x, y) <= diameter / 2.0, f"disc of {diameter:g} mm"
        else:
            width, height = (side - 2.0 * less for side in (light.first.window.width, light.first.window.height))
            mask = (np.abs(x) <= width / 2.0) & (np.abs(y) <= height / 2.0)
            words = f"{width:g} × {height:g} mm"
        yield (
            name,
            words + (f", {less:g} mm less all round" if less else ", with its edge"),
            shown(mean_share(received.images[:, mask].sum(axis=1) / simulation.emitted_w), 4),
            shown(rsd_without_noise(images, mask), 4),
            f"{relative_deviation(wanted, mask):.4f}",
            shown(uniformity_without_noise(images, mask), 3),
            f"{uniformity(wanted, mask):.3f}",
        )


def table(columns: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    """Print a Markdown table."""
    print("| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*CASES, []], help="of examples/published; all by default")
    parser.add_argument("--table", action="store_true", help="print the tables of finished folders alone")
    given = parser.parse_args()
    names = given.names or list(CASES)
    if not given.table:
        for name in names:
            design(name)
    table(LIGHT, (row for name in names for row in light_rows(name)))
    print()
    table(REGIONS, (row for name in names for row in region_rows(name)))


if __name__ == "__main__":
    main()
