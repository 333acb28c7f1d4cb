"""A sum of SRBFs in plain torch: differentiable, and with none of the program's compiled sums."""

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.light.reference_hits import ExactFace, TracedFace
from lensforge.surfaces.mirror_group import group
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

_CHUNK_VALUES = 2**22  # rays times basis functions at a time: some 300 MB


@dataclass(frozen=True)
class ExactSurface:
    """``rho(u) = h + sum_j w_j exp(-g^2/sigma_j^2)``, Eq. (2), differentiable in ``weights_mm`` and ``offset_mm``."""

    basis: SrbfBasis
    weights_mm: Float[Tensor, " m"]
    offset_mm: Float[Tensor, ""]

    @staticmethod
    def of(surface: SrbfSurface, requires_grad: bool = False) -> "ExactSurface":
        """The same sum; its parameters as leaves where a gradient is wanted."""
        weights, offset = (
            torch.tensor(value, dtype=torch.float64, requires_grad=requires_grad)
            for value in (surface.weights_mm, surface.offset_mm)
        )
        return ExactSurface(surface.basis, weights, offset)

    @cached_property
    def _constants(self) -> tuple[Tensor, Tensor, list[Tensor]]:
        like = self.weights_mm
        centres = torch.as_tensor(self.basis.centres, dtype=like.dtype, device=like.device)
        sigmas = torch.as_tensor(self.basis.sigmas, dtype=like.dtype, device=like.device)
        images = [torch.as_tensor(m, dtype=like.dtype, device=like.device) for m in group(self.basis.symmetry)]
        return centres, sigmas, images

    def radius(self, directions: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``rho`` (mm); the angle g comes from the chord, which is exact at a centre."""
        return torch.cat([self._radius(some) for some in directions.split(self._rows)])

    def gradient(self, directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Tangential gradient on the unit sphere (mm/rad)."""
        return torch.cat([self._gradient(some) for some in directions.split(self._rows)])

    @property
    def _rows(self) -> int:
        return max(1, _CHUNK_VALUES // self.basis.size)

    def _radius(self, directions: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        centres, sigmas, images = self._constants
        total = self.offset_mm.expand(len(directions))
        for image in images:
            chord = torch.cdist(directions @ image, centres, compute_mode="donot_use_mm_for_euclid_dist")
            angle = 2.0 * torch.asin(torch.clamp(0.5 * chord, max=1.0))
            total = total + torch.exp(-((angle / sigmas) ** 2)) @ self.weights_mm / len(images)
        return total

    def _gradient(self, directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        centres, sigmas, images = self._constants
        total = torch.zeros_like(directions)
        for image in images:
            turned = directions @ image
            cosine = turned @ centres.T
            tangent = centres[None] - cosine[..., None] * turned[:, None]  # from u to the centre; length sin g
            sine = torch.linalg.norm(tangent, dim=-1)
            angle = torch.atan2(sine, cosine)
            ratio = torch.where(sine > 1e-9, angle / torch.where(sine > 1e-9, sine, 1.0), 1.0)
            slope = self.weights_mm * 2.0 * ratio / sigmas**2 * torch.exp(-((angle / sigmas) ** 2))
            total = total + torch.einsum("nm,nmk->nk", slope, tangent) @ image.T / len(images)
        return total

    def face(self, guide: TracedFace | None = None) -> ExactFace:
        """The face of the reference tracer; twice the largest radius that the sum can have is its reach."""
        reach = 2.0 * float((self.offset_mm + self.weights_mm.abs().sum()).detach())
        return ExactFace(self.radius, self.gradient, reach, guide)
