"""Light through the cover glass: exit rays as they go on behind a plane-parallel plate; in torch, differentiable.

A plate of thickness t and index n_g in a medium of index n_o leaves the direction of a ray as it is, and its line as if
the ray had started nearer by ``t (1 - n_o cos a / (n_g cos b))`` along the plate's normal, a and b the angles outside
and inside (Born and Wolf, Principles of Optics, 4.7). Each face transmits by Fresnel, or by its coating; what they
reflect goes back and is followed no further.
"""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from lensforge.optics.dielectric import coated_transmittance, fresnel_transmittance, transmitted_cosine_squared
from lensforge.optics.media import Media
from lensforge.tracing.exit_rays import ExitRays, Sensitivities
from lensforge.tracing.ray_coatings import NO_COATINGS, RayCoatings


def behind_glass(rays: ExitRays, media: Media, fresnel: bool = True, coatings: RayCoatings = NO_COATINGS) -> ExitRays:
    """``rays`` as they are behind the cover glass of ``media``; themselves where there is none.

    Rays that go sideways or back never meet it. Without ``fresnel`` its faces let all light through.
    """
    glass = media.cover_glass
    if glass is None:
        return rays
    meets = (rays.directions[:, 2] > 0.0) & rays.left_lens
    outside = torch.where(meets, rays.directions[:, 2], 1.0)
    ratio = media.outside_index / glass.refractive_index
    inside = torch.sqrt(transmitted_cosine_squared(outside, ratio))
    nearer = glass.thickness_mm * (1.0 - ratio * outside / inside)
    share = torch.exp(-glass.absorption_per_mm * glass.thickness_mm / inside)
    if fresnel and coatings.glass is not None:
        table, rows = (torch.as_tensor(each).to(outside) for each in (coatings.glass, coatings.rows))
        share = share * coated_transmittance(outside, ratio, table, rows) ** 2
    elif fresnel:
        share = share * fresnel_transmittance(outside, ratio) ** 2
    up = torch.zeros_like(rays.points)
    up[:, 2] = 1.0
    flux = torch.where(meets, rays.flux * share, rays.flux)
    points = rays.points + torch.where(meets, nearer, 0.0)[:, None] * up
    return replace(rays, points=points, flux=flux, lost_in_glass=rays.flux - flux)


def before_glass(
    rays: ExitRays,
    media: Media,
    by: Sensitivities,
    by_flux: Float[np.ndarray, " n"],
    fresnel: bool,
    coatings: RayCoatings = NO_COATINGS,
) -> tuple[Sensitivities, Float[np.ndarray, " n"]]:
    """Sensitivities to ``rays`` and to their flux from those to the rays behind the cover glass, and to theirs."""
    if media.cover_glass is None:
        return by, by_flux
    own = [each.detach().requires_grad_() for each in (rays.directions, rays.flux)]
    with torch.enable_grad():
        found = behind_glass(replace(rays, directions=own[0], flux=own[1]), media, fresnel, coatings)
        outputs = (found.points, found.flux)
        given = (torch.from_numpy(by.by_points), torch.from_numpy(by_flux))
        by_directions, by_own_flux = torch.autograd.grad(outputs, own, given)
    return Sensitivities(by.by_points, by.by_directions + by_directions.numpy()), by_own_flux.numpy()
