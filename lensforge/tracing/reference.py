"""The readable tracer: the paper's exact SRBF sum, in plain torch, on any device; the oracle of the fused path.

It shares no surface, intersection or refraction code with the kernels, and neither of the first two with the tables on
other devices. First crossings are bracketed by a dense scan and closed in on by bisection.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.sources.bundle import RayBundle
from lensforge.surfaces.srbf import SrbfBasis
from lensforge.surfaces.symmetry import group
from lensforge.tracing.exit_rays import ExitRays
from lensforge.tracing.sequence import Crossing, TensorRays, trace_sequence


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
    search: Search = _THOROUGH

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
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        distance = torch.linalg.norm(points, dim=1, keepdim=True)
        directions = points / distance
        normal: Tensor = directions - self.gradient(directions) / distance
        return normal

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|`` (mm), Eq. (5): positive inside."""
        distance = torch.linalg.norm(points, dim=1)
        gap: Tensor = self.radius(points / distance.clamp(min=torch.finfo(points.dtype).tiny)[:, None]) - distance
        return gap

    def first_crossing(self, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Crossing:
        """The first sign change of F within reach of the surface; no search is ever given up."""
        with torch.no_grad():
            reach = 2.0 * float(self.offset + self.weights.abs().sum())
            low = torch.zeros_like(origins[:, 0])
            high = torch.full_like(low, reach)
            found = torch.zeros_like(low, dtype=torch.bool)
            for step in range(1, self.search.scan_steps + 1):
                here = reach * step / self.search.scan_steps
                outside = self.gap(origins + here * directions) < 0.0
                high = torch.where(outside & ~found, here, high)
                found |= outside
                low = torch.where(found, low, here)
            for _ in range(self.search.bisections):
                middle = 0.5 * (low + high)
                inside = self.gap(origins + middle[:, None] * directions) > 0.0
                low, high = torch.where(inside, middle, low), torch.where(inside, high, middle)
            return Crossing(0.5 * (low + high), found, torch.zeros_like(found))


def trace_exact(inner: ExactSurface, outer: ExactSurface, refractive_index: float, rays: RayBundle) -> ExitRays:
    """Trace ``rays`` through the exact surfaces; differentiable in their weights and offsets.

    Slow by design: every ray sees every function about 600 times. Rays with an index of their own keep it.
    """
    like = inner.weights
    return trace_sequence(inner, outer, TensorRays.of(rays, refractive_index, like.dtype, like.device))
