"""Light at a dielectric surface, as pure torch functions: Snell's law and Fresnel's formulas, unpolarised.

``ratio`` is n_before / n_after. Normals have length 1 and point along the ray: ``c = d . n > 0``.
"""

import torch
from jaxtyping import Float
from torch import Tensor


def transmitted_sine_squared(cosine: Float[Tensor, " n"], ratio: float) -> Float[Tensor, " n"]:
    """Squared sine behind the surface by Snell's law; 1 and above means total reflection."""
    return ratio**2 * (1.0 - cosine**2)


def refract(directions: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"], ratio: float) -> Float[Tensor, "n 3"]:
    """Unit directions behind the surface (vector form of Snell's law). Mask totally reflected rays first."""
    cosine = torch.sum(directions * normals, dim=1, keepdim=True)
    behind = torch.sqrt(1.0 - ratio**2 * (1.0 - cosine**2))
    return ratio * directions + (behind - ratio * cosine) * normals


def fresnel_transmittance(cosine: Float[Tensor, " n"], ratio: float) -> Float[Tensor, " n"]:
    """Transmitted share of unpolarised flux (Born & Wolf, Principles of Optics, 1.5.2). Mask total reflection first."""
    behind = torch.sqrt(1.0 - ratio**2 * (1.0 - cosine**2))
    senkrecht = (ratio * cosine - behind) / (ratio * cosine + behind)
    parallel = (cosine - ratio * behind) / (cosine + ratio * behind)
    return 1.0 - 0.5 * (senkrecht**2 + parallel**2)


def normal_transmittance(refractive_index: float) -> float:
    """Transmittance of one surface at normal incidence; two of them bound a lens's efficiency, 0.923 for PMMA."""
    return 1.0 - ((refractive_index - 1.0) / (refractive_index + 1.0)) ** 2
