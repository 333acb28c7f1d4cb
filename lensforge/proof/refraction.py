"""Refraction at the faces of the part and in a cover glass: Snell, Fresnel, coatings, without the design's code.

The polarisation of light goes with each ray as two fields, vectors across it, into which both polarisations of the
source have turned: after Yun, Crabtree and Chipman, Appl. Opt. 50, 2855 (2011). Any two at right angles will do.

A stack of layers is summed ray by ray, the layer next to the last medium first (Rouard; Macleod, Thin-Film Optical
Filters, 2.3), a table interpolated as the specification says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.interpolate import PchipInterpolator

from lensforge.optics.media import Coating, LayerStack, Media, Mirror, ReflectanceTable
from lensforge.proof.facet_casting import RayRows
from lensforge.proof.facet_tilt import FaceNumbers, Keys, Numbers
from lensforge.proof.ring_spread import Spreading, spread, turned
from lensforge.sources.ray_bundle import RayBundle

PerRay = Float[np.ndarray, " n"]
Amplitudes = Complex[np.ndarray, " n"]


Fields = Complex[np.ndarray, "n 2 3"]


@dataclass(frozen=True)
class LitRays(RayRows):
    """Rays: unit directions, polarisation, True in the material, and the body's properties for each.

    ``indices``, ``absorptions``: refractive index and absorption (1/mm) of the body for each, at ``wavelengths_nm``.
    ``numbers``, ``keys``: for faces that scatter, as in :class:`FaceNumbers`; ``times``: earlier hits of each face by
    each ray.
    """

    directions: Float[np.ndarray, "n 3"]
    fields: Fields
    inside: Bool[np.ndarray, " n"]
    indices: PerRay
    absorptions: PerRay
    wavelengths_nm: PerRay
    numbers: Numbers
    keys: Keys
    times: Int[np.ndarray, "n f"]

    @staticmethod
    def of(rays: RayBundle, media: Media, names: Sequence[str], seed: int | None = None) -> "LitRays":
        """Unpolarised light as emitted; ``names``: of the faces.

        ``seed``: of numbers for rough faces other than the design's.
        """
        count = len(rays)
        body = media.body
        in_body = body.indices(rays.waves, count), body.absorptions(rays.waves, count)
        waves = media.wavelengths(rays.wavelengths_nm, count)
        outside = np.zeros(count, dtype=bool)
        times = np.zeros((count, len(names)), dtype=np.int64)
        drawn = FaceNumbers.of(rays, media, names, seed=seed)
        return LitRays(rays.directions, unpolarised(rays.directions), outside, *in_body, waves, *drawn, times)

    def numbers_at(self, faces: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Two numbers of each ray for the face that it meets; 0 for a polished face, or none."""
        return FaceNumbers(self.numbers, self.keys).at(faces, self.times[np.arange(len(faces)), faces])

    def times_after(self, faces: Int[np.ndarray, " n"]) -> Int[np.ndarray, "n f"]:
        """Hits of each face by each ray after meeting ``faces``, where a negative number is no face."""
        return self.times + (np.arange(self.times.shape[1]) == faces[:, None])


@dataclass(frozen=True)
class RefractingFace:
    """Refractive index before and behind a face, the coating between them, and the wavelength (nm), for each ray.

    ``inwards``: the body lies behind it, so that its first layer is met first.
    """

    before: PerRay
    behind: PerRay
    coating: Coating | None
    wavelengths_nm: PerRay
    inwards: bool

    def reflected(self, cosines: PerRay, passes: Bool[np.ndarray, " n"]) -> tuple[Amplitudes, Amplitudes]:
        """Amplitudes of s and p that rays are reflected with which meet it at ``cosines``; p of opposite sign.

        All light is reflected where it does not pass, but by a mirror. A table of unpolarised reflectance holds for s
        and p alike; the phases of total reflection are those of the bare face.
        """
        if isinstance(self.coating, Mirror):
            root = np.full(len(cosines), np.sqrt(self.coating.reflectance), dtype=complex)
            return root, -root
        cosines = np.minimum(cosines, 1.0)
        along = self.before * np.sqrt(1.0 - cosines**2)  # n sin of the angle
        r_s = self._of_layers(self._stack, along, "s")
        r_p = -self._of_layers(self._stack, along, "p")
        phases = [amplitude / np.where(amplitude == 0.0, 1.0, np.abs(amplitude)) for amplitude in (r_s, r_p)]
        if isinstance(self.coating, ReflectanceTable):
            sines = np.minimum(along / np.minimum(self.before, self.behind), 1.0)
            of_table = _of_table(self.coating, np.sqrt(1.0 - sines**2), self.wavelengths_nm)
            r_s = np.sqrt(np.maximum(of_table, 0.0)).astype(complex)
            r_p = -r_s
        return np.where(passes, r_s, phases[0]), np.where(passes, r_p, phases[1])

    @property
    def _stack(self) -> LayerStack | None:
        """The layers that give total reflection its phases; None of a table, which says nothing of phases: as bare."""
        return self.coating if isinstance(self.coating, LayerStack) else None

    def _of_layers(self, stack: LayerStack | None, along: PerRay, polarisation: str) -> Amplitudes:
        films = () if stack is None else stack.layers
        layers = films if self.inwards else films[::-1]
        indices = [self.before, *(layer.index.at(self.wavelengths_nm) for layer in layers), self.behind]
        across = [np.sqrt((index**2 - along**2).astype(complex)) for index in indices]
        admittances = across
        if polarisation == "p":
            admittances = [n**2 / np.where(a == 0.0, 1e-300, a) for a, n in zip(across, indices, strict=True)]
        amplitude = _step(admittances[-2], admittances[-1])
        for k in range(len(layers) - 1, -1, -1):
            turns = across[k + 1] * layers[k].thickness_nm / self.wavelengths_nm
            returned = amplitude * np.exp(4j * np.pi * turns)
            first = _step(admittances[k], admittances[k + 1])
            amplitude = (first + returned) / (1.0 + first * returned)
        return amplitude


def _step(before: Complex[np.ndarray, " n"], behind: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
    return (before - behind) / (before + behind)


def _of_table(table: ReflectanceTable, cosines: PerRay, wavelengths_nm: PerRay) -> PerRay:
    angles = list(table.angles_deg)
    rows = [list(row) for row in table.reflectance]
    if angles[-1] < 90.0:
        angles.append(90.0)
        rows = [[*row, 1.0] for row in rows]
    places = np.sin(np.radians(90.0 - np.array(angles[::-1])))  # the cosines, 0 at 90 degrees
    by_row: list[PerRay] = [PchipInterpolator(places, row[::-1])(cosines) for row in rows]
    if len(rows) == 1:
        return by_row[0]
    waves = np.clip(wavelengths_nm, table.wavelengths_nm[0], table.wavelengths_nm[-1])
    reflectance = np.zeros(len(cosines))
    for k, curve in enumerate(by_row):  # each row counts by a hat function about its wavelength
        reflectance += curve * np.interp(waves, table.wavelengths_nm, np.eye(len(rows))[k])
    return reflectance


def unpolarised(directions: Float[np.ndarray, "n 3"]) -> Fields:
    """Two unit fields perpendicular to each ray and to each other, each with half of unpolarised light's flux."""
    smallest_axis = np.eye(3)[np.argmin(np.abs(np.nan_to_num(directions)), axis=1)]
    first = _unit(np.cross(directions, smallest_axis))
    return np.stack([first, np.cross(directions, first)], axis=1).astype(complex)


@dataclass(frozen=True)
class AtFace:
    """Light at a face: directions, shares of the flux and fields of transmitted and reflected light.

    A mirror absorbs what it does not reflect; all other faces share the light between both.

    The squared lengths of a ray's fields add up to 2. Amplitudes are Fresnel's, or the coating's, complex in total
    reflection; those transmitted by a coating are real: the phases between s and p that it gives to transmitted light,
    which act on a third face alone, are left out.
    """

    bent: Float[np.ndarray, "n 3"]
    mirrored: Float[np.ndarray, "n 3"]
    transmittance: PerRay
    reflectance: PerRay
    passed: Fields
    returned: Fields

    @staticmethod
    def of(
        face: RefractingFace, directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], fields: Fields
    ) -> "AtFace":
        """Split ``fields`` into s across the plane of incidence and p in it; at normal incidence any plane will do."""
        along = np.sum(directions * normals, axis=1)
        bent, passes = _bent(directions, normals, along, face.before / face.behind)
        mirror = face.coating.reflectance if isinstance(face.coating, Mirror) else None
        passes = passes & (mirror is None)
        mirrored = directions - 2.0 * along[:, None] * normals
        across = np.cross(directions, normals)
        steep = np.linalg.norm(across, axis=1) < 1e-12
        s = _unit(across)
        s[steep] = unpolarised(directions[steep])[:, 0].real
        parts = [np.einsum("nfi,ni->nf", fields, axis) for axis in (s, np.cross(directions, s))]
        amplitudes = face.reflected(np.abs(along), passes)
        passed = np.zeros_like(fields)
        returned = np.zeros_like(fields)
        for part, amplitude, axes in zip(
            parts, amplitudes, ((s, s), (np.cross(bent, s), np.cross(mirrored, s))), strict=True
        ):
            through = np.sqrt(np.where(passes, np.maximum(1.0 - np.abs(amplitude) ** 2, 0.0), 0.0))
            passed += (through[:, None] * part)[:, :, None] * axes[0][:, None, :]
            returned += (amplitude[:, None] * part)[:, :, None] * axes[1][:, None, :]
        share, back = (0.5 * np.sum(np.abs(behind) ** 2, axis=(1, 2)) for behind in (passed, returned))
        passed, returned = (
            behind / np.sqrt(np.where(power > 0.0, power, 1.0))[:, None, None]
            for behind, power in ((passed, share), (returned, back))
        )
        reflectance = 1.0 - share if mirror is None else np.full(len(share), mirror)
        return AtFace(bent, mirrored, share, reflectance, passed, returned)

    def spread(self, at: Spreading, by_mirror: bool) -> "AtFace":
        """The light of a face that scatters by rings: transmitted light, or that reflected by a mirror, is spread."""
        polished = self.mirrored if by_mirror else self.bent
        spread_directions = spread(polished, at)
        fields = self.returned if by_mirror else self.passed
        fields = turned(fields, polished, spread_directions)
        if by_mirror:
            return replace(self, mirrored=spread_directions, returned=fields)
        return replace(self, bent=spread_directions, passed=fields)


def _bent(
    directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], along: PerRay, index_ratio: PerRay
) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
    """Unit directions by Snell's law, and False for total reflection (Born and Wolf, section 1.5).

    ``normals`` may point to either side, ``along`` is their product with the directions.
    """
    before = np.abs(along)
    squared = 1.0 - index_ratio**2 * (1.0 - before**2)
    passes: Bool[np.ndarray, " n"] = squared > 0.0
    behind = np.sqrt(np.where(passes, squared, 1.0))
    facing = np.where(along < 0.0, -1.0, 1.0)[:, None] * normals
    bent = index_ratio[:, None] * directions + (behind - index_ratio * before)[:, None] * facing
    return bent / np.linalg.norm(bent, axis=1, keepdims=True), passes


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
    glass = media.cover_glass
    rising = directions[:, 2] > 0.0
    if glass is None:
        return points, directions, np.ones(len(points))
    normal = np.tile([0.0, 0.0, 1.0], (int(rising.sum()), 1))
    waves = np.full(len(points), media.wavelength_nm) if wavelengths_nm is None else wavelengths_nm
    outside, within = (np.full(len(normal), index) for index in (media.outside_index, glass.refractive_index))
    first_face = RefractingFace(outside, within, glass.coating, waves[rising], True)
    other = RefractingFace(within, outside, glass.coating, waves[rising], False)
    ahead = directions[rising]
    near = points[rising] + ((glass.distance_mm - points[rising, 2]) / ahead[:, 2])[:, None] * ahead
    first = AtFace.of(first_face, ahead, normal, unpolarised(ahead) if fields is None else fields[rising])
    inside = first.bent
    lengths = glass.thickness_mm / inside[:, 2]
    second = AtFace.of(other, inside, normal, first.passed)
    ends = points.copy()
    ways = directions.copy()
    share = np.ones(len(points))
    ends[rising] = near + lengths[:, None] * inside
    ways[rising] = second.bent
    share[rising] = first.transmittance * np.exp(-glass.absorption_per_mm * lengths) * second.transmittance
    return ends, ways, share


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)
