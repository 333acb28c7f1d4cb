"""Facets that rays meet at rough faces: those of faces that scatter, and those of a made part.

A source that draws quasi-random rays gives each two numbers for the facets of two faces. All others are drawn by the
ray itself, from the bits of its start and direction. Either way a ray meets the same facets in every trace.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.optics.media import Media
from lensforge.optics.scattering import GaussianFacets
from lensforge.scene.made_part import AsMade
from lensforge.sources.ray_bundle import RayBundle

Values = Float[np.ndarray, " n"]


class Roughness(NamedTuple):
    """Slopes of the facets of each ray, along two lines on every face, over the slope of that face."""

    noise: Float[np.ndarray, "n m"]
    slopes: Float[np.ndarray, " f"]


def roughness(
    media: Media, names: Sequence[str], rays: RayBundle, made: AsMade | None = None, first: int = 0, before: int = 0
) -> Roughness | None:
    """Facets that ``rays`` meet at the faces of these ``names``: as designed, and of a ``made`` part; None without any.

    ``first``: number of the first ray, where these are some of many; ``before``: number of faces that scatter and that
    the rays have met before, on other bodies.
    """
    rough = None
    if made is not None and (noise := made.rough(first + len(rays))) is not None:
        rough = Roughness(noise[first:], made.slopes_of_faces)
    facets = media.facets(names)
    if facets is None:
        return rough
    designed = facet_slopes(rays, facets, before)
    if rough is not None:
        designed += rough.noise * np.repeat(rough.slopes, 2)
    return Roughness(designed, np.ones(len(names)))


def with_facets(rays: RayBundle, faces: int) -> RayBundle:
    """``rays`` with their numbers for as many ``faces`` that scatter, for whoever is to meet the same facets."""
    if not faces:
        return rays
    return replace(rays, facets=np.column_stack([each for face in range(faces) for each in _numbers(rays, face)]))


def facet_slopes(rays: RayBundle, faces: Sequence[GaussianFacets | None], before: int = 0) -> Float[np.ndarray, "n m"]:
    """Slopes of the facets that each ray meets, along two lines on each of the ``faces``; 0 on a polished one.

    ``before``: number of faces that scatter and that the rays have met before, on other bodies.
    """
    found, number = np.zeros((len(rays), 2 * len(faces))), before
    for face, facets in enumerate(faces):
        if facets is not None:
            amounts, azimuths = _numbers(rays, number)
            slopes, azimuths = facets.amounts(amounts), 2.0 * np.pi * azimuths
            np.multiply(slopes, np.cos(azimuths), out=found[:, 2 * face])
            np.multiply(slopes, np.sin(azimuths), out=found[:, 2 * face + 1])
            number += 1
    return found


def _numbers(rays: RayBundle, number: int) -> tuple[Values, Values]:
    """Two numbers of each ray for the facet of this number: its own, or drawn by its bits."""
    if rays.facets is not None and 2 * number < rays.facets.shape[1]:
        return rays.facets[:, 2 * number], rays.facets[:, 2 * number + 1]
    from lensforge.kernels.facet_normals import draw_by_rays  # the compiler is loaded for what is traced

    starts, ways = (np.ascontiguousarray(each).view(np.uint64) for each in (rays.origins, rays.directions))
    drawn = np.empty((len(rays), 2))
    draw_by_rays(starts, ways, np.uint64(number), drawn)
    return drawn[:, 0], drawn[:, 1]
