"""Sources of a spec as verification sees them: plain numbers, of which it draws rays of its own.

Files are read by the readers of the design; of the code that draws the design's rays nothing is used.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from numpy.random import Generator

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.evaluation.light import Light
from lensforge.lens import Lens
from lensforge.pictures.reading import read_light
from lensforge.sources.bundle import RayBundle, Rays, Source
from lensforge.sources.dispersion import dispersed
from lensforge.sources.flux import chip_fluxes
from lensforge.sources.photometric import read_photometric
from lensforge.sources.radiance_table import read_radiance
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.spectrum import spectrum_of
from lensforge.sources.unread_rays import blocks_of
from lensforge.spec import Spec
from lensforge.spec.emission import CosineIntensity, IntensitySpec, TableIntensity
from lensforge.spec.source import (
    ChipArraySource,
    ChipsSource,
    DiscSource,
    LuminanceSource,
    RadianceSource,
    RectangleSource,
    SourceSpec,
    SquareSource,
)
from lensforge.verification import emission
from lensforge.verification.own_rays import RAYS, DesignLight, OwnLight


def own_light(lens: Lens, source: Source, light: Light, most: int) -> OwnLight:
    """Rays of verification's own, at most ``most``, and the ``light`` of ``lens`` that theirs is compared with."""
    rays = independent_rays(lens.spec, source, min(most, RAYS), seeds.of_own_rays(lens.seed))
    designs = (
        DesignLight(lit.efficiency.value, lit.efficiency.standard_error, lit.nmse_of_noise) for lit in light.receivers
    )
    return OwnLight(rays, tuple(designs))


def independent_rays(spec: Spec, source: Source, count: int, seed: int) -> RayBundle:
    """Draw ``count`` rays of the source of ``spec``, independent and of equal flux; ``source``: its flux and its files.

    Rays of a file are chosen one by one, in proportion to their flux.
    """
    random, section = np.random.default_rng(seed), spec.source
    if isinstance(source, RaySetEmitter):
        chosen = source.rays.take(_by_flux(source.rays, count, random))
        return replace(chosen, flux=np.full(count, source.flux_w / count))
    points, directions = _drawn(random, count, section)
    points = np.column_stack([points, np.zeros(count)])
    place = (section.rotate_z_deg, section.tilt_deg, section.position_mm)
    rays = emission.posed(points, directions, source.flux_w, *place)
    material = spec.lens.dispersion
    if material is None or section.spectrum is None:
        return rays
    table = spectrum_of(section.spectrum)
    waves = emission.wavelengths(random, count, table.wavelengths_nm, table.power_density)
    return dispersed(rays, waves, material, "source.spectrum")[0]


def _by_flux(rays: Rays, count: int, random: Generator) -> Int[np.ndarray, " n"]:
    """Numbers of rays chosen one by one in proportion to their flux, those of ``random.choice``; one number in memory
    for each ray, where that has four."""
    shares, start = np.empty(len(rays)), 0
    for block in blocks_of(rays):
        shares[start : start + len(block)] = block.flux
        start += len(block)
    shares /= shares.sum()
    np.cumsum(shares, out=shares)
    shares /= shares[-1]
    return np.searchsorted(shares, random.random(count), side="right")


def _drawn(
    random: Generator, count: int, section: SourceSpec
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 3"]]:
    """Start points (mm) in the plane z = 0, and directions, of an emitter before it is put in its place."""
    match section:
        case SquareSource():
            square = _grid(1, 1, (section.side_mm, section.side_mm), (1.0, 1.0))
            return emission.in_rectangles(random, count, *square), emission.along_cosine(random, count, 1.0)
        case RadianceSource():
            table = read_radiance(section.file)
            edges = (table.x_mm, table.y_mm)
            rows = emission.of_radiance(random, count, edges, table.c_deg, table.gamma_deg, table.radiance)
            return rows[:, :2], rows[:, 2:]
        case RectangleSource():
            whole = _grid(1, 1, (section.width_mm, section.height_mm), (1.0, 1.0))
            points = emission.in_rectangles(random, count, *whole)
        case ChipArraySource():
            chips = _grid(section.columns, section.rows, (section.width_mm, section.height_mm), section.pitch_mm)
            points = emission.in_rectangles(random, count, *chips)
        case ChipsSource():
            points = emission.in_rectangles(random, count, *_chips(section))
        case DiscSource():
            points = emission.in_disc(random, count, 0.5 * section.diameter_mm)
        case LuminanceSource():
            picture = read_light(section.file, section.luminance, missing="give an image file")
            points = emission.in_picture(random, count, picture, section.width_mm)
        case _:
            raise InputError(f"source: {section.kind}: no rays of its own can be drawn of it; please report it")
    return points, _aimed(random, count, section.intensity)


def _aimed(random: Generator, count: int, profile: IntensitySpec) -> Float[np.ndarray, "n 3"]:
    """Directions of an intensity profile."""
    if isinstance(profile, CosineIntensity):
        return emission.along_cosine(random, count, profile.power)
    if isinstance(profile, TableIntensity):
        plane = np.array([profile.intensity])
        return emission.along_table(random, count, np.zeros(1), np.array(profile.gamma_deg), plane)
    table = read_photometric(profile.file).intensity
    found = emission.along_table(random, count, table.c_deg, table.gamma_deg, table.values)
    found[:, 1] *= -1.0  # a luminaire's C = 90 is the lens's -y
    return found


_Rectangles = tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2"], Float[np.ndarray, " k"]]


def _grid(columns: int, rows: int, side_mm: tuple[float, float], pitch_mm: tuple[float, float]) -> _Rectangles:
    """Centres, sides (mm) and shares of equal rectangles in rows and columns about the axis."""
    cells = np.array([[column, row] for row in range(rows) for column in range(columns)])
    centres = (cells - 0.5 * np.array([columns - 1, rows - 1])) * pitch_mm
    return centres, np.tile(side_mm, (len(cells), 1)), np.ones(len(cells))


def _chips(section: ChipsSource) -> _Rectangles:
    """Centres, sides (mm) and fluxes of the chips."""
    centres = np.array([[chip.x_mm, chip.y_mm] for chip in section.chips])
    sides = np.array([[chip.width_mm, chip.height_mm] for chip in section.chips])
    return centres, sides, np.array([flux.flux_w for flux in chip_fluxes(section)])
