"""The fast path: the fused kernels on all cores, differentiable with respect to the two tables."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.bundle import RayBundle
from lensforge.surfaces.spline import TableGrid
from lensforge.tracing.adjoint_kernel import trace_adjoint
from lensforge.tracing.arrivals import Arrivals
from lensforge.tracing.bounds_kernel import SurfaceBounds, surface_bounds
from lensforge.tracing.chunks import CHUNKS, in_chunks
from lensforge.tracing.trace_kernel import trace


@dataclass(frozen=True)
class Scene:
    """What a ray meets besides the surfaces: the index of the body, the receiver's plane; and the tables' grid.

    Without ``fresnel`` both surfaces let all light through that they do not reflect totally.
    """

    refractive_index: float
    distance_mm: float
    grid: TableGrid
    fresnel: bool = True

    def packed(self) -> tuple[float, bool, float, float]:
        """The four numbers that the kernels take."""
        return self.distance_mm, self.fresnel, self.grid.origin, 1.0 / self.grid.step

    def indices(self, rays: RayBundle) -> Float[np.ndarray, " k"]:
        """The body's refractive index for each ray where they differ, or one for all."""
        own = rays.refractive_indices
        return np.array([self.refractive_index]) if own is None else own


def _part(indices: Float[np.ndarray, " k"], part: slice) -> Float[np.ndarray, " j"]:
    return indices if len(indices) == 1 else indices[part]


class _Trace(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, inner: torch.Tensor, outer: torch.Tensor, scene: Scene, rays: RayBundle) -> Any:
        bounds = checked_bounds(inner, outer, scene)
        tables = [table.detach().numpy() for table in (inner, outer)]
        count, indices = len(rays), scene.indices(rays)
        lengths, hits = np.empty((count, 2)), np.empty((count, 2))
        carried, sines, fates = np.empty(count), np.empty(count), np.empty(count, dtype=np.int8)

        def work(_: int, part: slice) -> None:
            trace(
                rays.origins[part], rays.directions[part], rays.weights[part], _part(indices, part),
                *tables, *bounds, scene.packed(),
                lengths[part], hits[part], carried[part], sines[part], fates[part],
            )  # fmt: skip

        in_chunks(work, count)
        ctx.save_for_backward(inner, outer)
        ctx.scene, ctx.rays, ctx.lengths, ctx.fates = scene, rays, lengths, fates
        outputs = tuple(torch.from_numpy(array) for array in (hits, carried, sines, fates))
        ctx.mark_non_differentiable(outputs[3])
        return outputs

    @staticmethod
    def backward(ctx: Any, by_hits: torch.Tensor, by_carried: torch.Tensor, by_sines: torch.Tensor, _: Any) -> Any:
        inner, outer = (table.numpy() for table in ctx.saved_tensors)
        gradients = np.zeros((2, CHUNKS, *inner.shape))
        by = [tensor.contiguous().numpy() for tensor in (by_hits, by_carried, by_sines)]
        rays: RayBundle = ctx.rays
        indices = ctx.scene.indices(rays)

        def work(chunk: int, part: slice) -> None:
            trace_adjoint(
                rays.origins[part], rays.directions[part], rays.weights[part], _part(indices, part),
                inner, outer, ctx.scene.packed(),
                ctx.lengths[part], ctx.fates[part], *(array[part] for array in by), *gradients[:, chunk],
            )  # fmt: skip

        in_chunks(work, len(rays))
        total = torch.from_numpy(gradients.sum(axis=1))
        return total[0], total[1], None, None


def checked_bounds(
    inner: Float[torch.Tensor, "side side"], outer: Float[torch.Tensor, "side side"], scene: Scene
) -> tuple[SurfaceBounds, SurfaceBounds]:
    """The bounds of both tables. Raises :class:`InputError` when a surface has a radius that is not positive."""
    first, second = (
        surface_bounds(table.detach().numpy(), scene.grid.origin, scene.grid.step) for table in (inner, outer)
    )
    for name, bound in (("inner", first), ("outer", second)):
        if not (bound.least > 0.0 and np.isfinite(bound.most) and np.isfinite(bound.tiles).all()):
            raise InputError(
                f"{name} surface: its radius falls to {bound.least:.3g} mm; it must stay above 0: "
                f"lower optimise.learning_rate, or raise lens.{name}_offset_mm"
            )
    return first, second


def trace_tables(inner: torch.Tensor, outer: torch.Tensor, scene: Scene, rays: RayBundle) -> Arrivals:
    """Trace ``rays`` through two tables (side, side), float64 on the CPU; differentiable in both tables.

    The flux that a lost ray carried counts as a constant. Raises :class:`InputError` when a surface has a radius that
    is not positive.
    """
    return Arrivals(*_Trace.apply(inner, outer, scene, rays))
