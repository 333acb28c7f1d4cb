"""Light through the cover glass: exit rays as they go on behind a plane-parallel plate.

A plate of thickness t and index n_g in a medium of index n_o leaves the direction of a ray as it is, and its line as if
the ray had started nearer by ``t (1 - n_o cos a / (n_g cos b))`` along the plate's normal, a and b the angles outside
and inside (Born and Wolf, Principles of Optics, 4.7). Each face transmits by Fresnel, or by its coating, what comes
polarised in the plane of the ray and z, and across it; what they reflect goes back and is followed no further. Without
``fresnel`` its faces let all light through.
"""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from lensforge.kernels.jit import in_chunks
from lensforge.kernels.plate import behind_plate, behind_plate_adjoint
from lensforge.optics.dielectric import coated_transmittances, fresnel_transmittances, transmitted_cosine_squared
from lensforge.optics.media import Media
from lensforge.tracing.exit_rays import ExitRays, Sensitivities
from lensforge.tracing.ray_coatings import NO_COATINGS, RayCoatings

_Plate = tuple[bool, float, float, float]


def behind_glass(rays: ExitRays, media: Media, fresnel: bool = True, coatings: RayCoatings = NO_COATINGS) -> ExitRays:
    """``rays``, float64 on the CPU, as they are behind the cover glass of ``media``; themselves where there is none."""
    if media.cover_glass is None:
        return rays
    plate, (coating, rows) = _packed(media, fresnel), coatings.of_glass
    points, flux = rays.points.numpy().copy(), rays.flux.numpy().copy()
    directions, fates, lost = rays.directions.numpy(), rays.fates.numpy(), np.empty(len(flux))
    heights, axial = points[:, 2], _axial(rays)

    def work(_: int, part: slice) -> None:
        behind_plate(
            directions[part], fates[part], axial[part], plate, coating, rows if len(rows) <= 1 else rows[part],
            heights[part], flux[part], lost[part],
        )  # fmt: skip

    in_chunks(work, len(flux))
    behind = (torch.from_numpy(array) for array in (points, flux, lost))
    return replace(rays, **dict(zip(("points", "flux", "lost_in_glass"), behind, strict=True)))


def before_glass(
    rays: ExitRays,
    media: Media,
    by: Sensitivities,
    by_flux: Float[np.ndarray, " n"],
    fresnel: bool,
    coatings: RayCoatings = NO_COATINGS,
) -> tuple[Sensitivities, Float[np.ndarray, " n"], Float[np.ndarray, " n"] | None]:
    """Sensitivities to ``rays``, their flux and that along z from those to the rays behind the cover glass and theirs.

    The last are None where there is none, or where nothing reflects.
    """
    if media.cover_glass is None:
        return by, by_flux, None
    plate, (coating, rows) = _packed(media, fresnel), coatings.of_glass
    directions, fates, flux = rays.directions.numpy(), rays.fates.numpy(), rays.flux.numpy()
    by_directions, by_own_flux = by.by_directions.copy(), by_flux.copy()
    by_heights, by_cosines = by.by_points[:, 2], by_directions[:, 2]
    axial, by_axial = _axial(rays), np.empty(len(flux))

    def work(_: int, part: slice) -> None:
        behind_plate_adjoint(
            directions[part], fates[part], flux[part], axial[part], plate, coating,
            rows if len(rows) <= 1 else rows[part],
            by_heights[part], by_own_flux[part], by_axial[part], by_cosines[part],
        )  # fmt: skip

    in_chunks(work, len(by_own_flux))
    return Sensitivities(by.by_points, by_directions), by_own_flux, by_axial if fresnel else None


def _axial(rays: ExitRays) -> Float[np.ndarray, " n"]:
    return np.zeros(len(rays.flux)) if rays.axial is None else rays.axial.numpy()


def _packed(media: Media, fresnel: bool) -> _Plate:
    """The numbers that the kernels take."""
    glass = media.cover_glass
    assert glass is not None
    return fresnel, media.outside_index / glass.refractive_index, glass.thickness_mm, glass.absorption_per_mm


def behind_glass_in_torch(
    rays: ExitRays, media: Media, fresnel: bool = True, coatings: RayCoatings = NO_COATINGS
) -> ExitRays:
    """:func:`behind_glass` in plain torch, on any device and in any precision; differentiable."""
    glass = media.cover_glass
    if glass is None:
        return rays
    meets = (rays.directions[:, 2] > 0.0) & rays.left_lens
    outside = torch.where(meets, rays.directions[:, 2], 1.0)
    ratio = media.outside_index / glass.refractive_index
    inside = torch.sqrt(transmitted_cosine_squared(outside, ratio))
    nearer = glass.thickness_mm * (1.0 - ratio * outside / inside)
    passed = rays.flux * torch.exp(-glass.absorption_per_mm * glass.thickness_mm / inside)
    if fresnel:
        if coatings.glass is None:
            t_s, t_p, excess = fresnel_transmittances(outside, ratio)
        else:
            table, rows = (torch.as_tensor(each).to(outside) for each in (coatings.glass, coatings.rows))
            t_s, t_p, excess = coated_transmittances(outside, ratio, table, rows)
        assert rays.axial is not None
        in_plane = rays.axial / torch.where(rays.flux > 0.0, rays.flux, 1.0)
        passed = passed * (t_s**2 + (t_s + t_p) * excess * in_plane)
    up = torch.zeros_like(rays.points)
    up[:, 2] = 1.0
    flux = torch.where(meets, passed, rays.flux)
    points = rays.points + torch.where(meets, nearer, 0.0)[:, None] * up
    return replace(rays, points=points, flux=flux, lost_in_glass=rays.flux - flux)
