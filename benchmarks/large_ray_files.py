"""Seconds and peak memory of the commands on a ray file of any size, beside those on a built-in square source.

    python benchmarks/large_ray_files.py [--rays 2e7] [--format tm25]

The file is a sample of the square source itself, written in a temporary folder. Memory is that of a command and all
processes that it starts: ``anonymous`` is what it allocates, ``resident`` counts the pages of the mapped file, too,
which the system takes back whenever it needs them. Linux only.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from watched import Peak, watched

from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile

SQUARE = 'kind = "square"\nside_mm = 2.0\nflux_w = 1.0\n'
SPEC = """
[lens]
refractive_index = 1.4936
material = "PMMA at 564 nm"
levels = "auto"

[lens.inner]
offset_mm = 6.0

[lens.outer]
offset_mm = 12.0

[constraints]
cavity_height_mm = 1.0
cavity_radius_mm = 1.6
min_thickness_mm = 1.1
max_radius_mm = 14.0

[target]
kind = "cross"
length_mm = 200.0
stroke_mm = 60.0
edge_mm = 3.0
distance_mm = 150.0
receiver_mm = 300.0
"""
CHUNK = 2**20  # rays drawn at a time
SUFFIXES = {"tm25": "tm25ray", "zemax_binary": "dat"}


def make_file(path: Path, count: int, format: str) -> None:
    """Write ``count`` rays of the square source, chunk by chunk."""
    emitter, raw = SquareEmitter(2.0), path.with_suffix(".raw")
    rows = np.memmap(raw, dtype="<f4", mode="w+", shape=(count, 7))
    for number, start in enumerate(range(0, count, CHUNK)):
        rays = emitter.sample(min(CHUNK, count - start), number)
        rows[start : start + CHUNK, 0:3] = rays.origins
        rows[start : start + CHUNK, 3:6] = rays.directions
    rows[:, 6] = 1.0 / count
    write_rayfile(path, RayFile(rows[:, 0:3], rows[:, 3:6], rows[:, 6], "W", header_flux_w=1.0), format)
    raw.unlink()


def run(*arguments: str) -> Peak:
    """Run ``lensforge`` with ``arguments`` and watch its memory until it ends."""
    return watched([sys.executable, "-m", "lensforge", *arguments, "--quiet"])


def commands(folder: Path, source: str, accuracy: str) -> dict[str, list[str]]:
    """Commands in their order, by name; ``source``: the lines of the spec's section."""
    spec, out = folder / "spec.toml", str(folder / "out")
    spec.write_text(f'name = "large"\n\n[source]\n{source}{SPEC}', encoding="utf-8")
    return {
        f"design --accuracy {accuracy}": ["design", str(spec), "--out", out, "--accuracy", accuracy],
        "evaluate": ["evaluate", out],
        "evaluate --rays 16777216": ["evaluate", out, "--rays", str(2**24)],
        "check": ["check", out],
        "verify": ["verify", out],
        "photometry": ["photometry", out],
    }


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--rays", type=float, default=2e7)
    arguments.add_argument("--format", choices=list(SUFFIXES), default="tm25")
    arguments.add_argument("--accuracy", default="draft")
    given = arguments.parse_args()
    os.environ.setdefault("PYTHONUNBUFFERED", "1")
    with tempfile.TemporaryDirectory() as temporary:
        folders = {name: Path(temporary) / name for name in ("square", "file")}
        for folder in folders.values():
            folder.mkdir()
        path = folders["file"] / f"rays.{SUFFIXES[given.format]}"
        make_file(path, int(given.rays), given.format)
        print(f"{int(given.rays):,} rays, {given.format}, {path.stat().st_size / 2**20:.0f} MiB")
        print("| command | s | s, square | anonymous, MiB | above the square | resident, MiB | above the square |")
        print("|---|---|---|---|---|---|---|")
        found = run("rays", str(path))
        print(f"| rays | {found.seconds:.1f} | | {found.anonymous:.0f} | | {found.resident:.0f} | |", flush=True)
        of_file = commands(folders["file"], f'kind = "rayfile"\nfile = "{path}"\n', given.accuracy)
        of_square = commands(folders["square"], SQUARE, given.accuracy)
        for name, own in of_file.items():
            square, found = run(*of_square[name]), run(*own)
            print(
                f"| {name} | {found.seconds:.1f} | {square.seconds:.1f} | {found.anonymous:.0f} | "
                f"{found.anonymous - square.anonymous:.0f} | {found.resident:.0f} | "
                f"{found.resident - square.resident:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
