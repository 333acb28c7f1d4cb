"""R, theta, Z on rings about the axis, for turning with a slow or fast tool servo, with its interpolation error.

The rings are even in the polar angle as seen from the origin, not in R: a face that stands upright at its rim is
covered down to the rim. On a meridian R and Z are both functions of that angle, and both are interpolated, as the axes
of the machine are from one block to the next.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.drawings.interpolation import BEYOND, Interpolation, halfway
from lensforge.drawings.offset_face import OffsetFace, Plane
from lensforge.errors import InputError
from lensforge.surfaces.chart import to_chart

_RIM_SAMPLES = 1440
_MOST_STEP_DEG = 6.0  # the ring or two that the interpolation needs below the rim must lie on the spline of the face


@dataclass(frozen=True)
class Polar:
    """Rings ``step_deg`` apart (polar angle), the first the apex, each of even azimuths; [ring, azimuth, (R, Z)] in mm.

    ``normals``: unit vectors from the material into the air at the same nodes, as x, y, z.
    ``rim``: number of the ring at the lowest point of the rim; rings beyond it are run-out.
    """

    face: OffsetFace
    step_deg: float
    rim: int
    azimuths_deg: Float[np.ndarray, " m"]
    values: Float[np.ndarray, "n m 2"]
    normals: Float[np.ndarray, "n m 3"]

    @property
    def rows(self) -> Float[np.ndarray, "k 4"]:
        """Polar angle and azimuth (degrees), R and Z (mm) of each node; the apex once."""
        rings, turns = self.values.shape[:2]
        polar, azimuth = np.meshgrid(self.step_deg * np.arange(rings), self.azimuths_deg, indexing="ij")
        rows = np.concatenate([np.stack([polar, azimuth], axis=-1), self.values], axis=-1).reshape(-1, 4)
        return np.concatenate([rows[:1], rows[turns:]])

    @property
    def cloud(self) -> Float[np.ndarray, "k 6"]:
        """x, y, z (mm) and unit normal of each node without the run-out, the apex once."""
        turn, on_face = np.radians(self.azimuths_deg), self.values[: self.rim + 1]
        r, z = on_face[..., 0], on_face[..., 1]
        rows = np.concatenate(
            [np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1), self.normals[: self.rim + 1]], -1
        )
        return np.concatenate([rows[0, :1], rows[1:].reshape(-1, 6)])

    @property
    def spacing_mm(self) -> float:
        """Largest distance (mm) between neighbouring nodes, along a meridian or around a ring."""
        along = np.linalg.norm(np.diff(self.values, axis=0), axis=-1).max()
        around = self.values[..., 0].max() * np.radians(self.azimuths_deg[1])
        return float(max(along, around))

    def errors_nm(self, scheme: Interpolation, most: int) -> Float[np.ndarray, " k"]:
        """Error of the interpolation along the normal in the middle of cells and sides; of at most ``most`` of them."""
        middles = self._middles(scheme)
        middles = middles[:: max(1, -(-len(middles) // most))]
        azimuth = np.radians(middles[:, 1])
        centres, normals = self.face.found(_on_chart(middles[:, :2]), to_chart)
        across, up = middles[:, 2] - np.linalg.norm(centres[:, :2], axis=1), middles[:, 3] - centres[:, 2]
        outwards = normals[:, 0] * np.cos(azimuth) + normals[:, 1] * np.sin(azimuth)
        error: Float[np.ndarray, " k"] = 1e6 * np.abs(across * outwards + up * normals[:, 2])
        return error

    def _middles(self, scheme: Interpolation) -> Float[np.ndarray, "k 4"]:
        """Polar angle, azimuth, and interpolated R and Z in the middle of every cell and side up to the rim."""
        beyond, turns = BEYOND[scheme], len(self.azimuths_deg)
        # The ring before the first is the first one seen from the other side; the azimuths go around.
        before = np.roll(self.values[1 : 1 + beyond], turns // 2, axis=1) * [-1.0, 1.0]
        rings = np.concatenate([before, self.values])
        along = halfway(rings, 0, scheme)[: self.rim]
        around = halfway(_wrapped(self.values[: self.rim + 1], beyond), 1, scheme)
        both = halfway(_wrapped(along, beyond), 1, scheme)
        at = self.step_deg * np.arange(self.rim + 1)
        half_ring, half_turn = at[:-1] + 0.5 * self.step_deg, self.azimuths_deg + 0.5 * self.azimuths_deg[1]
        found = []
        for polar, azimuth, values in (
            (half_ring, self.azimuths_deg, along),
            (at[1:], half_turn, around[1:]),
            (half_ring, half_turn, both),
        ):
            angles = np.stack(np.meshgrid(polar, azimuth, indexing="ij"), axis=-1)
            found.append(np.concatenate([angles, values], axis=-1).reshape(-1, 4))
        return np.concatenate(found)


def _wrapped(values: Float[np.ndarray, "n m 2"], beyond: int) -> Float[np.ndarray, "n k 2"]:
    turns = values.shape[1]
    return values.take(range(-beyond, turns + 1 + beyond), axis=1, mode="wrap")


def polar_end_deg(face: OffsetFace) -> float:
    """Polar angle (degrees) of the lowest centre over the rim.

    Raises :class:`InputError` where the centres do not surround the origin, as with a large ball in a flat cavity.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, _RIM_SAMPLES, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    centres, normals = face.at(np.concatenate([rim, [[0.0, 0.0, 1.0]]]))
    nearest = float((face.air * np.sum(centres * normals, axis=1)).min())
    if nearest <= 0.0:
        raise InputError(
            f"offset of the {face.name} face = {face.offset_mm:g} mm: the ball's centres do not surround the origin, "
            f"about which the polar table is made; give one that is smaller by more than {-nearest:.4g} mm"
        )
    return float(np.degrees(np.arctan2(np.linalg.norm(centres[:-1, :2], axis=1), centres[:-1, 2])).max())


def make_polar(face: OffsetFace, end_deg: float, spacing_mm: float, scheme: Interpolation) -> Polar:
    """Rings and azimuths about ``spacing_mm`` apart at the widest, and the run-out that the interpolation needs."""
    size = float(np.linalg.norm(face.at(_RIM_AND_APEX)[0], axis=1).max())
    rim = max(int(np.ceil(end_deg / _MOST_STEP_DEG)), int(np.ceil(np.radians(end_deg) * size / spacing_mm)))
    turns = 2 * max(4, int(np.ceil(np.pi * size / spacing_mm)))
    step, azimuths = end_deg / rim, 360.0 / turns * np.arange(turns)
    rings = step * np.arange(1, rim + 1 + BEYOND[scheme])
    angles = np.stack(np.meshgrid(rings, azimuths, indexing="ij"), axis=-1).reshape(-1, 2)
    centres, normals = face.found(_on_chart(angles), to_chart)
    ring_values = np.stack([np.linalg.norm(centres[:, :2], axis=1), centres[:, 2]], axis=-1)
    (apex,), upright = face.found(np.zeros((1, 2)), to_chart)
    values = np.concatenate([np.tile([0.0, apex[2]], (1, turns, 1)), ring_values.reshape(len(rings), turns, 2)])
    vectors = np.concatenate([np.tile(upright, (1, turns, 1)), normals.reshape(len(rings), turns, 3)])
    return Polar(face, step, rim, azimuths, values, vectors)


_RIM_AND_APEX = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])


def _on_chart(angles_deg: Plane) -> Plane:
    """Stereographic coordinates of polar angle and azimuth."""
    polar, azimuth = np.radians(angles_deg).T
    chart: Plane = np.tan(0.5 * polar)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    return chart
