"""The far field: intensity by direction, on a chart of equal solid angles, so that pixels are candela."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.kernels.landing import POLE, far_field, far_field_adjoint
from lensforge.receivers.posed import Kernel, PosedReceiver, equal_area, from_equal_area
from lensforge.receivers.receiver import ReceiverKind


@dataclass(frozen=True)
class FarField(PosedReceiver):
    """Directions about the pose's z axis, on Lambert's azimuthal equal-area chart: at a radius of 2 sin(gamma / 2).

    Where a ray starts does not count: the lens is a point, seen from far away.
    """

    kind: ClassVar[ReceiverKind] = "far_field"
    kernels: ClassVar[tuple[Kernel, Kernel]] = (far_field, far_field_adjoint)

    @property
    def pixel_measure(self) -> float:
        """Solid angle of a pixel in sr, so that flux (W) over it is intensity (W/sr)."""
        width, height = self.grid.pixel
        return width * height

    def _reached(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        return 1.0 + directions[:, 2] > POLE

    def _chart(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 2"]:
        return equal_area(directions)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        return from_equal_area(x, y)

    def target_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Degrees from the axis along x and y: gamma times the cosine and the sine of the azimuth."""
        radius = np.hypot(x, y)
        scale = np.degrees(2.0 * np.arcsin(np.minimum(0.5 * radius, 1.0))) / np.where(radius > 0.0, radius, np.inf)
        return scale * x, scale * y

    def chart_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Chart of degrees from the axis along x and y."""
        gamma = np.hypot(x, y)
        scale = 2.0 * np.sin(0.5 * np.radians(gamma)) / np.where(gamma > 0.0, gamma, np.inf)
        return scale * x, scale * y


def chart_radius(gamma_deg: float) -> float:
    """Radius on the chart of the directions at an angle from the axis."""
    return 2.0 * float(np.sin(0.5 * np.radians(gamma_deg)))
