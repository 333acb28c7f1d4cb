"""A spherical screen around the lens, as a dome has; on a chart that keeps areas."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.kernels.landing import POLE, sphere, sphere_adjoint
from lensforge.receivers.posed import Kernel, PosedReceiver, equal_area, from_equal_area
from lensforge.receivers.receiver import ReceiverKind


@dataclass(frozen=True)
class Dome(PosedReceiver):
    """The sphere of ``radius_mm`` about the pose's centre, charted (mm) about its z axis; the lens is inside."""

    radius_mm: float = field(kw_only=True)  # type: ignore[misc]  # of planes it has no meaning

    kind: ClassVar[ReceiverKind] = "sphere"
    kernels: ClassVar[tuple[Kernel, Kernel]] = (sphere, sphere_adjoint)

    def _paths(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        half = (points * directions).sum(dim=1)
        root = half**2 - (points**2).sum(dim=1) + self.radius_mm**2
        return root.clamp(min=0.0).sqrt() - half

    def _reached(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        paths = self._paths(points, directions)
        return (paths > 0.0) & (1.0 + (points[:, 2] + paths * directions[:, 2]) / self.radius_mm > POLE)

    def _chart(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 2"]:
        ends = points + self._paths(points, directions)[:, None] * directions
        return self.radius_mm * equal_area(ends / self.radius_mm)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        return self.radius_mm * from_equal_area(x / self.radius_mm, y / self.radius_mm)
