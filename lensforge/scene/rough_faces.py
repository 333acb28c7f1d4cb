"""Rough faces, as rays meet them: facets and shifts of faces that scatter, and facets of a made part.

A source that draws quasi-random rays gives each two numbers for two faces. All others are drawn by the ray itself, from
the bits of its start and direction. Either way a ray meets the same in every trace.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.face_records import RingShifts
from lensforge.optics.media import Media
from lensforge.optics.scattering import GaussianFacets, RingScatter
from lensforge.scene.made_part import AsMade
from lensforge.sources.ray_bundle import RayBundle

Values = Float[np.ndarray, " n"]
Scatter = GaussianFacets | RingScatter


class Roughness(NamedTuple):
    """Roughness that each ray meets: slopes of facets along two lines, over that of the face, and shifts.

    None where no face has facets, or none shifts light.
    """

    noise: Float[np.ndarray, "n m"] | None = None
    slopes: Float[np.ndarray, " f"] | None = None
    shifts: RingShifts | None = None


def roughness(
    media: Media, names: Sequence[str], rays: RayBundle, made: AsMade | None = None, first: int = 0, before: int = 0
) -> Roughness:
    """Roughness that ``rays`` meet at the faces of these ``names``: as designed, and facets of a ``made`` part.

    ``first``: number of the first ray, where these are some of many; ``before``: number of faces that scatter and that
    the rays have met before, on other bodies.
    """
    rough = Roughness()
    if made is not None and (noise := made.rough(first + len(rays))) is not None:
        rough = Roughness(noise[first:], made.slopes_of_faces)
    models = media.scattering_of(names)
    if models is None:
        return rough
    rms = np.array([each.slope if isinstance(each, GaussianFacets) else 0.0 for each in models])
    if rms.any():
        slopes = facet_slopes(rays, models, before)
        if rough.noise is not None and rough.slopes is not None:
            slopes, rms = slopes + rough.noise * np.repeat(rough.slopes, 2), np.hypot(rms, rough.slopes)
        rough = Roughness(slopes / np.repeat(np.where(rms > 0.0, rms, 1.0), 2), rms)
    return rough._replace(shifts=ring_shifts(rays, models, before)) if media.has_rings else rough


def with_facets(rays: RayBundle, faces: int) -> RayBundle:
    """``rays`` with their numbers for as many ``faces`` that scatter, for whoever is to meet the same facets."""
    if not faces:
        return rays
    return replace(rays, facets=np.column_stack([each for face in range(faces) for each in _numbers(rays, face)]))


def facet_slopes(rays: RayBundle, faces: Sequence[Scatter | None], before: int = 0) -> Float[np.ndarray, "n m"]:
    """Slopes of the facets that each ray meets, along two lines on each of the ``faces``; 0 on one that has none.

    ``before``: number of faces that scatter and that the rays have met before, on other bodies.
    """
    found = np.zeros((len(rays), 2 * len(faces)))
    for face, facets, amounts, azimuths in _at_each(rays, faces, before):
        if isinstance(facets, GaussianFacets):
            slopes = facets.amounts(amounts)
            np.multiply(slopes, np.cos(azimuths), out=found[:, 2 * face])
            np.multiply(slopes, np.sin(azimuths), out=found[:, 2 * face + 1])
    return found


def ring_shifts(rays: RayBundle, faces: Sequence[Scatter | None], before: int = 0) -> RingShifts:
    """Shifts of the light of each ray behind each of the ``faces``; none behind one that has facets, or is polished.

    ``before``: as of :func:`facet_slopes`.
    """
    rings = [each for each in faces if isinstance(each, RingScatter)]
    most = max(len(each.cosines) for each in rings)
    cosines = np.tile(np.linspace(2.0, 3.0, most), (len(faces), 1))  # where no row is: beyond all that rays have
    found = np.zeros((len(rays), len(faces), 3 + most))
    found[:, :, 2] = 1.0
    for face, model, numbers, azimuths in _at_each(rays, faces, before):
        if isinstance(model, RingScatter):
            known, amounts = len(model.cosines), model.amounts(numbers)
            cosines[face, :known] = model.cosines
            found[:, face, 0], found[:, face, 1] = np.cos(azimuths), np.sin(azimuths)
            found[:, face, 2] = np.where(amounts.max(axis=1) > 0.0, float(model.follows), 1.0)
            found[:, face, 3 : 3 + known], found[:, face, 3 + known :] = amounts, amounts[:, -1:]
    return RingShifts(found, cosines)


def _at_each(
    rays: RayBundle, faces: Sequence[Scatter | None], before: int
) -> Iterator[tuple[int, Scatter, Values, Values]]:
    """Number and model of each face that scatters, with the number of each ray for its amount, and its azimuth."""
    rough = [(face, model) for face, model in enumerate(faces) if model is not None]
    for number, (face, model) in enumerate(rough, before):
        amounts, turns = _numbers(rays, number)
        yield face, model, amounts, 2.0 * np.pi * turns


def _numbers(rays: RayBundle, number: int) -> tuple[Values, Values]:
    """Two numbers of each ray for the facet of this number: its own, or drawn by its bits."""
    if rays.facets is not None and 2 * number < rays.facets.shape[1]:
        return rays.facets[:, 2 * number], rays.facets[:, 2 * number + 1]
    from lensforge.kernels.facet_normals import draw_by_rays  # the compiler is loaded for what is traced

    starts, ways = (np.ascontiguousarray(each).view(np.uint64) for each in (rays.origins, rays.directions))
    drawn = np.empty((len(rays), 2))
    draw_by_rays(starts, ways, np.uint64(number), drawn)
    return drawn[:, 0], drawn[:, 1]
