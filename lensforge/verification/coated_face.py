"""Faces that rays refract at, and what they transmit; coatings apart from the design's code and its tables.

A stack of layers is summed ray by ray, the layer next to the last medium first (Rouard; Macleod, Thin-Film Optical
Filters, 2.3), a table interpolated as the specification says.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.interpolate import PchipInterpolator

from lensforge.optics.media import Coating, LayerStack, Media, ReflectanceTable
from lensforge.sources.bundle import RayBundle

PerRay = Float[np.ndarray, " n"]
Amplitudes = Complex[np.ndarray, " n"]


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

    @staticmethod
    def inner(rays: RayBundle, media: Media) -> "RefractingFace":
        """The face by which ``rays`` enter the body."""
        cavity = np.full(len(rays), media.cavity_index)
        return RefractingFace(cavity, rays.indices(media), media.inner_coating, rays.wavelengths(media), True)

    @staticmethod
    def outer(rays: RayBundle, media: Media) -> "RefractingFace":
        """The face by which they leave it."""
        outside = np.full(len(rays), media.outside_index)
        return RefractingFace(rays.indices(media), outside, media.outer_coating, rays.wavelengths(media), False)

    def take(self, rows: Int[np.ndarray, " k"]) -> "RefractingFace":
        """The face for some of the rays."""
        before, behind, waves = (values[rows] for values in (self.before, self.behind, self.wavelengths_nm))
        return RefractingFace(before, behind, self.coating, waves, self.inwards)

    @property
    def index_ratio(self) -> PerRay:
        """n before / n behind."""
        ratio: PerRay = self.before / self.behind
        return ratio

    def reflected(self, cosines: PerRay, passes: Bool[np.ndarray, " n"]) -> tuple[Amplitudes, Amplitudes]:
        """Amplitudes of s and p that rays are reflected with which meet it at ``cosines``; p of opposite sign.

        All light is reflected where it does not pass. A table of unpolarised reflectance holds for s and p alike.
        """
        cosines = np.minimum(cosines, 1.0)
        along = self.before * np.sqrt(1.0 - cosines**2)  # n sin of the angle
        if isinstance(self.coating, ReflectanceTable):
            sines = np.minimum(along / np.minimum(self.before, self.behind), 1.0)
            of_table = _of_table(self.coating, np.sqrt(1.0 - sines**2), self.wavelengths_nm)
            r_s = np.sqrt(np.maximum(of_table, 0.0)).astype(complex)
            r_p = -r_s
        else:
            r_s, r_p = self._of_layers(self.coating, along, "s"), -self._of_layers(self.coating, along, "p")
        whole = [each / np.where(each == 0.0, 1.0, np.abs(each)) for each in (r_s, r_p)]
        return np.where(passes, r_s, whole[0]), np.where(passes, r_p, whole[1])

    def _of_layers(self, stack: LayerStack | None, along: PerRay, polarisation: str) -> Amplitudes:
        """Without a stack that of the bare face."""
        own = () if stack is None else stack.layers
        layers = own if self.inwards else own[::-1]
        indices = [self.before, *(layer.index.at(self.wavelengths_nm) for layer in layers), self.behind]
        across = [np.sqrt((index**2 - along**2).astype(complex)) for index in indices]
        admittances = [a if polarisation == "s" else index**2 / np.where(a == 0.0, 1e-300, a)
                       for a, index in zip(across, indices, strict=True)]  # fmt: skip
        amplitude = _step(admittances[-2], admittances[-1])
        for k in range(len(layers) - 1, -1, -1):
            turns = across[k + 1] * layers[k].thickness_nm / self.wavelengths_nm
            returned = amplitude * np.exp(4j * np.pi * turns)
            first = _step(admittances[k], admittances[k + 1])
            amplitude = (first + returned) / (1.0 + first * returned)
        return amplitude


def _step(one: Complex[np.ndarray, " n"], other: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
    """Amplitude reflected between two media."""
    step: Complex[np.ndarray, " n"] = (one - other) / (one + other)
    return step


def _of_table(table: ReflectanceTable, cosines: PerRay, wavelengths_nm: PerRay) -> PerRay:
    angles, rows = list(table.angles_deg), [list(row) for row in table.reflectance]
    if angles[-1] < 90.0:
        angles.append(90.0)
        rows = [[*row, 1.0] for row in rows]
    places = np.sin(np.radians(90.0 - np.array(angles[::-1])))  # the cosines, 0 at 90 degrees
    by_row: list[PerRay] = [PchipInterpolator(places, row[::-1])(cosines) for row in rows]
    if len(rows) == 1:
        return by_row[0]
    waves = np.clip(wavelengths_nm, table.wavelengths_nm[0], table.wavelengths_nm[-1])
    found = np.zeros(len(cosines))
    for k, own in enumerate(by_row):  # each row counts by a hat function about its wavelength
        found += own * np.interp(waves, table.wavelengths_nm, np.eye(len(rows))[k])
    return found
