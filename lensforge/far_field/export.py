"""``lens.ies``, ``lens.ldt`` and ``lens.tm25ray``: the light of the finished lens for the next program, proven.

Only light that leaves the lens upwards is in the files: what leaves it downwards meets the plane on which the lens
stands, and is accounted for as averted. Gamma = 0 is the lens axis, C = 0 the x axis, C = 90 the y axis.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.errors import InputError
from lensforge.evaluation.simulate import TracedLens
from lensforge.files import write_json
from lensforge.gates import Gate
from lensforge.lens import load_lens
from lensforge.far_field.binning import AngularGrid
from lensforge.far_field.exits import exit_rays
from lensforge.sources.build import build_source
from lensforge.sources.bundle import RayBundle, Source
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import PhotometricFile, read_photometric, write_photometric
from lensforge.sources.rayfiles import RayFile, read_rayfile, write_rayfile
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.tracing.fates import Fate

_SEED = 2**42  # apart from the seeds of the design, of its evaluation, and of its verification
_PARTS = 16  # independent samples: their spread is the standard error
_FILE_RAYS = 2**17  # rays of the ray file
_SLACK = 1.001  # the sphere on which exit rays start, in radii of the lens
_CONSERVED = 1e-5  # relative error of a file's integral: seven digits of each number are written


def export_photometry(directory: Path, *, rays: int | None = None, lumens: float | None = None) -> dict[str, Any]:
    """Write the three files and ``photometry.json``; ``lumens`` is the luminous flux of the source.

    Without it, the flux follows from the spec's luminous efficacy; without that, it is 1000 lm: then candela are cd
    for each 1000 lm of the LED.
    """
    started = time.perf_counter()
    lens = load_lens(directory / "lens.json")
    if lens.accuracy not in PRESETS:
        raise InputError(f"{directory / 'lens.json'}: accuracy = {lens.accuracy!r}: one of {', '.join(PRESETS)}")
    preset = PRESETS[lens.accuracy]
    source = build_source(lens.spec.source, lens.spec.lens.dispersion)
    radius_mm = float(lens.outer.radius(fibonacci_hemisphere(20_000)).max())
    traced = TracedLens.of(lens, preset.judge_nodes_per_sigma)
    light = _light_behind(traced, source, rays or preset.evaluate_rays, lens.seed, _SLACK * radius_mm)
    table = AngularGrid().table(light.deposits.mean(axis=0))
    report = _flux_account(light, source.flux_w)
    lumens = lumens or (lens.spec.source.luminous_efficacy_lm_per_w or 0.0) * source.flux_w or 1000.0
    report |= _write(directory, lens.spec.name, table, light, radius_mm, lumens, lumens / source.flux_w)
    report["peak_cd"] = float(table.values.max() * lumens / source.flux_w)
    report["seconds"] = time.perf_counter() - started
    report["gates"] = [gate.to_json() for gate in _gates(report)]
    write_json(directory / "photometry.json", report)
    return report


@dataclass(frozen=True)
class _Light:
    """What ``rays`` rays say of the light behind the lens: flux by sample and node, by fate, and some of the rays."""

    rays: int
    deposits: Float[np.ndarray, "parts planes nodes"]
    by_fate_w: Float[np.ndarray, " f"]
    sample: RayBundle


def _light_behind(lens: TracedLens, source: Source, rays: int, seed: int, sphere_mm: float) -> _Light:
    grid, deposits, by_fate, kept, count = AngularGrid(), [], np.zeros(len(Fate)), [], 0
    for bundle in _bundles(source, rays, seed):
        out = exit_rays(lens, bundle, sphere_mm)
        deposits.append(grid.deposit(out.rays))
        by_fate += out.by_fate_w
        some = slice(_FILE_RAYS // _PARTS)
        kept.append(out.rays.take(some))
        count += len(bundle)
    flux_w = float(np.sum(deposits) / len(deposits))
    if not flux_w > 0.0:
        raise InputError(f"none of {count} rays leaves the lens upwards: there is no light to write; check lens.json")
    sample = RayBundle.joined(kept)
    sample = replace(sample, weights=sample.weights * (flux_w / sample.weights.sum()))
    return _Light(count, np.array(deposits), by_fate / len(deposits), sample)


def _bundles(source: Source, rays: int, seed: int) -> Iterator[RayBundle]:
    """Independent samples, each of the whole flux; a measured source is dealt out at random."""
    population = source.population
    if population is None:
        per_part = -(-rays // _PARTS)
        for part in range(_PARTS):
            yield source.sample(per_part, _SEED + seed * _PARTS + part)
        return
    everything = source.sample(min(rays, population), seed)
    order = np.random.default_rng(seed).permutation(len(everything))
    for rows in np.array_split(order, min(_PARTS, len(order))):
        dealt = everything.take(rows)
        yield replace(dealt, weights=dealt.weights * (source.flux_w / dealt.weights.sum()))


def _flux_account(light: _Light, source_w: float) -> dict[str, Any]:
    exits = light.deposits.sum(axis=(1, 2))
    error = float(exits.std(ddof=1) / np.sqrt(len(exits))) if len(exits) > 1 else 0.0
    lost = {fate.name.lower(): float(light.by_fate_w[fate]) for fate in Fate if fate != Fate.ARRIVED}
    return {
        "rays": light.rays,
        "source_w": source_w,
        "exit_w": float(exits.mean()),
        "exit_w_standard_error": error,
        "light_output_ratio": float(exits.mean() / source_w),
        "lost_w": lost,
        "absorbed_fresnel_w": source_w - float(light.by_fate_w.sum()),
    }


def _write(
    directory: Path,
    name: str,
    table: TabulatedIntensity,
    light: _Light,
    radius_mm: float,
    lumens: float,
    lumens_per_watt: float,
) -> dict[str, Any]:
    """Write the files and read them back: the flux that each holds, and how far it is from that of the rays."""
    candela = TabulatedIntensity(table.c_deg, table.gamma_deg, table.values * lumens_per_watt)
    title = f"lensforge {name}"
    photometric = PhotometricFile(candela, lumens, title=title, diameter_mm=2.0 * radius_mm)
    exit_w = float(light.sample.weights.sum())
    files: dict[str, dict[str, float]] = {}
    for file in ("lens.ies", "lens.ldt"):
        write_photometric(directory / file, photometric)
        back = read_photometric(directory / file).intensity.flux()
        files[file] = {"lumens": back, "relative_error": abs(back / (exit_w * lumens_per_watt) - 1.0)}
    header = {"name": title, "creation_method": "simulated", "ray_file_creator": "lensforge"}
    rays = light.sample
    rayfile = RayFile(rays.origins, rays.directions, rays.weights, "W", header_flux_w=exit_w, header=header)
    write_rayfile(directory / "lens.tm25ray", rayfile, "tm25")
    written = read_rayfile(directory / "lens.tm25ray")
    error = abs(written.ray_sum() / exit_w - 1.0)
    files["lens.tm25ray"] = {"rays": len(written), "watts": written.ray_sum(), "relative_error": error}
    return {"source_lm": lumens, "exit_lm": exit_w * lumens_per_watt, "files": files}


def _gates(report: dict[str, Any]) -> Iterator[Gate]:
    remedy = "please report the lens.json"
    for name, entry in report["files"].items():
        yield Gate(f"flux of {name} as read back", entry["relative_error"], "<=", _CONSERVED, "relative", remedy)
