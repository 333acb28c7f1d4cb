"""The twin of the fused path in plain torch: the same tables, bounds and search, on any device that torch knows."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import InputError
from lensforge.sources.bundle import RayBundle
from lensforge.tracing.device_search import first_crossing
from lensforge.tracing.device_table import DeviceTable
from lensforge.tracing.exit_rays import ExitRays
from lensforge.tracing.fused import Scene, checked_bounds
from lensforge.tracing.sequence import Crossing, TensorRays, trace_sequence


@dataclass
class TableSurface:
    """A table as the sequential pass sees it."""

    table: DeviceTable

    def first_crossing(self, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Crossing:
        """Of rays from inside, at z >= 0; without a gradient."""
        return first_crossing(self.table, origins, directions)

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|`` (mm), Eq. (5): positive inside."""
        r = torch.linalg.norm(points, dim=1)
        shift = (r + points[:, 2]).clamp(min=torch.finfo(points.dtype).tiny)
        gap: Tensor = self.table.value_and_slope(points[:, 0] / shift, points[:, 1] / shift)[0] - r
        return gap

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        x, y, z = points.unbind(dim=1)
        r = torch.linalg.norm(points, dim=1)
        per_shift = 1.0 / (r + z)
        _, rho_x, rho_y = self.table.value_and_slope(x * per_shift, y * per_shift)
        radial = (rho_x * x + rho_y * y) * per_shift * per_shift
        along = (1.0 + radial) / r
        return torch.stack((x * along - rho_x * per_shift, y * along - rho_y * per_shift, z * along + radial), dim=1)


def tables_on(
    device: torch.device, inner: Float[Tensor, "side side"], outer: Float[Tensor, "side side"], scene: Scene
) -> tuple[DeviceTable, DeviceTable]:
    """Both tables and their bounds on ``device``. Raises :class:`InputError` for a radius that is not positive."""
    bounds = checked_bounds(inner, outer, scene)
    first, second = (
        DeviceTable.of(table, scene.grid, bound, device) for table, bound in zip((inner, outer), bounds, strict=True)
    )
    return first, second


def trace_on_device(
    device: torch.device,
    inner: Float[Tensor, "side side"],
    outer: Float[Tensor, "side side"],
    scene: Scene,
    rays: RayBundle,
) -> ExitRays:
    """What :func:`~lensforge.tracing.fused.trace_tables` returns, on ``device``; differentiable in both tables."""
    first, second = (TableSurface(table) for table in tables_on(device, inner, outer, scene))
    on_device = TensorRays.of(rays, scene.refractive_index, torch.float64, device)
    return trace_sequence(first, second, on_device, scene.fresnel)


def search_device(name: str) -> torch.device | None:
    """The device of the twin, by name; None for ``cpu``, where the kernels trace.

    Raises :class:`InputError` where torch does not find it.
    """
    if name == "cpu":
        return None
    if name != "cuda" or not torch.cuda.is_available():
        raise InputError(
            f"--device {name}: torch {torch.__version__} finds no such device; allowed here: cpu; "
            "for an NVIDIA GPU install a CUDA build of torch"
        )
    return torch.device(name)
