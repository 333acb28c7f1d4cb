"""Beam of a far field in a plane through its axis: profile, beam angle and field angle."""

import numpy as np
from jaxtyping import Float

from lensforge.records import Number, Record
from lensforge.sources.intensity import TabulatedIntensity

BEAM_SHARE, FIELD_SHARE = 0.5, 0.1  # of the plane's largest intensity: CIE S 017, ANSI/IES LS-1


class PlaneBeam(Record):
    """Beam in the plane of the half-planes ``c_deg`` and ``c_deg`` + 180.

    ``beam_angle_deg`` and ``field_angle_deg``: between the outermost directions with a half and a tenth of the largest
    intensity of this plane, ``peak_cd``; None where it has no light.
    """

    c_deg: Number
    peak_cd: Number
    beam_angle_deg: Number | None
    field_angle_deg: Number | None


def beam_in_plane(table: TabulatedIntensity, c_deg: float) -> PlaneBeam:
    """Measure the beam of ``table`` (cd) in one plane, intensities linear between the angles."""
    gamma, profile = plane_profile(table, c_deg)
    peak = float(profile.max())
    return PlaneBeam(
        c_deg=c_deg,
        peak_cd=peak,
        beam_angle_deg=width_above(gamma, profile, BEAM_SHARE * peak),
        field_angle_deg=width_above(gamma, profile, FIELD_SHARE * peak),
    )


def plane_profile(table: TabulatedIntensity, c_deg: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Angles (deg) and intensities of a plane: gamma of the half-plane at ``c_deg``, -gamma of that at its back."""
    gamma, front, back = table.gamma_deg, table.at(c_deg), table.at(c_deg + 180.0)
    behind = gamma > 0.0
    return np.append(-gamma[behind][::-1], gamma), np.append(back[behind][::-1], front)


def width_above(gamma: Float[np.ndarray, " n"], profile: Float[np.ndarray, " n"], level: float) -> float | None:
    """Angle between the outermost crossings of ``level``, linear between the angles; to their ends where it is above.

    None where nothing is above it, or it is not above 0.
    """
    above = np.flatnonzero(profile >= level)
    if not level > 0.0 or not len(above):
        return None
    first, last = int(above[0]), int(above[-1])
    low = gamma[0] if first == 0 else _crossing(gamma, profile, first - 1, level)
    high = gamma[-1] if last == len(gamma) - 1 else _crossing(gamma, profile, last, level)
    return float(high - low)


def _crossing(gamma: Float[np.ndarray, " n"], profile: Float[np.ndarray, " n"], cell: int, level: float) -> float:
    start, end = profile[cell], profile[cell + 1]
    return float(gamma[cell] + (level - start) / (end - start) * (gamma[cell + 1] - gamma[cell]))
