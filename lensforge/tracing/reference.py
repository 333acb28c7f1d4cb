"""The readable tracer: the paper's exact SRBF sum, in plain torch, on any device; the oracle of the fused path.

It shares no surface, intersection or refraction code with the kernels. First crossings are bracketed by a dense
scan, closed in on by bisection, and made differentiable by one undamped Newton step (the implicit formula, Eq. 9).
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.optics.dielectric import fresnel_transmittance, refract, transmitted_cosine_squared
from lensforge.sources.bundle import RayBundle
from lensforge.surfaces.srbf import SrbfBasis
from lensforge.surfaces.symmetry import group
from lensforge.tracing.arrivals import Arrivals
from lensforge.tracing.fates import Fate
from lensforge.tracing.trace_kernel import LEAST_RISE


@dataclass(frozen=True)
class Search:
    """How a crossing is found: ``scan_steps`` over the reach bracket it, ``bisections`` close in on it.

    What is left is ``reach / scan_steps / 2^bisections``; the Newton step that follows squares it.
    """

    scan_steps: int = 256
    bisections: int = 60


_THOROUGH = Search()


@dataclass(frozen=True)
class ExactSurface:
    """``rho(u) = h + sum_j w_j exp(-g^2/sigma_j^2)``, Eq. (2), differentiable in ``weights`` and ``offset`` (mm)."""

    basis: SrbfBasis
    weights: Float[Tensor, " m"]
    offset: Float[Tensor, ""]

    def _constants(self) -> tuple[Tensor, Tensor, list[Tensor]]:
        like = self.weights
        centres = torch.as_tensor(self.basis.centres, dtype=like.dtype, device=like.device)
        sigmas = torch.as_tensor(self.basis.sigmas, dtype=like.dtype, device=like.device)
        images = [torch.as_tensor(m, dtype=like.dtype, device=like.device) for m in group(self.basis.symmetry)]
        return centres, sigmas, images

    def radius(self, directions: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``rho`` (mm); the angle g comes from the chord, which is exact at a centre."""
        centres, sigmas, images = self._constants()
        total = self.offset
        for image in images:
            chord = torch.cdist(directions @ image, centres, compute_mode="donot_use_mm_for_euclid_dist")
            angle = 2.0 * torch.asin(torch.clamp(0.5 * chord, max=1.0))
            total = total + torch.exp(-((angle / sigmas) ** 2)) @ self.weights / len(images)
        return total

    def gradient(self, directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Tangential gradient on the unit sphere (mm/rad)."""
        centres, sigmas, images = self._constants()
        total = torch.zeros_like(directions)
        for image in images:
            turned = directions @ image
            cosine = turned @ centres.T
            across = centres[None] - cosine[..., None] * turned[:, None]  # points from u to the centre; length sin g
            sine = torch.linalg.norm(across, dim=-1)
            angle = torch.atan2(sine, cosine)
            ratio = torch.where(sine > 1e-9, angle / torch.where(sine > 1e-9, sine, 1.0), 1.0)
            pull = self.weights * 2.0 * ratio / sigmas**2 * torch.exp(-((angle / sigmas) ** 2))
            total = total + torch.einsum("nm,nmk->nk", pull, across) @ image.T / len(images)
        return total

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)`` at ``points``: away from the origin, not normalised."""
        distance = torch.linalg.norm(points, dim=1, keepdim=True)
        directions = points / distance
        return directions - self.gradient(directions) / distance

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|``, Eq. (5): positive inside."""
        distance = torch.linalg.norm(points, dim=1)
        return self.radius(points / distance.clamp(min=1e-300)[:, None]) - distance


def first_crossing(
    surface: ExactSurface,
    origins: Float[Tensor, "n 3"],
    directions: Float[Tensor, "n 3"],
    reach: float,
    search: Search = _THOROUGH,
) -> tuple[Float[Tensor, " n"], Bool[Tensor, " n"]]:
    """Path length to the first sign change of F within ``reach``, and whether there is one; no gradient."""
    with torch.no_grad():
        low = torch.zeros_like(origins[:, 0])
        high = torch.full_like(low, reach)
        found = torch.zeros_like(low, dtype=torch.bool)
        for step in range(1, search.scan_steps + 1):
            here = reach * step / search.scan_steps
            outside = surface.gap(origins + here * directions) < 0.0
            high = torch.where(outside & ~found, here, high)
            found |= outside
            low = torch.where(found, low, here)
        for _ in range(search.bisections):
            middle = 0.5 * (low + high)
            inside = surface.gap(origins + middle[:, None] * directions) > 0.0
            low, high = torch.where(inside, middle, low), torch.where(inside, high, middle)
        return 0.5 * (low + high), found


def _differentiable_hit(
    surface: ExactSurface, origins: Tensor, directions: Tensor, lengths: Tensor
) -> tuple[Tensor, Tensor]:
    """The hit and its unit normal, with the derivative of the implicit function: one undamped Newton step."""
    with torch.no_grad():
        points = origins + lengths[:, None] * directions
        slope = -torch.sum(surface.normal(points) * directions, dim=1)
    points = origins + lengths[:, None] * directions
    exact = lengths - surface.gap(points) / slope
    points = origins + exact[:, None] * directions
    normals = surface.normal(points)
    return points, normals / torch.linalg.norm(normals, dim=1, keepdim=True)


def trace_exact(
    inner: ExactSurface,
    outer: ExactSurface,
    refractive_index: float,
    distance_mm: float,
    rays: RayBundle,
    search: Search = _THOROUGH,
) -> Arrivals:
    """Trace ``rays`` through the exact surfaces; differentiable in their weights and offsets.

    Slow by design: every ray sees every function about 600 times. Rays start inside of the cavity at z >= 0; those
    with an index of their own keep it.
    """
    like = inner.weights
    origins, directions, weights = (
        torch.as_tensor(array, dtype=like.dtype, device=like.device)
        for array in (rays.origins, rays.directions, rays.weights)
    )
    count = len(weights)
    own = rays.refractive_indices
    index = torch.full_like(weights, refractive_index) if own is None else torch.as_tensor(own).to(weights)
    fates = torch.full((count,), int(Fate.ARRIVED), dtype=torch.int8, device=like.device)
    carried, sines = weights.clone(), torch.zeros_like(weights)
    hits = torch.zeros_like(origins[:, :2])
    alive = torch.arange(count, device=like.device)
    for surface, ratios, is_outer in ((inner, 1.0 / index, False), (outer, index, True)):
        ratio = ratios[alive]
        reach = 2.0 * float(surface.offset.detach() + surface.weights.detach().abs().sum())
        lengths, found = first_crossing(surface, origins, directions, reach, search)
        points, normals = _differentiable_hit(surface, origins, directions, lengths)
        found = found & (points[:, 2].detach() >= 0.0)
        fates[alive[~found]] = int(Fate.BASE)
        cosine = torch.sum(directions * normals, dim=1)
        behind_squared = transmitted_cosine_squared(cosine, ratio)
        if is_outer:
            sines = sines.index_put((alive[found],), 1.0 - behind_squared[found])
        passes = found & (behind_squared.detach() > 0.0) & (cosine.detach() > 0.0)
        fates[alive[found & ~passes]] = int(Fate.TOTAL_REFLECTION)
        alive, cosine, ratio = alive[passes], cosine[passes], ratio[passes]
        origins, directions = points[passes], refract(directions[passes], normals[passes], ratio)
        carried = carried.index_put((alive,), carried[alive] * fresnel_transmittance(cosine, ratio))
    forward = directions[:, 2].detach() > LEAST_RISE
    fates[alive[~forward]] = int(Fate.AVERTED)
    alive, origins, directions = alive[forward], origins[forward], directions[forward]
    reached = origins + ((distance_mm - origins[:, 2]) / directions[:, 2])[:, None] * directions
    hits = hits.index_put((alive,), reached[:, :2])
    return Arrivals(hits, carried, sines, fates)
