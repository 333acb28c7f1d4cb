"""Light at a dielectric surface, as pure torch functions: Snell's law and Fresnel's formulas, unpolarised.

``ratio`` is n_before / n_after, one for all rays or one for each. Normals have length 1 and point along the ray:
``c = d . n > 0``.
"""

import torch
from jaxtyping import Float
from torch import Tensor

Ratio = float | Float[Tensor, " n"]


def transmitted_cosine_squared(cosine: Float[Tensor, " n"], ratio: Ratio) -> Float[Tensor, " n"]:
    """Squared cosine behind the surface by Snell's law; 0 and below means total reflection.

    ``1 - ratio^2 (1 - c^2)`` without its cancellations: at a ratio of 1 even grazing rays are undeviated.
    """
    return (1.0 - ratio) * (1.0 + ratio) + (ratio * cosine) ** 2


def refract(directions: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"], ratio: Ratio) -> Float[Tensor, "n 3"]:
    """Unit directions behind the surface (vector form of Snell's law). Mask totally reflected rays first."""
    cosine = torch.sum(directions * normals, dim=1)
    along = torch.sqrt(transmitted_cosine_squared(cosine, ratio)) - ratio * cosine
    scale = torch.as_tensor(ratio, dtype=directions.dtype, device=directions.device).reshape(-1, 1)
    return scale * directions + along[:, None] * normals


def fresnel_transmittance(cosine: Float[Tensor, " n"], ratio: Ratio) -> Float[Tensor, " n"]:
    """Transmitted share of unpolarised flux (Born & Wolf, Principles of Optics, 1.5.2). Mask total reflection first."""
    behind = torch.sqrt(transmitted_cosine_squared(cosine, ratio))
    r_s = (ratio * cosine - behind) / (ratio * cosine + behind)
    r_p = (cosine - ratio * behind) / (cosine + ratio * behind)
    return 1.0 - 0.5 * (r_s**2 + r_p**2)


def coated_transmittance(
    cosine: Float[Tensor, " n"], ratio: Ratio, table: Float[Tensor, "k m"], rows: Float[Tensor, " j"]
) -> Float[Tensor, " n"]:
    """Transmitted share at a coated face. Mask total reflection first.

    ``table``: as in :mod:`~lensforge.optics.coating_tables`; ``rows``: place among its rows, of each ray or of all.
    """
    behind = torch.sqrt(transmitted_cosine_squared(cosine, ratio))
    denser = torch.as_tensor(ratio, device=cosine.device) < 1.0
    position = torch.where(denser, cosine, behind) * (table.shape[1] - 3)
    cell = position.detach().to(torch.int64).clamp(max=table.shape[1] - 4)
    low = rows.to(torch.int64).clamp(max=max(len(table) - 2, 0))
    high, share = (low + 1).clamp(max=len(table) - 1), rows - low
    reflected = torch.zeros_like(cosine)
    for j in range(4):  # a uniform cubic B-spline by its truncated powers
        away = (position - cell - (j - 1)).abs()
        weight = (2.0 - away).clamp(min=0.0) ** 3 / 6.0 - (1.0 - away).clamp(min=0.0) ** 3 * (2.0 / 3.0)
        before, after = table[low, cell + j], table[high, cell + j]
        reflected = reflected + weight * (before + share * (after - before))
    return 1.0 - reflected
