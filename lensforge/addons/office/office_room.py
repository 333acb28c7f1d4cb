"""Lamps of a standard room as they glare, and the light of its walls: CIE 117:1995, and the tables of CIE 190:2010.

Lengths are in heights H of the lamps above the eyes. The eye is in the middle of a wall, and looks along the room:
``ahead`` of it lamps stand from half a step to the other wall, ``aside`` on both sides. Direct light on the plane of
the eyes is that of the cone factors of CIE 190. What then is reflected follows from three surfaces, each evenly lit:
with the form factor of two equal rectangles this gives the transfer factors of CIE 190 to their three digits.

The cone factors are those of the package eulumdat-ugr 1.0.2, and so is the table of the position index: the standards
were not at hand.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.addons.office.office_section import OfficeSection
from lensforge.scene.intensity_limit import CandelaSum
from lensforge.scene.measuring_grid import measuring_grid

_POSITION_INDEX = Path(__file__).with_name("position_index.csv")
_MOST_ASIDE = 3.0  # over the distance ahead
_LAST_DEG = 85.0  # of gamma, by which lamps glare
# Directions in which the flux is summed.
_GAMMA_STEP_DEG = 1.0
_C_STEP_DEG = 15.0
_CONES_DEG = np.degrees(np.arccos([0.75, 0.5, 0.25, 0.0]))
# By the room index to two digits: share of the flux in each cone that falls on the plane of the eyes, CIE 190, table 4.
_CONE_FACTORS = {
    1.00: (0.690, 0.109, 0.085, -0.016),
    1.20: (0.578, 0.200, 0.127, -0.018),
    1.33: (0.528, 0.218, 0.170, -0.017),
    1.50: (0.485, 0.215, 0.222, -0.012),
    1.60: (0.466, 0.207, 0.249, -0.006),
    1.71: (0.448, 0.198, 0.272, 0.005),
    2.00: (0.338, 0.257, 0.351, -0.018),
    2.40: (0.296, 0.203, 0.449, -0.006),
    2.67: (0.280, 0.165, 0.499, 0.006),
    3.00: (0.264, 0.125, 0.541, 0.027),
    3.43: (0.248, 0.058, 0.628, 0.032),
    4.00: (0.239, -0.012, 0.690, 0.058),
    4.80: (0.232, -0.084, 0.740, 0.098),
}
# Points of the working plane (EN 12464-1), and the lamps that light them, in heights above it.
_PLANE_BELOW_EYES_M = 0.45
_LEAST_POINTS = 3
_AROUND = 5.0
_FILE_X_DEG = -90.0  # x of a lamp, from its street: the spec's default street is y

_Places = Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class OfficeReadings:
    """Light of the lamps of one office."""

    office: OfficeSection

    def glare(self, turn_deg: float) -> CandelaSum:
        """Roots of L² ω/p² of all lamps that glare, and the background, seen along x of the lamps after this turn."""
        return CandelaSum.joined((self._lamps(turn_deg), self.background()))

    @property
    def _steps(self) -> tuple[int, int]:
        """Lamps across the room and along it."""
        across, along = (max(round(side / self.office.spacing), 1) for side in self.office.size)
        return across, along

    def _lamps(self, turn_deg: float) -> CandelaSum:
        from scipy import sparse

        width, length = self.office.size
        across, along = self._steps
        aside, ahead = _crossed(
            (np.arange(across) + 0.5) * (width / across) - 0.5 * width, (np.arange(along) + 0.5) * (length / along)
        )
        index = position_index(1.0 / ahead, np.abs(aside) / ahead)
        level = np.hypot(ahead, aside)
        gamma = np.degrees(np.arctan(level))
        glaring = (np.abs(aside) <= _MOST_ASIDE * ahead) & (gamma <= _LAST_DEG) & ~np.isnan(index)
        away_m = self.office.above_eyes_m * np.sqrt(1.0 + level**2)
        seen_m2 = np.prod(self.office.luminous_m) * np.cos(np.radians(gamma))
        weights = (1.0 / (away_m * index * np.sqrt(seen_m2)))[glaring]
        azimuth = np.degrees(np.arctan2(-aside, ahead)) + turn_deg + _FILE_X_DEG
        return CandelaSum(azimuth[glaring], gamma[glaring], sparse.diags_array(weights, format="csr"))

    def background(self) -> CandelaSum:
        """Luminance (cd/m²) of the walls by light that is reflected, at the eyes."""
        from scipy import sparse

        width, length = self.office.size
        across, along = self._steps
        edges = np.union1d(np.arange(0.0, 90.0, _GAMMA_STEP_DEG), _CONES_DEG)
        middle = 0.5 * (edges[1:] + edges[:-1])
        turns = np.arange(0.5 * _C_STEP_DEG, 360.0, _C_STEP_DEG)
        solid = np.radians(_C_STEP_DEG) * -np.diff(np.cos(np.radians(edges)))
        down = (middle[:, None] < _CONES_DEG) @ np.array(_CONE_FACTORS[round(width * length / (width + length), 2)])
        from_plane, from_walls = self._onto_walls()
        walls_m2 = 2.0 * (width + length) * self.office.above_eyes_m**2
        share = down * from_plane + (1.0 - down) * from_walls
        weights = solid * share * (across * along / (np.pi * walls_m2))
        azimuth, gamma = _crossed(turns, middle)
        return CandelaSum(azimuth, gamma, sparse.csr_array(np.repeat(weights, len(turns))[None]))

    def plane(self, pitch_m: tuple[float, float]) -> CandelaSum:
        """Direct illuminance (lx) of the working plane between four lamps of an endless ceiling of this pitch."""
        from scipy import sparse

        high_m = self.office.above_eyes_m + _PLANE_BELOW_EYES_M
        x, y = measuring_grid(pitch_m, least=_LEAST_POINTS)
        lamp_x, lamp_y = _crossed(*(_lamps_around(side, _AROUND * high_m) for side in pitch_m))
        east = pitch_m[0] * x[:, None] - lamp_x
        north = pitch_m[1] * y[:, None] - lamp_y
        level = np.hypot(east, north)
        weights = (level <= _AROUND * high_m) * high_m / (level**2 + high_m**2) ** 1.5
        point, lamp = np.nonzero(weights)
        azimuth = np.degrees(np.arctan2(north, east))[point, lamp] + _FILE_X_DEG
        gamma = np.degrees(np.arctan(level / high_m))[point, lamp]
        entries = weights[point, lamp], (point, np.arange(len(point)))
        return CandelaSum(azimuth, gamma, sparse.csr_array(entries, shape=(len(x), len(point))))

    def _onto_walls(self) -> tuple[float, float]:
        """Flux that the walls get after reflections of 1 lm on the plane of the eyes, and of 1 lm on the walls."""
        width, length = self.office.size
        ceiling, walls, plane = (0.01 * float(word) for word in self.office.reflectances.split("/"))
        opposite = _form_factor(width, length)
        to_ends = width * length * (1.0 - opposite) / (2.0 * (width + length))  # from the walls to either of both
        # Of flux that leaves plane, walls and ceiling, on each of them.
        to_plane = [0.0, to_ends, opposite]
        to_walls = [1.0 - opposite, 1.0 - 2.0 * to_ends, 1.0 - opposite]
        shares = np.array([to_plane, to_walls, to_plane[::-1]])
        received = np.linalg.inv(np.eye(3) - shares * np.array([plane, walls, ceiling]))
        return float(received[1, 0]), float(received[1, 1]) - 1.0


def _crossed(x: Float[np.ndarray, " a"], y: Float[np.ndarray, " b"]) -> tuple[_Places, _Places]:
    """Both coordinates of all crossings, those of the first y first."""
    columns, rows = np.meshgrid(x, y)
    return columns.ravel(), rows.ravel()


def _lamps_around(side_m: float, reach_m: float) -> Float[np.ndarray, " k"]:
    """Places of the lamps that reach the points between two of them."""
    count = int(np.ceil(reach_m / side_m))
    return np.asarray(side_m * np.arange(-count, count + 2))


def _form_factor(width: float, length: float) -> float:
    """Share of the light of an evenly bright rectangle that falls on an equal one opposite at the distance 1.

    Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11.
    """
    diagonal = np.sqrt(1.0 + width**2 + length**2)
    angles = _strip(width, length) + _strip(length, width)
    logarithm = np.log(np.sqrt(1.0 + width**2) * np.sqrt(1.0 + length**2) / diagonal)
    return float(2.0 / (np.pi * width * length) * (logarithm + angles))


def _strip(width: float, length: float) -> float:
    """Term of an edge of the length ``width`` in the form factor."""
    slant = np.sqrt(1.0 + length**2)
    return float(width * (slant * np.arctan(width / slant) - np.arctan(width)))


def position_index(height: _Places, aside: _Places) -> _Places:
    """Position index p of Guth, bilinear in table 4.1 of CIE 117, by both over the distance ahead; NaN beyond it."""
    from scipy.interpolate import RegularGridInterpolator

    heights, asides, table = _position_table()
    read = RegularGridInterpolator((asides, heights), table, bounds_error=False)
    return np.asarray(read(np.stack([aside, height], axis=1)))


@cache
def _position_table() -> tuple[_Places, Float[np.ndarray, " m"], Float[np.ndarray, "m n"]]:
    table = np.genfromtxt(_POSITION_INDEX, delimiter=",")
    return table[0, 1:], table[1:, 0], table[1:, 1:]
