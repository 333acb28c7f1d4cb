"""Designs of published papers beside what the papers state: designs them, prints their tables.

python benchmarks/published.py                   # all of examples/published, into cad_out/published; half an hour
python benchmarks/published.py circle            # one of them
python benchmarks/published.py --light           # design and evaluation alone: without files and referees
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
from functools import cache
from pathlib import Path

import numpy as np
from results import shown

from lensforge.light.receiver_light import WindowSize
from lensforge.light.simulation import TracedLens, simulate
from lensforge.report.folder import RunFolder
from lensforge.results.estimates import (
    jackknife_metric,
    least_over_mean,
    nmse,
    nmse_estimate,
    relative_deviation,
    rsd_estimate,
    uniformity,
)
from lensforge.scene.pixel_grid import gaussian3
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS
from lensforge.spec.shape_targets import DiscTarget, RectangleTarget
from lensforge.verbs import EVALUATE

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
    "rectangle_2mm": Published("Opt. Express 29, 13469", "10 mm high; no figures in the abstract", 12.0),
    "rectangle_3mm": Published("Opt. Express 29, 13469", "10 mm high; no figures in the abstract", 12.0),
    "compact_rectangle": Published("Opt. Express 24, A1489", "efficiency > 0.82, RSD < 0.2", 60.0),
    "compact_one_axis": Published("Opt. Express 24, A1489", "efficiency > 0.82, RSD < 0.2", 60.0),
    "circle": Published("J. Zhejiang Univ. Sci. C 13, 929", "RSD 0.0122; efficiency to 0.9388", 50.0),
    "street": Published("Opt. Express 19, A225", "efficiency > 0.83, nonuniformity < 9 %", 200.0),
    "two_numerals": Published("Photonics Research 9, 1775", "a collimated beam; no figures in the abstract"),
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
REGIONS = (
    "design",
    "region",
    "light in it",
    "RSD",
    "RSD of the pattern",
    "U0",
    "U0 of the pattern",
    "NMSE to hard edges",
    "of such a pattern",
)
# Of version 0.1.0, with drawn pictures as targets: NMSE, efficiency, RSD less a margin and with the edge, s of search.
EARLIER = {
    "rectangle_2mm": ("0.0009", "0.913", "0.014", "0.087", "37 s"),
    "rectangle_3mm": ("0.0037", "0.908", "0.036", "0.107", "24 s"),
    "compact_rectangle": ("0.0138", "0.876", "0.073", "0.185", "80 s"),
}
PROGRESS = ("design", "version", "NMSE", "on the receiver", "RSD", "with its edge", "search")


def design(name: str) -> None:
    """The whole command for one spec; its time goes beside the result folders."""
    folder, started = FOLDERS / name, time.perf_counter()
    command = ("-m", "lensforge", "design", SPECS / f"{name}.toml", "--out", folder)
    done = subprocess.run([sys.executable, *map(str, command)], cwd=ROOT, check=False, stdout=sys.stderr)
    if done.returncode not in (0, 1):  # 1: a verdict, and all files are written
        raise SystemExit(done.returncode)
    file = FOLDERS / SECONDS
    seconds = json.loads(file.read_text()) if file.exists() else {}
    file.write_text(json.dumps({**seconds, name: time.perf_counter() - started}, indent=1))


def design_light(name: str) -> None:
    """The search and the evaluation for one spec; the time of the whole command is then unknown."""
    folder = FOLDERS / name
    folder.mkdir(parents=True, exist_ok=True)
    RunFolder(folder).write(lf.design(lf.load_spec(SPECS / f"{name}.toml")))
    EVALUATE.run(folder)
    file = FOLDERS / SECONDS
    seconds = json.loads(file.read_text()) if file.exists() else {}
    file.write_text(json.dumps({each: value for each, value in seconds.items() if each != name}, indent=1))


def light_rows(name: str) -> Iterator[tuple[str, ...]]:
    """Figures of a finished folder, one row for each receiver."""
    run, published = lf.load(FOLDERS / name), CASES[name]
    file = FOLDERS / SECONDS
    seconds = json.loads(file.read_text()).get(name) if file.exists() else None
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
            "–" if seconds is None else f"{seconds:.0f} s",
            f"{run.design.max_radius_mm:.2f} / {run.design.height_mm:.2f}",
        )


@cache
def region_rows(name: str) -> tuple[tuple[str, ...], ...]:
    """Share of the light, RSD and least over mean in the pattern with its edge, then without; none of a picture."""
    run, margin = lf.load(FOLDERS / name), CASES[name].margin_mm
    spec, light = run.lens.spec, run.light
    target = spec.all_receivers[0].targets[0]
    if not isinstance(target, RectangleTarget | DiscTarget):
        return ()
    (receiver,) = receivers_of(spec, light.pixels)
    traced = TracedLens.of(run.lens, PRESETS[run.lens.accuracy].evaluate_nodes_per_sigma)
    simulation = simulate(traced, build_source(spec.source), (receiver,), light.rays, light.seed)
    (received,) = simulation.received
    images = gaussian3(received.images, spec.evaluate.filter_variance)
    x, y = receiver.target_coordinates(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    # the paper's pattern: the window of a rectangle, whose soft edge may have its middle farther in
    hard = target.model_copy(update={"edge_mm": None, **_sides(target, light.first.window)})
    wanted, paper = (target_light((each,), receiver) for each in (target, hard))
    smooth, cut = (gaussian3(each, spec.evaluate.filter_variance) for each in (wanted, paper))
    rows = []
    for less in (0.0, margin):
        if isinstance(hard, DiscTarget):
            diameter = hard.size("diameter") - 2.0 * less
            mask, words = np.hypot(x, y) <= diameter / 2.0, f"disc of {diameter:g} mm"
        else:
            width, height = (hard.size(side) - 2.0 * less for side in ("width", "height"))
            mask = (np.abs(x) <= width / 2.0) & (np.abs(y) <= height / 2.0)
            words = f"{width:g} × {height:g} mm"
        rows.append(
            (
                name,
                words + (f", {less:g} mm less all round" if less else ", with its edge"),
                shown(jackknife_metric(received.images[:, mask].sum(axis=1) / simulation.emitted_w, float), 4),
                shown(rsd_estimate(images, mask).metric(), 4),
                f"{relative_deviation(smooth, mask):.4f}",
                shown(least_over_mean(images[:, mask]).metric(), 3),
                f"{uniformity(smooth, mask):.3f}",
                "" if less else shown(nmse_estimate(images, paper).metric(), 5),
                "" if less else f"{nmse(cut, paper):.5f}",
            )
        )
    return tuple(rows)


def _sides(target: RectangleTarget | DiscTarget, window: WindowSize) -> dict[str, float | None]:
    return {} if isinstance(target, DiscTarget) else {"width_mm": window.width, "height_mm": window.height}


def progress_rows(name: str) -> Iterator[tuple[str, ...]]:
    """A design of version 0.1.0 with a drawn picture as its target, and that of this one."""
    if name not in EARLIER:
        return
    run, (whole, inside) = lf.load(FOLDERS / name), region_rows(name)
    light = run.light.first
    yield (name, "0.1.0", *EARLIER[name])
    on_receiver = float(light.raw_map.mean()) * light.width * light.height * 1e-6 / run.spec.source.flux_w
    figures = (shown(light.nmse, 5), f"{on_receiver:.4f}", inside[3], whole[3])
    yield ("", "now", *figures, f"{run.design.seconds:.0f} s")


def table(columns: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    """Print a Markdown table."""
    print("| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*CASES, []], help="of examples/published; all by default")
    parser.add_argument("--light", action="store_true", help="design and evaluate alone, without files and referees")
    parser.add_argument("--table", action="store_true", help="print the tables of finished folders alone")
    given = parser.parse_args()
    names = given.names or list(CASES)
    if not given.table:
        for name in names:
            design_light(name) if given.light else design(name)
    table(LIGHT, (row for name in names for row in light_rows(name)))
    print()
    table(REGIONS, (row for name in names for row in region_rows(name)))
    print()
    table(PROGRESS, (row for name in names for row in progress_rows(name)))


if __name__ == "__main__":
    main()
