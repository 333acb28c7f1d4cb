"""Inputs of verification from a spec: plain numbers from which it makes receivers and draws rays independently.

Files are read by the readers of the design; of the code that draws the design's rays nothing is used.
"""

from dataclasses import asdict, astuple, replace
from functools import singledispatch
from math import isfinite
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.random import Generator

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.optics.face_roles import BODY, DRAWN_END
from lensforge.optics.image_reading import read_light
from lensforge.proof import independent_draws
from lensforge.proof.obstacles import ObstacleBody, Obstacles
from lensforge.proof.optical_faces import Expansion, OpticalFaces, PlateOfLenses
from lensforge.proof.part_comparison import RAYS, IndependentLight, LampsApart, LampsOnPlate, LampStands
from lensforge.proof.patched_body import PatchedBody
from lensforge.proof.receiver_screen import Screen
from lensforge.scene.body import Body, radii
from lensforge.scene.body_patches import BodyPatches
from lensforge.scene.housing_mesh import mesh_of
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import Window
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.light_files import read_photometric
from lensforge.sources.measured_rays import RefittedSource
from lensforge.sources.radiance_emitter import read_radiance
from lensforge.sources.ray_bundle import RayBundle, Rays, Source, blocks_of
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.source_flux import chip_fluxes
from lensforge.sources.source_spectrum import spectrum_of
from lensforge.spec import Spec
from lensforge.spec.emitter_section import CosineIntensity, EmitterSection, IntensitySpec, SpectrumSpec, TableIntensity
from lensforge.spec.housing_sections import HousingSection, bodies_of
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.source_sections import (
    ChipArraySource,
    ChipsSource,
    DiscSource,
    LuminanceSource,
    RadianceSource,
    RectangleSource,
    SquareSource,
)
from lensforge.surfaces.solid_file import SolidMesh
from lensforge.surfaces.surface import grid, to_sphere

_Points = independent_draws.Points
_Drawn = tuple[_Points, independent_draws.Directions]
_NODES = 385  # of the chart's grid on which faces are sorted: they are 0.005 apart


def optical_of(body: Body, events: int = 2) -> OpticalFaces:
    """Faces of ``body``, whose light has at most ``events`` events; with their shapes if several lie on one side."""
    names, away = zip(*((face.name, face.before == BODY) for face in body.faces), strict=True)
    if len(body.cavity) == len(body.envelope) == 1:
        return OpticalFaces(names, away, events)
    chart = grid(_NODES, 1.0)
    chart = chart / np.maximum(np.linalg.norm(chart, axis=-1, keepdims=True), 1.0)  # no face is beyond the rim
    opening = next((number for number, face in enumerate(body.faces) if face.is_open), None)
    flange = next((number for number, face in enumerate(body.faces) if face.is_flange), None)
    flange_mm = None if flange is None else float(body.faces[flange].surface.radius(np.array([[1.0, 0.0, 0.0]]))[0])
    tables = 1.0 / radii(body.faces, to_sphere(chart))
    return OpticalFaces(names, away, events, tables, opening=opening, flange_face=flange, flange_mm=flange_mm)


def optical_at_work(lens: Lens) -> OpticalFaces:
    """The faces of ``lens``, whose part has the size of its temperature at work."""
    expansion = Expansion(lens.spec.lens.scale, lens.spec.base.seat_mm)
    length_mm = lens.spec.lens.drawn_mm
    optical = replace(optical_of(lens.body, lens.events), expansion=expansion)
    if length_mm is None:
        return optical
    names, away = (*optical.names, DRAWN_END.name), (*optical.away, True)
    return replace(optical, names=names, away=away, flange_face=len(optical.names), end_mm=0.5 * length_mm)


def plate_of(lamps: Lamps) -> PlateOfLenses:
    """The lenses of a plate; the one of the first kind nearest to the origin is lit."""
    places = np.array(lamps.places_mm)
    first = np.array(lamps.kind_of_each) == 0
    lit = int(np.where(first, np.hypot(*places.T), np.inf).argmin())
    return PlateOfLenses(places, np.radians(lamps.turns_deg), lit, lamps.kind_of_each)


def optical_on(plate: PlateOfLenses, lens: Lens) -> OpticalFaces:
    """The faces of a ``plate`` that is made with ``lens``."""
    kinds = tuple(optical_of(kind.body, kind.events) for kind in lens.kinds)
    return replace(kinds[0], plate=plate, of_kinds=kinds)


def lamps_together(stl: bytes | None, lit: tuple[Lens, Light], rays: RayBundle) -> LampsOnPlate | LampsApart | None:
    """The cast of all lamps; None for a single one.

    ``stl``: of their plate, if any. ``lit``: the lens with all lamps on the plate, else with all lamps that have it,
    and their light; ``rays``: of one lamp.
    """
    lens, light = lit
    spec = lens.spec
    lamps = lens.spec.all_lamps
    if (len(lamps) == 1 and lamps.period_mm is None) or (stl is None and lens.lamps_on_plate):
        return None
    drawn = np.random.default_rng(seeds.of_verification(lens.seed)).permutation(len(rays)) % len(lamps)
    designed = [
        (lit.name, replace(screen, rows=len(lit.map), columns=len(lit.map[0])), lit.map)
        for lit, screen in zip(light.receivers, screens_of(spec, light.pixels), strict=True)
    ]
    if stl is None or not lens.lamps_on_plate:
        return LampsApart(stands_of(lamps), drawn, designed)
    plate = replace(plate_of(lamps), lit=None)
    return LampsOnPlate(stl, plate.placed(rays, drawn), optical_on(plate, lens), designed)


def stands_of(lamps: Lamps) -> LampStands:
    """Places and axes of ``lamps``."""
    axes = [independent_draws.stand(lamp.axis, lamp.turn_deg) for lamp in lamps.lamps]
    return LampStands(np.array([lamp.place_mm for lamp in lamps.lamps]), np.array(axes))


def screens_of(spec: Spec, pixels: int | None = None) -> list[Screen]:
    """Screens with as many pixels as the evaluation's images, by default those of the spec."""
    receivers = receivers_of(spec, pixels or spec.evaluate.pixels)
    near, far = (
        Obstacles.of(
            [_obstacle(body, mesh_of(body)) for body in bodies_of(spec.scene, from_afar=from_afar)], spec.scene_events
        )
        for from_afar in (False, True)
    )
    return [
        Screen.kinds[section.kind](
            centre_mm=section.centre_mm,
            facing=section.facing,
            rotation_deg=section.rotation_deg,
            **asdict(receiver.grid),
            window=_bounds(receiver.window),
            filter_variance=spec.evaluate.filter_variance,
            numbers={name: value for name, value in section if isinstance(value, float)},
            period_mm=spec.all_lamps.period_mm,
            obstacles=far if receiver.is_far else near,
        )
        for section, receiver in zip(spec.all_receivers, receivers, strict=True)
    ]


def _bounds(window: Window) -> tuple[float | None, float | None, float | None]:
    width, height, radius = (side if isfinite(side) else None for side in astuple(window))
    return width, height, radius


def _obstacle(body: HousingSection, mesh: SolidMesh) -> ObstacleBody:
    return ObstacleBody(
        mesh.vertices,
        mesh.triangles,
        body.rotate_z_deg,
        body.tilt_deg,
        body.centre_mm,
        reflectance=body.reflectance or 0.0,
        diffuse=body.surface == "diffuse",
        refractive_index=body.index,
        absorption_per_mm=body.absorption_per_mm or 0.0,
    )


def _patched_bodies(spec: Spec, light: Light) -> tuple[PatchedBody, ...]:
    """Measured bodies of the scene, with the irradiance by the design; ``light``: of one lamp."""
    irradiance = {body.name: body.irradiance for body in light.on_bodies}
    patched = []
    bodies = bodies_of(spec.scene)
    for body in bodies:
        if body.name in irradiance:
            patches = BodyPatches.of(body)
            pieces = SolidMesh(patches.corners.reshape(-1, 3), np.arange(patches.corners.size // 3).reshape(-1, 3))
            others = [_obstacle(other, mesh_of(other)) for other in bodies if other is not body]
            placed = _obstacle(body, pieces)
            designed = irradiance[body.name], light.rays
            patched.append(PatchedBody(body.name, placed, patches.numbers, others, *designed, spec.scene_events))
    return tuple(patched)


def independent_light(lens: Lens, source: Source, light: Light, most: int) -> IndependentLight:
    """Verification's own rays, at most ``most``, and the ``light`` of ``lens`` to compare theirs with."""
    seed = seeds.of_own_rays(lens.seed)
    rays = independent_rays(lens.spec, source, min(most, RAYS), seed)
    designs = tuple((lit.efficiency, lit.nmse_of_noise) for lit in light.receivers)
    return IndependentLight(rays, designs, seed, _patched_bodies(lens.spec, light))


def independent_rays(spec: Spec, source: Source, count: int, seed: int) -> RayBundle:
    """Draw ``count`` rays of the source of ``spec``, independent and of equal flux; ``source``: its flux and its files.

    Rays of a file are chosen one by one, in proportion to their flux; each only once if a model of the file is
    evaluated, for which they are a sample of the LED.
    """
    random = np.random.default_rng(seed)
    section = spec.source
    if isinstance(source, RefittedSource):
        file = source.file
        assert isinstance(file, RaySetEmitter)
        numbers = _once(file.rays, count, random)
        return replace(file.rays.take(numbers), flux=np.full(len(numbers), source.flux_w / len(numbers)))
    if isinstance(source, RaySetEmitter):
        chosen = source.rays.take(_by_flux(source.rays, count, random))
        return replace(chosen, flux=np.full(count, source.flux_w / count))
    points, directions = drawn_rays(section, random, count)
    points = np.column_stack([points, np.zeros(count)])
    place = (section.rotate_z_deg, section.tilt_deg, section.position_mm)
    rays = independent_draws.posed(points, directions, source.flux_w, *place)
    if spec.lens.dispersion is None:
        return rays
    if isinstance(section, ChipsSource) and section.spectra:
        return rays.with_wavelengths(_of_chips(random, points[:, :2], section))
    return rays if section.spectrum is None else rays.with_wavelengths(_waves(random, count, section.spectrum))


def _waves(random: Generator, count: int, spectrum: SpectrumSpec) -> Float[np.ndarray, " n"]:
    table = spectrum_of(spectrum)
    return independent_draws.wavelengths(random, count, table.wavelengths_nm, table.power_density)


def _of_chips(random: Generator, points: Float[np.ndarray, "n 2"], section: ChipsSource) -> Float[np.ndarray, " n"]:
    """Wavelengths (nm) of rays that start at ``points`` (mm) of chips with spectra of their own."""
    waves = np.zeros(len(points))
    for chip, spectrum in zip(section.chips, section.spectra, strict=True):
        sides = np.array([chip.width_mm, chip.height_mm])
        on_chip = (np.abs(points - [chip.x_mm, chip.y_mm]) <= 0.5 * sides).all(axis=1)
        assert spectrum is not None, "the source itself refuses it"
        waves[on_chip] = _waves(random, int(on_chip.sum()), spectrum)
    return waves


def _once(rays: Rays, count: int, random: Generator) -> Int[np.ndarray, " n"]:
    """Numbers of at most ``count`` rays in proportion to flux: none twice but the strongest."""
    flux = np.concatenate([block.flux for block in blocks_of(rays)])
    count = min(count, int(flux.sum() ** 2 / np.sum(flux**2)))
    order = random.permutation(len(flux))
    shares = np.cumsum(flux[order])
    wanted = (np.arange(count) + random.random()) * (shares[-1] / count)
    return random.permutation(order[np.minimum(np.searchsorted(shares, wanted), len(order) - 1)])


def _by_flux(rays: Rays, count: int, random: Generator) -> Int[np.ndarray, " n"]:
    """Numbers of rays drawn in proportion to flux, as ``random.choice`` draws them, in a quarter of its memory."""
    shares = np.empty(len(rays))
    start = 0
    for block in blocks_of(rays):
        shares[start : start + len(block)] = block.flux
        start += len(block)
    shares /= shares.sum()
    np.cumsum(shares, out=shares)
    shares /= shares[-1]
    return np.searchsorted(shares, random.random(count), side="right")


@singledispatch
def drawn_rays(section: Any, random: Generator, count: int) -> _Drawn:
    """Start points (mm) in the plane z = 0, and directions, of an emitter in its own frame.

    A kind of source registers its function here, or in :func:`drawn_points` if all its points are alike.
    """
    return drawn_points(section, random, count), _aimed(random, count, section.intensity)


@drawn_rays.register
def _(section: SquareSource, random: Generator, count: int) -> _Drawn:
    square = _grid(1, 1, (section.side_mm, section.side_mm), (1.0, 1.0))
    return independent_draws.in_rectangles(random, count, *square), independent_draws.along_cosine(random, count, 1.0)


@drawn_rays.register
def _(section: RadianceSource, random: Generator, count: int) -> _Drawn:
    table = read_radiance(section.file)
    edges = (table.x_mm, table.y_mm)
    rows = independent_draws.of_radiance(random, count, edges, table.c_deg, table.gamma_deg, table.radiance)
    return rows[:, :2], rows[:, 2:]


@singledispatch
def drawn_points(section: EmitterSection, random: Generator, count: int) -> _Points:
    """Start points (mm) in the plane z = 0 of a source whose points all have the same intensity profile."""
    raise InputError(f"source: {section.kind}: no rays of its own can be drawn of it; please report it")


@drawn_points.register(RectangleSource | ChipArraySource | ChipsSource)
def _(section: RectangleSource | ChipArraySource | ChipsSource, random: Generator, count: int) -> _Points:
    return independent_draws.in_rectangles(random, count, *_rectangles(section))


drawn_points.register(
    DiscSource, lambda section, random, count: independent_draws.in_disc(random, count, 0.5 * section.diameter_mm)
)


@drawn_points.register
def _(section: LuminanceSource, random: Generator, count: int) -> _Points:
    picture = read_light(section.file, section.luminance, missing="give an image file")
    return independent_draws.in_picture(random, count, picture, section.width_mm)


def _aimed(random: Generator, count: int, profile: IntensitySpec) -> Float[np.ndarray, "n 3"]:
    if isinstance(profile, CosineIntensity):
        return independent_draws.along_cosine(random, count, profile.power)
    if isinstance(profile, TableIntensity):
        plane = np.array([profile.intensity])
        return independent_draws.along_table(random, count, np.zeros(1), np.array(profile.gamma_deg), plane)
    table = read_photometric(profile.file).intensity
    directions = independent_draws.along_table(random, count, table.c_deg, table.gamma_deg, table.values)
    directions[:, 1] *= -1.0  # a luminaire's C = 90 is the lens's -y
    return directions


_Rectangles = tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2"], Float[np.ndarray, " k"]]


def _grid(columns: int, rows: int, side_mm: tuple[float, float], pitch_mm: tuple[float, float]) -> _Rectangles:
    """Centres, sides (mm) and shares of equal rectangles in rows and columns about the axis."""
    cells = np.array([[column, row] for row in range(rows) for column in range(columns)])
    centres = (cells - 0.5 * np.array([columns - 1, rows - 1])) * pitch_mm
    return centres, np.tile(side_mm, (len(cells), 1)), np.ones(len(cells))


def _rectangles(section: RectangleSource | ChipArraySource | ChipsSource) -> _Rectangles:
    if isinstance(section, RectangleSource):
        return _grid(1, 1, (section.width_mm, section.height_mm), (1.0, 1.0))
    if isinstance(section, ChipArraySource):
        return _grid(section.columns, section.rows, (section.width_mm, section.height_mm), section.pitch_mm)
    centres = np.array([[chip.x_mm, chip.y_mm] for chip in section.chips])
    sides = np.array([[chip.width_mm, chip.height_mm] for chip in section.chips])
    return centres, sides, np.array([flux.flux_w for flux in chip_fluxes(section)])
