"""Directions of light behind a wall of the scene: by a mirror, or by Lambert's law, from the side from which it comes.

A diffuse wall of two numbers u, v in [0, 1) of a ray sends it along √u (cos 2πv **t** + sin 2πv **n** x **t**) +
√(1 - u) **n**, the density cos/π. **n** is the unit normal towards the light, **t** the direction of the ray along the
wall: no frame but that of wall and ray enters, so that turned scenes have turned light.

:class:`AtWalls` has the slopes of light behind a wall. A ray from **p** along **d** meets it at **w** = **p** + t
**d**, where d**w** = (**1** - **d** **n**ᵀ / **d**·**n**) (d**p** + t d**d**). The normal turns with the curvature of
the wall: facets stand for a smooth one.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.arrays import Array, lengths, like, module_of
from lensforge.scene.exit_rays import Sensitivities

_ALONG_NORMAL = 1e-9  # sine of incidence below which a ray has no direction along the wall

_Vectors = Float[np.ndarray, "n 3"]


def towards_light(normals: _Vectors, directions: _Vectors) -> _Vectors:
    """Unit ``normals`` of either sign, turned against ``directions``."""
    ahead = (normals * directions).sum(axis=1, keepdims=True)
    return np.where(ahead > 0.0, -normals, normals)


def mirrored(directions: _Vectors, normals: _Vectors) -> _Vectors:
    """Unit ``directions`` behind mirrors of unit ``normals``."""
    return np.asarray(directions - 2.0 * (directions * normals).sum(axis=1, keepdims=True) * normals)


def diffused(directions: _Vectors, normals: _Vectors, draws: Float[np.ndarray, "n 2"]) -> _Vectors:
    """Unit directions behind diffuse walls of unit ``normals`` towards the light, by two numbers in [0, 1) of each."""
    along = directions - (directions * normals).sum(axis=1, keepdims=True) * normals
    sine = lengths(along)[:, None]
    aside = np.where(np.abs(normals[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    along = np.where(sine > _ALONG_NORMAL, along, np.cross(normals, aside))
    along /= lengths(along)[:, None]
    radius = np.sqrt(draws[:, :1])
    azimuth = 2.0 * np.pi * draws[:, 1:]
    across = radius * (np.cos(azimuth) * along + np.sin(azimuth) * np.cross(normals, along))
    return np.asarray(across + np.sqrt(1.0 - draws[:, :1]) * normals)


class AtWalls(NamedTuple):
    """Rays at the walls that reflect them: ``places`` (mm) and unit ``normals`` there, of either sign.

    ``curvatures``: change of the normal by a step along the wall (1/mm); ``starts`` (mm) and directions ``going`` of
    the light that goes on; whether the wall is ``diffuse``.
    """

    places: _Vectors
    normals: _Vectors
    curvatures: Float[np.ndarray, "n 3 3"]
    starts: _Vectors
    going: _Vectors
    diffuse: Bool[np.ndarray, " n"]

    def take(self, rows: Int[np.ndarray, " k"]) -> "AtWalls":
        """Some of the rays."""
        return AtWalls(*(column[rows] for column in self))

    def lines(
        self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]
    ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
        """``starts`` and ``going``, differentiable in the rays that come; to rounding.

        Behind a diffuse wall light keeps its direction in the frame of the wall. That frame turns with the ray, too,
        but about the normal, about which all directions are alike: it changes no mean, and would only add noise.
        """
        places, normals, curvatures, starts, going = (like(points, column) for column in self[:-1])
        path = ((places - points) * normals).sum(1) / (directions * normals).sum(1)
        moved = points + path[:, None] * directions - places
        turned = (curvatures * moved[:, None]).sum(2)
        leaning = normals + turned
        mirrored_there = directions - 2.0 * (directions * leaning).sum(1)[:, None] * leaning
        spread = going + (going * normals).sum(1)[:, None] * turned - (going * turned).sum(1)[:, None] * normals
        is_diffuse = like(points, self.diffuse)[:, None] > 0.0
        return starts + moved, module_of(points).where(is_diffuse, spread, mirrored_there)

    def adjoint(self, points: _Vectors, directions: _Vectors, by: Sensitivities) -> Sensitivities:
        """Sensitivities to the rays that come from those to the light that goes on, as :meth:`lines` has it."""
        rise = (directions * self.normals).sum(axis=1, keepdims=True)
        path = ((self.places - points) * self.normals).sum(axis=1, keepdims=True) / rise
        along = (by.by_directions * self.normals).sum(axis=1, keepdims=True)
        is_diffuse = self.diffuse[:, None]
        straight = np.where(is_diffuse, 0.0, by.by_directions - 2.0 * along * self.normals)
        lever = np.where(is_diffuse, (self.going * self.normals).sum(axis=1, keepdims=True), -2.0 * rise)
        by_turned = lever * by.by_directions - along * np.where(is_diffuse, self.going, 2.0 * directions)
        by_moved = by.by_points + (self.curvatures * by_turned[:, :, None]).sum(axis=1)
        by_points = by_moved - (by_moved * directions).sum(axis=1, keepdims=True) / rise * self.normals
        return Sensitivities(by_points, straight + path * by_points)
