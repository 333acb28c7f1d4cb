"""ReceiverPose of a receiver: its centre, and its axes by a normal and a turn about it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class ReceiverPose:
    """A right-handed frame in the lens's coordinates: ``centre_mm``, and its unit axes x, y, z as ``rows``."""

    centre_mm: tuple[float, float, float]
    rows: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

    @staticmethod
    def facing(
        direction: tuple[float, float, float], centre_mm: tuple[float, float, float], rotation_deg: float = 0.0
    ) -> "ReceiverPose":
        """The frame whose z axis is ``direction``: the lens's own, tilted the shortest way, then turned about it.

        A direction along -z, to which all ways are as short, is reached about the y axis.
        """
        z = np.array(direction) / np.linalg.norm(direction)
        axes = _shortest(z) if rotation_deg == 0.0 else _turn(rotation_deg) @ _shortest(z)
        x, y, z = ((float(row[0]), float(row[1]), float(row[2])) for row in axes)
        return ReceiverPose(centre_mm, (x, y, z))

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """The unit axes x, y, z as rows."""
        return np.array(self.rows)

    def packed(self) -> Float[np.ndarray, "4 3"]:
        """Centre and axes in one array, as the kernels take them."""
        return np.array([self.centre_mm, *self.rows])


def _shortest(z: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Rows x, y, z of the lens's frame after the shortest rotation that takes its z axis to ``z`` (Rodrigues)."""
    if z[2] <= -1.0 + 1e-12:
        return np.diag([-1.0, 1.0, -1.0])
    cross = np.array([[0.0, 0.0, z[0]], [0.0, 0.0, z[1]], [-z[0], -z[1], 0.0]])
    rotation: Float[np.ndarray, "3 3"] = np.eye(3) + cross + cross @ cross / (1.0 + z[2])
    return rotation.T


def _turn(degrees: float) -> Float[np.ndarray, "3 3"]:
    """Rows of a frame turned about its z axis, from x towards y; quarter turns are exact."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    if degrees % 90.0 == 0.0:
        cosine, sine = round(cosine), round(sine)
    return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
