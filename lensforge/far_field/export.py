"""The far field of the finished lens as IES, EULUMDAT and TM-25 files, verified by reading them back.

Only light that leaves the lens upwards is in the files: light that leaves it downwards meets the plane on which the
lens stands, and counts as missed_receiver. Gamma = 0 is the lens axis, C = 0 the x axis, C = 90 the y axis.
"""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge import seeds
from lensforge.accuracy import Preset
from lensforge.criteria import Criterion, at_most
from lensforge.errors import InputError
from lensforge.evaluation.simulate import MISSED_RECEIVER, TracedLens
from lensforge.far_field.intensity import AngularGrid, exit_rays
from lensforge.far_field.photometry import (
    IES_FILE,
    LDT_FILE,
    TM25_FILE,
    LostFlux,
    Photometry,
    WrittenFile,
    WrittenFiles,
)
from lensforge.kernels.fates import Fate
from lensforge.lens import Lens
from lensforge.records import Metric
from lensforge.sources.bundle import RayBundle, Source
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import PhotometricFile, read_photometric, write_photometric
from lensforge.sources.rayfiles import RayFile, read_rayfile, write_rayfile
from lensforge.surfaces.srbf import fibonacci_hemisphere

_PARTS = 16  # independent samples: their spread is the standard error
_FILE_RAYS = 2**17  # rays of the ray file
_SLACK = 1.001  # the sphere on which exit rays start, in radii of the lens
_CONSERVED = 1e-5  # relative error of a file's integral: seven digits of each number are written


def measure_photometry(
    lens: Lens, source: Source, preset: Preset, *, rays: int | None = None, lumens: float | None = None
) -> Photometry:
    """Trace the light of ``lens`` to its far field, and make the three files; ``lumens``: luminous flux of the source.

    Without it, the flux follows from the spec's luminous efficacy; without that, it is 1000 lm: then candela are
    cd/klm. Raises :class:`InputError` for lumens that are not above 0 and finite, and where no
    light leaves the lens upwards.
    """
    if lumens is not None and not 0.0 < lumens < np.inf:
        raise InputError(f"lumens = {lumens:g}: must be above 0 and finite; leave it out to take those of the spec")
    started = time.perf_counter()
    radius_mm = float(lens.outer.radius(fibonacci_hemisphere(20_000)).max())
    traced = TracedLens.of(lens, preset.evaluate_nodes_per_sigma)
    light = _exit_light(traced, source, rays or preset.evaluate_rays, lens.seed, _SLACK * radius_mm)
    table = AngularGrid().table(light.deposits.mean(axis=0))
    lumens = float(lumens or (lens.spec.source.luminous_efficacy_lm_per_w or 0.0) * source.flux_w or 1000.0)
    per_watt = lumens / source.flux_w
    candela = TabulatedIntensity(table.c_deg, table.gamma_deg, table.values * per_watt)
    title = f"lensforge {lens.spec.name}"
    photometric = PhotometricFile(candela, lumens, title=title, diameter_mm=2.0 * radius_mm)
    contents = _contents(photometric, _rayfile(light.sample, title))
    files = _read_back(contents, light.written_w, per_watt)
    return Photometry(
        inputs={"lens": lens.sha256},
        rays=light.rays,
        source_w=source.flux_w,
        exit_w=light.exit_w,
        light_output_ratio=_ratio(light.exit_w, source.flux_w),
        lost_w=_lost(light.by_fate_w),
        reflected_w=source.flux_w - float(light.by_fate_w.sum()),
        source_lm=lumens,
        exit_lm=light.written_w * per_watt,
        peak_cd=float(table.values.max() * lumens / source.flux_w),
        files=files,
        criteria=tuple(_criteria(files)),
        c_deg=candela.c_deg,
        gamma_deg=candela.gamma_deg,
        candela=candela.values,
        ies=contents[IES_FILE],
        ldt=contents[LDT_FILE],
        tm25=contents[TM25_FILE],
        seconds=time.perf_counter() - started,
    )


@dataclass(frozen=True)
class _ExitLight:
    """Exit light of ``rays`` rays: flux by sample and node, flux by fate, and some of the rays."""

    rays: int
    deposits: Float[np.ndarray, "parts planes nodes"]
    by_fate_w: Float[np.ndarray, " f"]
    sample: RayBundle

    @property
    def exit_w(self) -> Metric:
        """Flux that leaves the lens upwards, with its standard error by the spread of the samples."""
        exits = self.deposits.sum(axis=(1, 2))
        error = float(exits.std(ddof=1) / np.sqrt(len(exits))) if len(exits) > 1 else None
        return Metric(value=float(exits.mean()), unit="W", standard_error=error)

    @property
    def written_w(self) -> float:
        """The same flux as the sum over the rays of the sample."""
        return float(self.sample.flux.sum())


def _exit_light(lens: TracedLens, source: Source, rays: int, seed: int, sphere_mm: float) -> _ExitLight:
    grid, deposits, by_fate, kept, count = AngularGrid(), [], np.zeros(len(Fate) + 1), [], 0
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
    sample = replace(sample, flux=sample.flux * (flux_w / sample.flux.sum()))
    return _ExitLight(count, np.array(deposits), by_fate / len(deposits), sample)


def _bundles(source: Source, rays: int, seed: int) -> Iterator[RayBundle]:
    """Independent samples, each of the whole flux; the rays of a measured source are distributed at random."""
    ray_count = source.ray_count
    if ray_count is None:
        per_part = -(-rays // _PARTS)
        for part in range(_PARTS):
            yield source.sample(per_part, seeds.of_far_field(seed, _PARTS, part))
        return
    everything = source.sample(min(rays, ray_count), seed)
    order = np.random.default_rng(seed).permutation(len(everything))
    for rows in np.array_split(order, min(_PARTS, len(order))):
        some = everything.take(rows)
        yield replace(some, flux=some.flux * (source.flux_w / some.flux.sum()))


def _lost(by_fate_w: Float[np.ndarray, " f"]) -> LostFlux:
    lost = {fate.name.lower(): float(by_fate_w[fate]) for fate in Fate if fate != Fate.LEFT_LENS}
    return LostFlux.model_validate(lost | {"missed_receiver": float(by_fate_w[MISSED_RECEIVER])})


def _ratio(flux: Metric, whole_w: float) -> Metric:
    error = None if flux.standard_error is None else flux.standard_error / whole_w
    return Metric(value=flux.value / whole_w, standard_error=error)


def _rayfile(rays: RayBundle, title: str) -> RayFile:
    header = {"name": title, "creation_method": "simulated", "ray_file_creator": "lensforge"}
    flux_w = float(rays.flux.sum())
    return RayFile(rays.origins, rays.directions, rays.flux, "W", header_flux_w=flux_w, header=header)


def _contents(photometric: PhotometricFile, rayfile: RayFile) -> dict[str, bytes]:
    """Bytes of the three files, by name."""
    with tempfile.TemporaryDirectory() as folder:
        for name in (IES_FILE, LDT_FILE):
            write_photometric(Path(folder) / name, photometric)
        write_rayfile(Path(folder) / TM25_FILE, rayfile, "tm25")
        return {name: (Path(folder) / name).read_bytes() for name in (IES_FILE, LDT_FILE, TM25_FILE)}


def _read_back(contents: dict[str, bytes], exit_w: float, lumens_per_watt: float) -> WrittenFiles:
    """Flux of each file as read back, and its relative error from ``exit_w``, the flux of the rays."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            (Path(folder) / name).write_bytes(content)
        for key, name in (("ies", IES_FILE), ("ldt", LDT_FILE)):
            back = float(read_photometric(Path(folder) / name).intensity.flux())
            found[key] = WrittenFile(lumens=back, relative_error=abs(back / (exit_w * lumens_per_watt) - 1.0))
        rayfile = read_rayfile(Path(folder) / TM25_FILE)
        count, watts = len(rayfile), float(rayfile.ray_sum())
        del rayfile  # it maps the file, which is deleted next
    tm25 = WrittenFile(rays=count, watts=watts, relative_error=abs(watts / exit_w - 1.0))
    return WrittenFiles(**found, tm25ray=tm25)


def _criteria(files: WrittenFiles) -> Iterator[Criterion]:
    remedy = "please report the lens.json"
    for name, entry in ((IES_FILE, files.ies), (LDT_FILE, files.ldt), (TM25_FILE, files.tm25ray)):
        yield at_most(f"flux of {name} as read back", entry.relative_error, _CONSERVED, "relative", remedy)
