"""Intensity profiles, which map points of the unit square to directions of equal flux, and their beams.

``gamma`` is the angle from the lens axis +z; ``C`` (rad or deg) the azimuth from +x towards +y. In a plane through the
axis a profile has a beam angle and a field angle.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from lensforge.results import Number, Record
from lensforge.results.level_width import width_above
from lensforge.sources.inverse_cdf import choose, choose_each, linear_inverse
from lensforge.sources.photometric.candela_table import CandelaTable, flux_up_to
from lensforge.surfaces.mirror_group import largest_symmetry

_SAME = 1e-9  # rad, at the ends of a table
_FINE = np.deg2rad(0.25)  # cells of gamma in which rays are drawn at constant intensity; the flux of each cell is exact


@dataclass(frozen=True)
class CosinePower:
    """Intensity in proportion to ``cos(gamma)^power``; 1 is Lambertian."""

    power: float = 1.0
    symmetry: str = "square"

    def aim(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Invert by ``cos(gamma) = (1 - u)^(1/(power+1))``: with u in [0, 1) no ray skims the plane."""
        return _directions((1.0 - points[:, 0]) ** (1.0 / (self.power + 1.0)), 2.0 * np.pi * points[:, 1])

    def intensity(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Share of the flux per sr."""
        rise = np.maximum(directions[:, 2], 0.0)
        share: Float[np.ndarray, " n"] = (self.power + 1.0) / (2.0 * np.pi) * rise**self.power
        return share * (directions[:, 2] > 0.0)


class TabulatedIntensity(CandelaTable):
    """A table from which rays are drawn."""

    @classmethod
    def of(cls, table: CandelaTable) -> "TabulatedIntensity":
        """The intensities of ``table``."""
        return cls(table.c_deg, table.gamma_deg, table.values)

    @property
    def symmetry(self) -> str:
        """Largest mirror group found by comparing half-planes with their images, to 1e-6 of the largest intensity."""
        tolerance = 1e-6 * float(self.values.max())

        def unchanged(mirror: Float[np.ndarray, "3 3"]) -> bool:
            azimuth = np.deg2rad(self.c_deg)
            image = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1) @ mirror[:2, :2].T
            angles = np.rad2deg(np.arctan2(image[:, 1], image[:, 0]))
            return all(
                np.allclose(self.at(float(angle)), plane, rtol=0.0, atol=tolerance)
                for angle, plane in zip(angles, self.values, strict=True)
            )

        return largest_symmetry(unchanged)

    def aim(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Choose the azimuth by the second number, gamma by the first given the azimuth: exact for bilinear fluxes."""
        gamma, cumulative = self._fine
        if len(self.c_deg) == 1:
            low = np.zeros(len(points), dtype=int)
            between = np.zeros(len(points))
            azimuth = 2.0 * np.pi * points[:, 1]
            cumulative = np.concatenate([cumulative, cumulative])
        else:
            low, between = self._plane(points[:, 1])
            turn = np.deg2rad(self.c_deg)
            azimuth = turn[low] + between * (turn[low + 1] - turn[low])

        def before(cell: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
            blended: Float[np.ndarray, " n"] = (1.0 - between) * cumulative[low, cell]
            blended += between * cumulative[low + 1, cell]
            return blended

        cell, position = choose_each(before, len(gamma) - 1, points[:, 0])
        cosine = np.cos(gamma)
        return _directions(cosine[cell] + position * (cosine[cell + 1] - cosine[cell]), azimuth)

    def intensity(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Share of the flux per sr, bilinear between the half-planes; 0 beyond the first and last gamma."""
        gamma = np.arccos(np.clip(directions[:, 2], -1.0, 1.0))
        turn = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
        nodes = np.deg2rad(self.gamma_deg)
        lit = np.abs(gamma - 0.5 * (nodes[0] + nodes[-1])) < 0.5 * (nodes[-1] - nodes[0]) + _SAME
        planes = np.stack([np.interp(gamma, nodes, plane) * lit for plane in self.values])
        if len(self.c_deg) == 1:
            return np.asarray(planes[0] / self.flux())
        place = np.interp(turn, np.deg2rad(self.c_deg), np.arange(len(self.c_deg)))
        low = np.minimum(place.astype(int), len(self.c_deg) - 2)
        rows = np.arange(len(gamma))
        between = planes[low, rows] + (place - low) * (planes[low + 1, rows] - planes[low, rows])
        return np.asarray(between / self.flux())

    @cached_property
    def _fine(self) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, "c f"]]:
        """Fine steps of gamma (rad), and the flux up to each in every half-plane."""
        nodes = np.deg2rad(self.gamma_deg)
        steps = np.maximum(np.ceil(np.diff(nodes) / _FINE), 1).astype(int)
        place = np.concatenate([k + np.arange(n) / n for k, n in enumerate(steps)] + [[len(nodes) - 1.0]])
        gamma = np.interp(place, np.arange(len(nodes)), nodes)
        fine = np.stack([np.interp(gamma, nodes, plane) for plane in self.values])
        return gamma, flux_up_to(gamma, fine)

    def _plane(self, numbers: Float[np.ndarray, " n"]) -> tuple[np.ndarray, Float[np.ndarray, " n"]]:
        """Find the sector of each number and the position in it; the flux is linear in the azimuth."""
        fluxes = self.plane_fluxes
        sectors = 0.5 * (fluxes[1:] + fluxes[:-1]) * np.diff(np.deg2rad(self.c_deg))
        low, position = choose(np.cumsum(sectors), numbers)
        return low, linear_inverse(fluxes[low], fluxes[low + 1], position)


def _directions(cosine: Float[np.ndarray, " n"], azimuth: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)


BEAM_SHARE = 0.5  # of the plane's largest intensity: CIE S 017
FIELD_SHARE = 0.1  # ANSI/IES LS-1


class PlaneBeam(Record):
    """Beam in the plane of the half-planes ``c_deg`` and ``c_deg`` + 180.

    ``beam_angle_deg`` and ``field_angle_deg``: between the outermost directions with a half and a tenth of the largest
    intensity of this plane, ``peak_cd``; None if it has no light.
    """

    c_deg: Number
    peak_cd: Number
    beam_angle_deg: Number | None
    field_angle_deg: Number | None


def beam_in_plane(table: CandelaTable, c_deg: float) -> PlaneBeam:
    """Measure the beam of ``table`` (cd) in one plane, intensities linear between the angles."""
    gamma, profile = plane_profile(table, c_deg)
    peak = float(profile.max())
    return PlaneBeam(
        c_deg=c_deg,
        peak_cd=peak,
        beam_angle_deg=width_above(gamma, profile, BEAM_SHARE * peak),
        field_angle_deg=width_above(gamma, profile, FIELD_SHARE * peak),
    )


def plane_profile(table: CandelaTable, c_deg: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Angles (deg) and intensities of a plane: gamma of the half-plane at ``c_deg``, -gamma of that at its back."""
    gamma = table.gamma_deg
    front = table.at(c_deg)
    back = table.at(c_deg + 180.0)
    behind = gamma > 0.0
    return np.append(-gamma[behind][::-1], gamma), np.append(back[behind][::-1], front)
