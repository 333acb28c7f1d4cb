"""Refraction at the faces of the part and through a cover glass; Snell and Fresnel apart from the design's code."""

import numpy as np
from jaxtyping import Float

from lensforge.optics.media import Media
from lensforge.verification.coated_face import RefractingFace


def refract(
    directions: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    index_ratio: Float[np.ndarray, " n"] | float,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Unit directions by Snell's law, and unpolarised Fresnel transmittance, 0 where totally reflected.

    ``normals`` may point to either side; ``index_ratio`` is n before / n behind, of each ray or of all. Born and Wolf,
    section 1.5.
    """
    index_ratio = np.broadcast_to(index_ratio, len(directions))
    along = np.sum(directions * normals, axis=1)
    before = np.abs(along)
    squared = 1.0 - index_ratio**2 * (1.0 - before**2)
    passes = squared > 0.0
    behind = np.sqrt(np.where(passes, squared, 1.0))
    facing = np.where(along < 0.0, -1.0, 1.0)[:, None] * normals
    bent = index_ratio[:, None] * directions + (behind - index_ratio * before)[:, None] * facing
    r_s = (index_ratio * before - behind) / (index_ratio * before + behind)
    r_p = (before - index_ratio * behind) / (before + index_ratio * behind)
    transmittance = np.where(passes, 1.0 - 0.5 * (r_s**2 + r_p**2), 0.0)
    return bent / np.linalg.norm(bent, axis=1, keepdims=True), transmittance


def refract_at(
    face: RefractingFace, directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Unit directions behind a face, and its transmittance with its coating, 0 where totally reflected."""
    bent, bare = refract(directions, normals, face.index_ratio)
    return bent, face.transmittance(np.abs(np.sum(directions * normals, axis=1)), bare)


def through_glass(
    points: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    media: Media,
    wavelengths_nm: Float[np.ndarray, " n"] | None = None,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Points (mm) and directions behind the cover glass, and what it transmits; rays that never meet it go on."""
    glass, rising = media.cover_glass, directions[:, 2] > 0.0
    if glass is None:
        return points, directions, np.ones(len(points))
    normal = np.tile([0.0, 0.0, 1.0], (int(rising.sum()), 1))
    waves = np.full(len(points), media.wavelength_nm) if wavelengths_nm is None else wavelengths_nm
    outside, within = (np.full(len(normal), each) for each in (media.outside_index, glass.refractive_index))
    one = RefractingFace(outside, within, glass.coating, waves[rising], True)
    other = RefractingFace(within, outside, glass.coating, waves[rising], False)
    ahead = directions[rising]
    near = points[rising] + ((glass.distance_mm - points[rising, 2]) / ahead[:, 2])[:, None] * ahead
    inside, first = refract_at(one, ahead, normal)
    lengths = glass.thickness_mm / inside[:, 2]
    behind, second = refract_at(other, inside, normal)
    ends, ways, share = points.copy(), directions.copy(), np.ones(len(points))
    ends[rising], ways[rising] = near + lengths[:, None] * inside, behind
    share[rising] = first * np.exp(-glass.absorption_per_mm * lengths) * second
    return ends, ways, share
