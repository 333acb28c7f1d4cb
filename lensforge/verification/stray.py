"""Stray light, which the sequential design leaves out: reflections, the base, absorption; its flux, and where it lands.

The non-sequential trace of the part is compared with the sequential trace of the same rays through the same mesh. The
board and the chip under the lens are not modelled: they absorb all light that comes back to them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import get_args

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.bundle import RayBundle
from lensforge.verification.acceptance import balance_error, stray_criteria
from lensforge.verification.casting import Grid
from lensforge.verification.image_plane import ImagePlane, nmse, within
from lensforge.verification.nonsequential import Base, Body, Cause, FluxBudget, Limits, ReceivedLight, follow
from lensforge.verification.part_mesh import read_part_mesh
from lensforge.verification.passage import Passage, send_through
from lensforge.verification.proof import StrayByCause, StrayFlux, StrayLight, StraySpread


def trace_stray(
    stl: bytes,
    *,
    rays: RayBundle,
    refractive_index: float,
    absorption_per_mm: float,
    distance_mm: float,
    receiver: ImagePlane,
    window_mm: float,
    base: Base = "polished",
    limits: Limits | None = None,
    inputs: Mapping[str, str] | None = None,
) -> StrayLight:
    """Follow ``rays`` through the part in the bytes of an STL file (mm) until all light has left it.

    Shares are of the emitted flux; "detected" is what lands in the centred square of ``window_mm``. ``inputs``: hashes
    of the inputs, by name. Raises :class:`InputError` for bytes that hold no mesh, and for an unknown ``base``.
    """
    if base not in get_args(Base):
        raise InputError(f"base = {base!r}: must be one of {', '.join(get_args(Base))}")
    start = perf_counter()
    limits = limits or Limits()
    part = read_part_mesh(stl)
    grid = Grid(part.mesh)
    budget = follow(Body(part, grid, refractive_index, absorption_per_mm, base), rays, distance_mm, limits)
    passage = send_through(part, grid, rays, refractive_index, distance_mm)
    landed, emitted = budget.landings(), float(rays.flux.sum())
    images = _images(landed, passage, receiver)
    flux = _flux(budget, landed, window_mm, emitted)
    misplaced, nmse_vs_sequential = _against_sequential(images, receiver, emitted)
    found = StrayLight(
        inputs=dict(inputs or {}),
        rays=len(rays),
        base=base,
        absorption_per_mm=absorption_per_mm,
        cut_off=limits.cut_off,
        depth=limits.depth,
        flux=flux,
        balance_error=balance_error(flux),
        detected_stray_by_cause=_by_cause(landed, window_mm, emitted),
        misplaced_flux=misplaced,
        nmse_vs_sequential=nmse_vs_sequential,
        spread=_spread(landed, images, receiver),
        efficiency=flux.detected_direct + flux.detected_stray,
        efficiency_sequential=float(passage.flux[within(passage.landings, window_mm)].sum()) / emitted,
        receiver_mm=receiver.side_mm,
        criteria=(),
        sequential=images.sequential,
        direct=images.direct,
        stray=images.stray,
        seconds=perf_counter() - start,
    )
    return found.model_copy(update={"criteria": stray_criteria(found)})


@dataclass(frozen=True)
class _Images:
    """Irradiance (W/m^2, [y, x]): by the sequential trace, and by the non-sequential one, direct and stray."""

    sequential: Float[np.ndarray, "p p"]
    direct: Float[np.ndarray, "p p"]
    stray: Float[np.ndarray, "p p"]


def _images(landed: ReceivedLight, passage: Passage, receiver: ImagePlane) -> _Images:
    direct, stray = ~landed.stray, landed.stray
    return _Images(
        sequential=receiver.irradiance(passage.landings, passage.flux),
        direct=receiver.irradiance(landed.points[direct], landed.flux[direct]),
        stray=receiver.irradiance(landed.points[stray], landed.flux[stray]),
    )


def _flux(budget: FluxBudget, landed: ReceivedLight, window_mm: float, emitted: float) -> StrayFlux:
    flux, inside, stray = landed.flux, within(landed.points, window_mm), landed.stray
    return StrayFlux(
        detected_direct=float(flux[inside & ~stray].sum()) / emitted,
        detected_stray=float(flux[inside & stray].sum()) / emitted,
        outside_direct=float(flux[~inside & ~stray].sum()) / emitted,
        outside_stray=float(flux[~inside & stray].sum()) / emitted,
        backward=budget.backward / emitted,
        absorbed=budget.absorbed / emitted,
        base=budget.base / emitted,
        too_dim=budget.cut_off / emitted,
        leaked=budget.leaked / emitted,
    )


def _by_cause(landed: ReceivedLight, window_mm: float, emitted: float) -> StrayByCause:
    inside = within(landed.points, window_mm)
    stray = [cause for cause in Cause if cause != Cause.SEQUENTIAL]
    return StrayByCause.model_validate(
        {cause.name.lower(): float(landed.flux[inside & (landed.causes == cause)].sum()) / emitted for cause in stray}
    )


def _against_sequential(images: _Images, receiver: ImagePlane, emitted: float) -> tuple[float, float | None]:
    """Difference of the irradiance of all light from that of the sequential trace of the same rays.

    Flux that lands on other pixels, as a share of the emitted flux, and the NMSE; None where the sequential trace lands
    no light.
    """
    whole, sequential = images.direct + images.stray, images.sequential
    pixel = (receiver.side_mm / receiver.pixels * 1e-3) ** 2
    misplaced = float(np.abs(whole - sequential).sum()) * pixel / emitted
    return misplaced, nmse(whole, sequential) if sequential.any() else None


def _spread(landed: ReceivedLight, images: _Images, receiver: ImagePlane) -> StraySpread:
    inside = landed.stray & within(landed.points, receiver.side_mm)
    points, total = landed.points[inside], float(landed.flux[inside].sum())
    if total <= 0.0:
        return StraySpread(centroid_mm=None, rms_radius_mm=None, peak_w_m2=0.0, peak_of_mean=0.0)
    shares = landed.flux[inside] / total
    centroid = shares @ points
    radius = np.sqrt(shares @ np.sum((points - centroid) ** 2, axis=1))
    peak, mean = float(images.stray.max()), float(images.sequential.mean())
    return StraySpread(
        centroid_mm=(float(centroid[0]), float(centroid[1])),
        rms_radius_mm=float(radius),
        peak_w_m2=peak,
        peak_of_mean=peak / mean if mean > 0.0 else None,
    )
