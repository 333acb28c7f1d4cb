"""Light at a dielectric surface, as pure torch functions: Snell's law and Fresnel's formulas.

``ratio`` is n_before / n_after, one for all rays or one for each. Normals have length 1 and point along the ray:
``c = d . n > 0``. Transmittances come as ``(t_s, t_p, excess)``, ``t_p - t_s`` being ``excess`` times the squared sine
before the face.
"""

import torch
from jaxtyping import Float
from torch import Tensor

Ratio = float | Float[Tensor, " n"]
_DARK = 1e-12  # transmittance below which the slope of its root no longer counts
Transmittances = tuple[Float[Tensor, " n"], Float[Tensor, " n"], Float[Tensor, " n"]]


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


def fresnel_transmittances(cosine: Float[Tensor, " n"], ratio: Ratio) -> Transmittances:
    """Transmitted shares (Born & Wolf, Principles of Optics, 1.5.2). Mask total reflection first."""
    behind = torch.sqrt(transmitted_cosine_squared(cosine, ratio))
    r_s = (ratio * cosine - behind) / (ratio * cosine + behind)
    r_p = (cosine - ratio * behind) / (cosine + ratio * behind)
    t_p = 1.0 - r_p**2
    return 1.0 - r_s**2, t_p, t_p * (behind - ratio * cosine) ** 2  # t_s / t_p is the squared cosine of the turn


def coated_transmittances(
    cosine: Float[Tensor, " n"], ratio: Ratio, table: Float[Tensor, "k m 2"], rows: Float[Tensor, " j"]
) -> Transmittances:
    """Transmitted shares at a coated face. Mask total reflection first.

    ``table``: as in :mod:`~lensforge.optics.coatings`; ``rows``: place among its rows, of each ray or of all.
    """
    behind = torch.sqrt(transmitted_cosine_squared(cosine, ratio))
    into = torch.as_tensor(ratio, dtype=cosine.dtype, device=cosine.device)
    denser = into < 1.0
    position = torch.where(denser, cosine, behind) * (table.shape[1] - 3)
    cell = position.detach().to(torch.int64).clamp(max=table.shape[1] - 4)
    low = rows.to(torch.int64).clamp(max=max(len(table) - 2, 0))
    high, share = (low + 1).clamp(max=len(table) - 1), rows - low
    found = torch.zeros(len(cosine), 2, dtype=cosine.dtype, device=cosine.device)
    for j in range(4):  # a uniform cubic B-spline by its truncated powers
        away = (position - cell - (j - 1)).abs()
        weight = (2.0 - away).clamp(min=0.0) ** 3 / 6.0 - (1.0 - away).clamp(min=0.0) ** 3 * (2.0 / 3.0)
        before, after = table[low, cell + j], table[high, cell + j]
        found = found + weight[:, None] * (before + share[:, None] * (after - before))
    excess = found[:, 1] * torch.where(denser, 1.0, into**2)
    half = 0.5 * excess * (1.0 - cosine**2)
    return 1.0 - found[:, 0] - half, 1.0 - found[:, 0] + half, excess


def unpolarised_fields(directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 2 3"]:
    """Two unit fields across each ray and each other; unpolarised light has half of its flux in either."""
    sideways = directions[:, 0].abs() < 0.9
    axes = torch.eye(3, dtype=directions.dtype, device=directions.device)
    one = torch.linalg.cross(directions, torch.where(sideways[:, None], axes[0], axes[1]))
    one = one / torch.linalg.norm(one, dim=1, keepdim=True)
    return torch.stack([one, torch.linalg.cross(directions, one)], dim=1)


def transmitted_fields(
    fields: Float[Tensor, "n 2 3"],
    before: Float[Tensor, "n 3"],
    behind: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    ratio: Ratio,
    found: Transmittances,
) -> Float[Tensor, "n 2 3"]:
    """Fields behind a face; their squared lengths are the flux that is left. ``before``, ``behind``: directions.

    Each is turned as the ray, times the root of t_s, and its part in the plane of incidence stretched to the root of
    t_p (Yun, Crabtree and Chipman, Appl. Opt. 50, 2855, 2011, for real amplitudes), with no singularity at normal
    incidence, where the plane is none: roots differ by the excess times both sines, over their sum.
    """
    root_s, root_p = (each.clamp(min=_DARK).sqrt() for each in found[:2])
    cosine, inside = (torch.sum(each * normals, dim=1, keepdim=True) for each in (before, behind))
    one, other = normals - cosine * before, normals - inside * behind  # in the plane, as long as the sines
    turn = torch.einsum("nfi,ni->nf", fields, behind) / (1.0 + torch.sum(before * behind, dim=1, keepdim=True))
    turned = fields - turn[:, :, None] * (before + behind)[:, None, :]
    stretch = (found[2] / (ratio * (root_s + root_p)))[:, None] * torch.einsum("nfi,ni->nf", fields, one)
    return root_s[:, None, None] * turned + stretch[:, :, None] * other[:, None, :]
