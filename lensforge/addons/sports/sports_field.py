"""Points and observers of a playing field, as sums over the intensities of its lamps: EN 12193 and CIE 112:1994.

Frame (m): x along the field, y across it, z up, from its middle on the ground. A lamp's axis leads from its place to
its aim; its street is beyond the aim, across the axis.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.addons.sports.sports_section import SportsSection
from lensforge.scene.intensity_limit import CandelaSum
from lensforge.scene.measuring_grid import measuring_grid

_EYES = 5  # observers along the field and across it, from edge to edge
_EYE_M = 1.5
_VIEWS = 8  # directions of view, each below the horizon
_VIEW_DOWN_DEG = 2.0
# Angles from the line of sight at which a lamp veils, and the veil of one lux: CIE 112, eq. 2.
_LEAST_DEG = 1.5
_MOST_DEG = 60.0
_VEIL = 10.0
_OF_GROUND = 0.035  # veiling luminance of the environment over the luminance of the ground: CIE 112, eq. 3

_Points = Float[np.ndarray, "k 3"]
_Factor = Callable[[Float[np.ndarray, "k l"]], Float[np.ndarray, "k l"]]


@dataclass(frozen=True, eq=False)
class SportsReadings:
    """Light of the new lamps of one field, without the maintenance factor."""

    field: SportsSection

    @property
    def illuminance(self) -> CandelaSum:
        """Horizontal illuminance (lx) of the points of the field, row by row along it."""
        along, across = measuring_grid((self.field.length_m, self.field.width_m), odd=True)
        x = (along - 0.5) * self.field.length_m
        y = (across - 0.5) * self.field.width_m
        ground = np.stack([x, y, np.zeros_like(x)], axis=1)
        return self._light(ground, np.tile([0.0, 0.0, 1.0], (len(ground), 1)), np.ones_like)

    @property
    def glare(self) -> CandelaSum:
        """Veiling luminance (cd/m²) of the lamps at each observer, and of the environment as the last entry."""
        ground = self.illuminance.mean().times(_OF_GROUND * self.field.reflectance / np.pi)
        return CandelaSum.joined((self._veil(), ground))

    def _veil(self) -> CandelaSum:
        halves = 0.5 * self.field.length_m, 0.5 * self.field.width_m
        turns = np.arange(_VIEWS) * (2.0 * np.pi / _VIEWS)
        x, y, turn = (
            places.ravel() for places in np.meshgrid(*(np.linspace(-half, half, _EYES) for half in halves), turns)
        )
        level = np.cos(np.radians(_VIEW_DOWN_DEG))
        down = np.sin(np.radians(_VIEW_DOWN_DEG))
        views = np.stack([level * np.cos(turn), level * np.sin(turn), np.full_like(turn, -down)], axis=1)
        return self._light(np.stack([x, y, np.full_like(x, _EYE_M)], axis=1), views, _veil_of_lux)

    def _light(self, points: _Points, facing: _Points, of_lux: _Factor) -> CandelaSum:
        """Sum over the lamps of the lux on planes that face so, times ``of_lux`` of the cosine to what they face."""
        from scipy import sparse

        places = np.array([light.place_m for light in self.field.floodlights])
        aims = np.array([(*light.aim_m, 0.0) for light in self.field.floodlights])
        count = np.array([light.lamps for light in self.field.floodlights])
        axis = _unit(aims - places)
        street = _unit(np.array([0.0, 0.0, 1.0]) - axis[:, 2:] * axis)
        away = points[:, None] - places
        ways = _unit(away)
        cosine = -(ways * facing[:, None]).sum(axis=2)
        lux = np.maximum(cosine, 0.0) / (away**2).sum(axis=2)
        weights = count * lux * of_lux(cosine)
        point, lamp = np.nonzero(weights)
        way = ways[point, lamp]
        gamma = np.degrees(np.arccos(np.clip((way * axis[lamp]).sum(axis=1), -1.0, 1.0)))
        aside = (way * np.cross(axis, street)[lamp]).sum(axis=1)
        azimuth = np.degrees(np.arctan2(aside, (way * street[lamp]).sum(axis=1)))
        entries = weights[point, lamp], (point, np.arange(len(point)))
        return CandelaSum(azimuth, gamma, sparse.csr_array(entries, shape=(len(points), len(point))))


def _veil_of_lux(cosine: Float[np.ndarray, "k l"]) -> Float[np.ndarray, "k l"]:
    """Veiling luminance (cd/m²) of one lux by the cosine of the angle from the line of sight."""
    theta = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    veils = (theta > _LEAST_DEG) & (theta < _MOST_DEG)
    return np.asarray(veils * _VEIL / np.maximum(theta, _LEAST_DEG) ** 2)


def _unit(vectors: Float[np.ndarray, "*k 3"]) -> Float[np.ndarray, "*k 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
