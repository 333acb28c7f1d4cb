"""Refraction at the faces of the part and through a cover glass; Snell and Fresnel apart from the design's code.

The polarisation of light goes with each ray as two fields, vectors across it, into which both polarisations of the
source have turned: after Yun, Crabtree and Chipman, Appl. Opt. 50, 2855 (2011). Any two at right angles will do.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from lensforge.optics.media import Media
from lensforge.verification.coated_face import RefractingFace

Fields = Complex[np.ndarray, "n 2 3"]


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


def unpolarised(directions: Float[np.ndarray, "n 3"]) -> Fields:
    """Two unit fields across each ray and each other: unpolarised light has half of its flux in either."""
    least = np.eye(3)[np.argmin(np.abs(np.nan_to_num(directions)), axis=1)]
    one = _unit(np.cross(directions, least))
    return np.stack([one, np.cross(directions, one)], axis=1).astype(complex)


@dataclass(frozen=True)
class AtFace:
    """Unpolarised or polarised light at a face: directions, shares of the flux and fields of what passes and returns.

    The fields of a ray have the squared lengths 2 together. Amplitudes are Fresnel's, or the coating's, in total
    reflection complex; what passes a coating is real: the phases between s and p that it gives to transmitted light,
    which act on a third face alone, are left out.
    """

    bent: Float[np.ndarray, "n 3"]
    mirrored: Float[np.ndarray, "n 3"]
    transmittance: Float[np.ndarray, " n"]
    passed: Fields
    returned: Fields

    @staticmethod
    def of(
        face: RefractingFace, directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], fields: Fields
    ) -> "AtFace":
        """Split ``fields`` into s across the plane of incidence and p in it; at normal incidence any plane will do."""
        bent, bare = refract(directions, normals, face.index_ratio)
        along = np.sum(directions * normals, axis=1)
        mirrored = directions - 2.0 * along[:, None] * normals
        across = np.cross(directions, normals)
        steep = np.linalg.norm(across, axis=1) < 1e-12
        s = np.where(steep[:, None], unpolarised(directions)[:, 0].real, _unit(across))
        parts = [np.einsum("nfi,ni->nf", fields, each) for each in (s, np.cross(directions, s))]
        amplitudes = face.reflected(np.abs(along), bare > 0.0)
        passed, returned = np.zeros_like(fields), np.zeros_like(fields)
        for part, amplitude, axes in zip(
            parts, amplitudes, ((s, s), (np.cross(bent, s), np.cross(mirrored, s))), strict=True
        ):
            through = np.sqrt(np.where(bare > 0.0, np.maximum(1.0 - np.abs(amplitude) ** 2, 0.0), 0.0))
            passed += (through[:, None] * part)[:, :, None] * axes[0][:, None, :]
            returned += (amplitude[:, None] * part)[:, :, None] * axes[1][:, None, :]
        share, back = (0.5 * np.sum(np.abs(each) ** 2, axis=(1, 2)) for each in (passed, returned))
        passed, returned = (
            each / np.sqrt(np.where(power > 0.0, power, 1.0))[:, None, None]
            for each, power in ((passed, share), (returned, back))
        )
        return AtFace(bent, mirrored, share, passed, returned)


def through_glass(
    points: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    media: Media,
    wavelengths_nm: Float[np.ndarray, " n"] | None = None,
    fields: Fields | None = None,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Points (mm) and directions behind the cover glass, and what it transmits; rays that never meet it go on.

    ``fields`` None: of unpolarised light.
    """
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
    first = AtFace.of(one, ahead, normal, unpolarised(ahead) if fields is None else fields[rising])
    inside = first.bent
    lengths = glass.thickness_mm / inside[:, 2]
    second = AtFace.of(other, inside, normal, first.passed)
    ends, ways, share = points.copy(), directions.copy(), np.ones(len(points))
    ends[rising], ways[rising] = near + lengths[:, None] * inside, second.bent
    share[rising] = first.transmittance * np.exp(-glass.absorption_per_mm * lengths) * second.transmittance
    return ends, ways, share


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    found: Float[np.ndarray, "n 3"] = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return found
