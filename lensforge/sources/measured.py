"""Rays that are used as they are: from the coordinates in which they came to an emitter in those of the lens."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lensforge.records import Point
from lensforge.sources.account import FileAccount, PlacementAccount, Range, SourceAccount
from lensforge.sources.bundle import RayBundle
from lensforge.sources.placement import origin_of, placed
from lensforge.sources.rayfile_source import RayfileEmitter
from lensforge.sources.rayfiles.virtual_focus import virtual_focus
from lensforge.spec.source import RayfileSource, RayfilesSource, RaySource

MeasuredSource = RayfileSource | RayfilesSource | RaySource


def measured_emitter(
    rays: RayBundle,
    flux_w: float,
    spec: MeasuredSource,
    count: int,
    *,
    files: Sequence[FileAccount] = (),
    warnings: Sequence[str] = (),
    colours: tuple[Range, Range] | None = None,
) -> RayfileEmitter:
    """The emitter of ``rays``, the usable ones of ``count``, placed as ``spec`` says; ``flux_w``: their power (W).

    ``colours``: the least and the largest wavelength (nm), and the indices of the lens there. Raises
    :class:`InputError` where the virtual focus is asked for and there is none.
    """
    origin = origin_of(rays, spec, ", ".join(file.file for file in files) or "source.rays")
    bundle = placed(rays, origin, spec)
    account = SourceAccount(
        title=spec.title,
        flux_w=flux_w,
        symmetry="none",
        rays=count,
        effective_rays=effective_rays(rays),
        virtual_focus_mm=focus_of(rays),
        warnings=tuple(warnings),
        wavelengths_nm=colours[0] if colours else None,
        refractive_indices=colours[1] if colours else None,
        files=tuple(files),
        placement=_placement(bundle, flux_w, spec, origin),
    )
    return RayfileEmitter(bundle, flux_w, account)


def _placement(
    bundle: RayBundle, flux_w: float, spec: MeasuredSource, origin: Float[np.ndarray, " 3"]
) -> PlacementAccount:
    return PlacementAccount(
        origin_mm=point(origin),
        scale=spec.scale,
        axis=spec.axis,
        mirror=spec.mirror,
        rotate_z_deg=spec.rotate_z_deg,
        backward_share=float(bundle.weights[bundle.directions[:, 2] < 0.0].sum() / flux_w),
        below_plane_share=float(bundle.weights[bundle.origins[:, 2] < 0.0].sum() / flux_w),
    )


def effective_rays(rays: RayBundle) -> float:
    """How many rays of equal weight would have the same noise."""
    return float(rays.weights.sum() ** 2 / (rays.weights @ rays.weights))


def focus_of(rays: RayBundle) -> Point | None:
    """The virtual focus (mm) of ``rays``; None where they fix no point."""
    focus = virtual_focus(rays.origins, rays.directions, rays.weights)
    return None if focus is None else point(focus)


def point(coordinates: Float[np.ndarray, " 3"]) -> Point:
    """Three coordinates as a record holds them."""
    x, y, z = coordinates.tolist()
    return x, y, z
