"""Lenses for LEDs of known radiance, by rays of a file or by a radiance fitted to them, judged by 4 million others.

python benchmarks/fitted_radiance.py window|dome|mirror RAYS rays|auto|radiance [--accuracy draft]
"""

import argparse
import json
import runpy
import time
from pathlib import Path

import numpy as np

from lensforge.light.evaluation import evaluate_lens
from lensforge.search.optimiser import search
from lensforge.sources import modelled_rays
from lensforge.sources.build_source import build_source
from lensforge.spec import load_spec
from lensforge.spec.accuracy import PRESETS
from lensforge.spec.source_sections import RaySource

EXAMPLES = Path(__file__).parents[1] / "examples"
CAVITIES = {"window": (1.0, 2.0), "dome": (3.0, 3.2), "mirror": (1.3, 2.6)}  # height and radius, mm


def lambertian(random, count):
    sine, azimuth = np.sqrt(random.random(count)), 2.0 * np.pi * random.random(count)
    return np.column_stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.sqrt(1.0 - sine**2)])


def window(count, seed):
    """The LED of make_led_rayfile.py."""
    led = runpy.run_path(str(EXAMPLES / "make_led_rayfile.py"))
    made = led["make_led"]
    made.__globals__.update(RAYS=count, SEED=seed)
    rays = made()
    return rays.positions_mm.astype(float), rays.directions.astype(float)


def dome(count, seed, radius=1.8, index=1.41):
    """Four chips of 0.8 mm, 0.9 mm apart, with 30, 25, 25 and 20 % of the light, in a dome of silicone."""
    random = np.random.default_rng(seed)
    chip = np.searchsorted(np.cumsum([0.3, 0.25, 0.25]), random.random(2 * count))
    centres = np.column_stack([chip % 2 - 0.5, chip // 2 - 0.5]) * 0.9 + (0.1, -0.05)
    starts = np.column_stack([centres + (random.random((2 * count, 2)) - 0.5) * 0.8, np.zeros(2 * count)])
    inside = lambertian(random, 2 * count)
    along = np.sum(starts * inside, axis=1)
    ends = starts + (np.sqrt(along**2 + radius**2 - np.sum(starts**2, axis=1)) - along)[:, None] * inside
    normal = ends / radius
    cosine = np.sum(inside * normal, axis=1)
    outside = np.sqrt(np.maximum(1.0 - index**2 * (1.0 - cosine**2), 0.0))
    across = (index * cosine - outside) / (index * cosine + outside)
    parallel = (cosine - index * outside) / (cosine + index * outside)
    passed = random.random(2 * count) < 1.0 - 0.5 * (across**2 + parallel**2)
    directions = index * inside + (outside - index * cosine)[:, None] * normal
    return ends[passed][:count], directions[passed][:count]


def mirror(count, seed, rim=0.8, bottom=0.9, slope=0.9, reflectance=0.9):
    """A chip of 1 mm at the bottom of a conical mirror of radius 0.9 mm + 0.9 z, up to its rim."""
    random = np.random.default_rng(seed)
    starts = np.column_stack([random.random((2 * count, 2)) - 0.5, np.zeros(2 * count)])
    directions, lit = lambertian(random, 2 * count), np.ones(2 * count, dtype=bool)
    for _ in range(20):
        up = np.where(directions[:, 2] > 0.0, (rim - starts[:, 2]) / directions[:, 2], np.inf)
        wall = bottom + slope * starts[:, 2]
        a = np.sum(directions[:, :2] ** 2, axis=1) - (slope * directions[:, 2]) ** 2
        b = np.sum(starts[:, :2] * directions[:, :2], axis=1) - slope * directions[:, 2] * wall
        root = np.sqrt(np.maximum(b**2 - a * (np.sum(starts[:, :2] ** 2, axis=1) - wall**2), 0.0))
        hits = np.stack([(-b - root) / a, (-b + root) / a])
        heights = starts[:, 2] + hits * directions[:, 2]
        hit = np.where((hits > 1e-9) & (heights >= 0.0) & (heights <= rim), hits, np.inf).min(axis=0)
        reflects = np.isfinite(hit) & (starts[:, 2] < rim)
        leaves = ~reflects & (starts[:, 2] < rim)
        lit &= ~(leaves & ~np.isfinite(up)) & ~(reflects & (random.random(len(lit)) > reflectance))
        length = np.where(reflects, np.where(np.isfinite(hit), hit, 0.0), np.where(leaves & lit, up, 0.0))
        starts = starts + length[:, None] * directions
        starts[leaves & lit, 2] = rim
        radial = starts[:, :2] / np.maximum(np.linalg.norm(starts[:, :2], axis=1, keepdims=True), 1e-9)
        normal = np.column_stack([-radial, np.full(len(lit), slope)]) / np.hypot(1.0, slope)
        turned = directions - 2.0 * np.sum(directions * normal, axis=1)[:, None] * normal
        directions = np.where(reflects[:, None], turned, directions)
    lit &= starts[:, 2] == rim
    return starts[lit][:count], directions[lit][:count]


LEDS = {"window": window, "dome": dome, "mirror": mirror}


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("led", choices=list(LEDS))
    arguments.add_argument("rays", type=int)
    arguments.add_argument(
        "model", choices=["rays", "auto", "radiance"], help="radiance: even where auto keeps the rays"
    )
    arguments.add_argument("--accuracy", choices=list(PRESETS), default="standard")
    given = arguments.parse_args()
    if given.model == "radiance":
        modelled_rays._apart = lambda *_: 0.0
    origin = "virtual_focus" if given.led == "window" else "file"

    def source(count, seed, model):
        positions, directions = LEDS[given.led](count, seed)
        return RaySource(positions_mm=positions, directions=directions, flux_w=1.0, origin=origin, model=model)

    height, radius = CAVITIES[given.led]
    cavity = {"constraints.cavity_height_mm": height, "constraints.cavity_radius_mm": radius}
    spec = load_spec(EXAMPLES / "led_rayfile.toml").replace(cavity).with_automatic_levels()
    started = time.process_time()
    emitter = build_source(source(given.rays, {20_000: 1, 100_000: 2}.get(given.rays, 3), given.model))
    fit_s, preset = time.process_time() - started, PRESETS[given.accuracy]
    lens = search(spec, emitter, accuracy=given.accuracy, seed=0).lens
    judged = evaluate_lens(lens, build_source(source(4_000_000, 4, "rays")), preset, rays=4_000_000)
    told = evaluate_lens(lens, emitter, preset, searched_with=True)
    report = {"model": emitter.summary.model, "fit_cpu_s": fit_s}
    for name, light in (("judged", judged), ("as_told", told)):
        report[name] = {"nmse": str(light.nmse), "efficiency": str(light.efficiency)}
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
