"""Rough faces, as rays meet them: facets and shifts of faces that scatter, and facets of a made part.

A source that draws quasi-random rays gives each two numbers for two faces. All others are drawn by the ray itself, from
the bits of its start and direction: for further faces, and each time that it meets a face again. Either way a ray meets
the same in every trace.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt64

from lensforge.kernels.face_records import RingShifts
from lensforge.kernels.seen_slopes import seen_table
from lensforge.optics.media import Media
from lensforge.optics.scattering import GaussianFacets, RingScatter
from lensforge.scene.made_part import AsMade
from lensforge.sources.ray_bundle import RayBundle

Scatter = GaussianFacets | RingScatter
Keys = UInt64[np.ndarray, " n"]
Numbers = Float[np.ndarray, "n 2"]
NumbersOfFaces = Float[np.ndarray, "n m"]


class Roughness(NamedTuple):
    """Roughness that each ray meets: slopes of facets along two lines, over that of the face, and shifts.

    None if no face has facets, or none shifts light. They are those of the first time that a ray meets a face;
    ``keys`` are of the numbers that it draws later, as :func:`numbers_again` has them.
    """

    noise: Float[np.ndarray, "n m"] | None = None
    slopes: Float[np.ndarray, " f"] | None = None
    shifts: RingShifts | None = None
    keys: Keys | None = None

    @property
    def seen(self) -> Float[np.ndarray, "side side"] | None:
        """Table of the slopes that light sees; None if no face has facets."""
        return None if self.slopes is None else seen_table()


def roughness(
    media: Media, names: Sequence[str], rays: RayBundle, made: AsMade | None = None, first: int = 0, before: int = 0
) -> Roughness:
    """Roughness that ``rays`` meet at the faces of these ``names``: as designed, and facets of a ``made`` part.

    ``first``: number of the first ray, where these are some of many; ``before``: number of faces that scatter and that
    the rays have met before, on other bodies.
    """
    noise = None if made is None else made.rough(first + len(rays))
    models = media.scattering_of(names)
    if noise is None and models is None:
        return Roughness()
    keys = keys_of_rays(rays)
    rough = Roughness(keys=keys)
    if made is not None and noise is not None:
        rough = rough._replace(noise=noise[first:], slopes=made.slopes_of_faces)
    if models is None:
        return rough
    rms = np.array([model.slope if isinstance(model, GaussianFacets) else 0.0 for model in models])
    if rms.any():
        numbers = facet_numbers(rays, keys, models, before)
        if rough.noise is not None and rough.slopes is not None:
            slopes = numbers * np.repeat(rms, 2) + rough.noise * np.repeat(rough.slopes, 2)
            rms = np.hypot(rms, rough.slopes)
            numbers = slopes / np.repeat(np.where(rms > 0.0, rms, 1.0), 2)
        rough = rough._replace(noise=numbers, slopes=rms)
    return rough._replace(shifts=_ring_shifts(rays, keys, models, before)) if media.has_rings else rough


def with_facets(rays: RayBundle, faces: int) -> RayBundle:
    """``rays`` with their numbers for as many ``faces`` that scatter, for whoever is to meet the same facets."""
    if not faces:
        return rays
    keys = keys_of_rays(rays)
    return replace(rays, facets=np.column_stack([_numbers(rays, keys, face) for face in range(faces)]))


def wall_numbers(rays: RayBundle, media: Media) -> NumbersOfFaces | None:
    """Two numbers of each ray for every wall of the scene that reflects it, in turn; None if no wall is diffuse."""
    if not media.diffusing:
        return None
    keys = keys_of_rays(rays)
    before = media.scattering - media.diffusing
    return np.hstack([_numbers(rays, keys, before + event) for event in range(media.diffusing)])


def facet_numbers(rays: RayBundle, keys: Keys, faces: Sequence[Scatter | None], before: int = 0) -> NumbersOfFaces:
    """Slopes, over their rms, of the facets that each ray meets first, along two lines; 0 on a face without.

    ``keys`` of the rays; ``before``: number of faces that scatter and that the rays have met before, on other bodies.
    """
    numbers = np.zeros((len(rays), 2 * len(faces)))
    for face, facets, two in _at_each(rays, keys, faces, before):
        if isinstance(facets, GaussianFacets):
            amounts = GaussianFacets(1.0).amounts(two[:, 0])
            azimuths = 2.0 * np.pi * two[:, 1]
            np.multiply(amounts, np.cos(azimuths), out=numbers[:, 2 * face])
            np.multiply(amounts, np.sin(azimuths), out=numbers[:, 2 * face + 1])
    return numbers


def _ring_shifts(rays: RayBundle, keys: Keys, faces: Sequence[Scatter | None], before: int) -> RingShifts:
    """Shifts of the light of each ray behind each of the ``faces``; none behind one that has facets, or is polished."""
    numbers = np.zeros((len(rays), 2 * len(faces)))
    for face, _, two in _at_each(rays, keys, faces, before):
        numbers[:, 2 * face : 2 * face + 2] = two
    return _tables(tuple(face if isinstance(face, RingScatter) else None for face in faces))._replace(numbers=numbers)


def numbers_again(keys: Keys, face: int, times: Int[np.ndarray, " n"]) -> Numbers:
    """Two numbers in [0, 1) of rays with these ``keys`` for a face that each has met so many ``times`` before."""
    from lensforge.kernels.ray_draws import draw_all  # the compiler is loaded for what is traced

    numbers = np.empty((len(keys), 2))
    draw_all(keys, face, times, numbers)
    return numbers


@lru_cache(maxsize=8)
def _tables(faces: tuple[RingScatter | None, ...]) -> RingShifts:
    """The rings of all ``faces`` in arrays as large as the largest needs, for no rays."""
    known = [(face, model) for face, model in enumerate(faces) if model is not None]
    most = max(len(model.cosines) for _, model in known)
    rings = max(len(model.radii) for _, model in known)
    empty = [np.zeros((len(faces), *shape)) for shape in ((most,), (rings,), (most, rings), ())]
    tables = RingShifts(np.zeros((0, 2 * len(faces))), np.zeros((len(faces), 2), dtype=np.int64), *empty)
    for face, model in known:
        incidences, radii = np.shape(model.shares)
        tables.sizes[face] = incidences, radii
        tables.cosines[face, :incidences] = model.cosines
        tables.squares[face, :radii] = np.square(model.radii)
        tables.shares[face, :incidences, :radii] = model.shares
        tables.follows[face] = model.follows
    return tables


def _at_each(
    rays: RayBundle, keys: Keys, faces: Sequence[Scatter | None], before: int
) -> Iterator[tuple[int, Scatter, Numbers]]:
    """Number and model of each face that scatters, with two numbers of each ray there."""
    rough = [(face, model) for face, model in enumerate(faces) if model is not None]
    for number, (face, model) in enumerate(rough, before):
        yield face, model, _numbers(rays, keys, number)


def _numbers(rays: RayBundle, keys: Keys, number: int) -> Numbers:
    """Two numbers of each ray for the facet of this number: its own, or drawn by its bits."""
    if rays.facets is not None and 2 * number < rays.facets.shape[1]:
        return rays.facets[:, 2 * number : 2 * number + 2]
    return numbers_again(keys, number, np.zeros(len(keys), dtype=np.int64))


def keys_of_rays(rays: RayBundle) -> Keys:
    """Keys of the numbers that rays draw."""
    from lensforge.kernels.ray_draws import keys_of

    return keys_of(rays.origins, rays.directions)
