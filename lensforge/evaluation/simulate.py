"""Trace a finished lens with many rays, in independent replicates, so that every metric has a standard error."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Shaped

from lensforge import seeds
from lensforge.errors import remedy
from lensforge.kernels.fates import Fate
from lensforge.lens import Lens
from lensforge.receivers.pixels import bin_flux, flux_in_square
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.receiver import Receiver
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.surfaces.spline import TableGrid, grid_for, table_error, tabulate
from lensforge.tracing.exit_rays import ExitRays
from lensforge.tracing.tables import Scene, trace_tables

REPLICATES = 16
MISSED_RECEIVER = len(Fate)  # after the fates: left the lens, but never reaches the receiver
_MOST_RAYS_AT_ONCE = 2**20  # bounds the memory: about 200 MB of rays and hits


@dataclass(frozen=True)
class TracedLens:
    """A lens with its tables, ready to trace."""

    scene: Scene
    inner: torch.Tensor
    outer: torch.Tensor
    table_error_nm: dict[str, float]

    @staticmethod
    def of(lens: Lens, nodes_per_sigma: float) -> "TracedLens":
        """Tabulate both surfaces from the exact sum; the tables' error against it is measured at once."""
        with remedy("take a lower accuracy"):
            grid: TableGrid = grid_for(lens.detail_rad, nodes_per_sigma)
        surfaces = {"inner": lens.inner, "outer": lens.outer}
        tables = {name: tabulate(grid, surface) for name, surface in surfaces.items()}
        errors = {name: 1e6 * table_error(grid, tables[name], surface) for name, surface in surfaces.items()}
        inner, outer = (torch.from_numpy(table) for table in tables.values())
        return TracedLens(Scene(lens.refractive_index, grid), inner, outer, errors)

    def trace(self, rays: RayBundle) -> ExitRays:
        """Send ``rays`` through the lens."""
        return trace_tables(self.inner, self.outer, self.scene, rays)


@dataclass(frozen=True)
class Simulation:
    """Flux (W) of each replicate: per pixel (r, p, p), by fate (r, f), and in the window (r,).

    The fates are those of :class:`~lensforge.kernels.fates.Fate`, where ``LEFT_LENS`` holds what landed, and
    ``MISSED_RECEIVER``.
    """

    images: Float[np.ndarray, "r p p"]
    by_fate: Float[np.ndarray, "r f"]
    window: Float[np.ndarray, " r"]
    emitted_w: float
    rays: int


def simulate(
    lens: TracedLens, source: Source, receiver: Receiver, window_mm: float, rays: int, seed: int
) -> Simulation:
    """Trace ``rays`` rays, or as many as a measured source holds, in up to 16 independent replicates."""
    replicates = min(REPLICATES, rays, source.ray_count or rays)
    images = np.zeros((replicates, receiver.grid.pixels, receiver.grid.pixels))
    by_fate = np.zeros((replicates, len(Fate) + 1))
    window = np.zeros(replicates)
    traced = 0
    for replicate, share, bundle in _bundles(source, rays, replicates, seed):
        exit_rays = lens.trace(bundle)
        landings = receiver.land(exit_rays)
        hits, flux = landings.hits.numpy(), landings.flux.numpy() * share
        images[replicate] += bin_flux(hits, flux, receiver.grid)
        by_fate[replicate] += share * flux_by_fate(exit_rays, landings.missed_receiver)
        window[replicate] += flux_in_square(hits, flux, window_mm)
        traced += len(bundle)
    return Simulation(images, by_fate, window, source.flux_w, traced)


def flux_by_fate(rays: ExitRays, missed_receiver: Bool[torch.Tensor, " n"]) -> Float[np.ndarray, " f"]:
    """Flux (W) by fate; rays that left the lens and ``missed_receiver`` count apart, in the last place."""
    fates = torch.where(missed_receiver, MISSED_RECEIVER, rays.fates).numpy()
    return np.bincount(fates, rays.flux.numpy(), minlength=len(Fate) + 1)


def design_landings(
    lens: TracedLens, spec: Spec, rays: RayBundle
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"], Shaped[np.ndarray, " n"]]:
    """Hits (mm) of ``rays`` on the receiver of ``spec``, NaN where they do not land, their flux (W) there, their fates.

    Fates are the names of :class:`~lensforge.kernels.fates.Fate`, "landed" and "missed_receiver".
    """
    exit_rays = lens.trace(rays)
    landings = PlaneReceiver.of(spec.target, spec.evaluate.pixels).land(exit_rays)
    names = np.array(["landed", *(fate.name.lower() for fate in Fate if fate != Fate.LEFT_LENS), "missed_receiver"])
    fates = torch.where(landings.missed_receiver, MISSED_RECEIVER, exit_rays.fates).numpy()
    hits = np.where(landings.landed.numpy()[:, None], landings.hits.numpy(), np.nan)
    return hits, landings.flux.numpy(), names[fates]


def _bundles(source: Source, rays: int, replicates: int, seed: int) -> Iterator[tuple[int, float, RayBundle]]:
    """Bundles as (replicate, factor of flux, rays): a measured source divided at random, any other sampled afresh."""
    ray_count = source.ray_count
    if ray_count is not None:
        everything = source.sample(min(rays, ray_count), seed)
        order = np.random.default_rng(seed).permutation(len(everything))
        for replicate, rows in enumerate(np.array_split(order, replicates)):
            part = everything.take(rows)
            yield replicate, source.flux_w / part.flux.sum(), part
        return
    per_replicate = rays // replicates
    parts = -(-per_replicate // _MOST_RAYS_AT_ONCE)
    for replicate in range(replicates):
        for part_number in range(parts):
            part_seed = seeds.of_replicate(seed, replicates, replicate, parts, part_number)
            yield replicate, 1.0 / parts, source.sample(-(-per_replicate // parts), part_seed)
