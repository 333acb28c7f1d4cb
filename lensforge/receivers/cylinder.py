"""A cylindrical screen around the lens, unrolled."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.kernels.landing import LEAST_RISE, cylinder, cylinder_adjoint
from lensforge.receivers.posed import Kernel, PosedReceiver
from lensforge.receivers.receiver import ReceiverKind


@dataclass(frozen=True)
class Cylinder(PosedReceiver):
    """The cylinder of ``radius_mm`` about the pose's y axis: arc length from its z axis, and height (mm)."""

    radius_mm: float = field(kw_only=True)  # type: ignore[misc]  # of planes it has no meaning

    kind: ClassVar[ReceiverKind] = "cylinder"
    kernels: ClassVar[tuple[Kernel, Kernel]] = (cylinder, cylinder_adjoint)

    def _paths(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        flat, across = points[:, ::2], directions[:, ::2]
        square, half = (across**2).sum(dim=1), (flat * across).sum(dim=1)
        root = half**2 - square * ((flat**2).sum(dim=1) - self.radius_mm**2)
        paths: Float[Tensor, " n"] = (root.clamp(min=0.0).sqrt() - half) / square
        return paths

    def _reached(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        across = directions[:, ::2].norm(dim=1)
        reached: Bool[Tensor, " n"] = (across > LEAST_RISE) & (self._paths(points, directions) > 0.0)
        return reached

    def _chart(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 2"]:
        ends = points + self._paths(points, directions)[:, None] * directions
        return torch.stack([self.radius_mm * torch.atan2(ends[:, 0], ends[:, 2]), ends[:, 1]], dim=1)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        angle = x / self.radius_mm
        return np.stack([self.radius_mm * np.sin(angle), y, self.radius_mm * np.cos(angle)], axis=-1)
