"""The plane receiver, in any pose outside the lens; every ray with a component along its normal reaches its plane."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.kernels.landing import LEAST_RISE, plane, plane_adjoint
from lensforge.receivers.posed import Kernel, PosedReceiver
from lensforge.receivers.receiver import ReceiverKind


@dataclass(frozen=True)
class Plane(PosedReceiver):
    """A rectangle in the plane of the pose's x and y axes (mm), about its centre."""

    kind: ClassVar[ReceiverKind] = "plane"
    kernels: ClassVar[tuple[Kernel, Kernel]] = (plane, plane_adjoint)

    def _reached(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        return directions[:, 2] > LEAST_RISE

    def _chart(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 2"]:
        reached = points - (points[:, 2] / directions[:, 2])[:, None] * directions
        return reached[:, :2]

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        return np.stack([x, y, np.zeros_like(x)], axis=-1)
