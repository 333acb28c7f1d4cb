"""Verification of an exported part: does it send every ray where the design does?

The same rays go through the design and through the part, so the comparison is free of ray noise: landing by landing,
flux by flux, pixel by pixel. A lens that is scaled by one per cent, or whose surfaces are displaced by 20 um, makes a
picture that looks the same; its rays land elsewhere.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from lensforge.errors import InputError
from lensforge.optics.media import Media
from lensforge.proof.acceptance import BREP_RAYS, DEVIATION_RAD, OF_SPREAD
from lensforge.proof.cast_results import SizedFile, Sizes
from lensforge.proof.facet_casting import Grid
from lensforge.proof.file_form import DesignedFile
from lensforge.proof.mesh_form import mesh_forms
from lensforge.proof.mitsuba_cast import cast_mitsuba
from lensforge.proof.optical_faces import USUAL_LENS, OpticalFaces
from lensforge.proof.part_comparison import (
    Expected,
    IndependentLight,
    LampsApart,
    LampsOnPlate,
    compare,
    emission_difference,
    flux_budget,
    gap_quantiles,
    judge_independent_rays,
    light_of_lamps,
    share,
)
from lensforge.proof.part_mesh import PartMesh, read_part_mesh, sized_mesh
from lensforge.proof.proof_result import BodyLightProof, IndependentRays, Proof, ReceiverProof
from lensforge.proof.receiver_screen import nmse
from lensforge.proof.sequential_cast import LandedRays, Passage, send_through, send_through_body
from lensforge.proof.step_cast import StepCast, cast_step, form_of_step, judge_brep, read_step
from lensforge.proof.trimesh_cast import cast_plain
from lensforge.results import BodySize, Extent
from lensforge.results.child_pool import IN_TURN, ChildPool
from lensforge.sources.ray_bundle import RayBundle


@dataclass(frozen=True, eq=False)
class FilesOfPart:
    """Files of a part: the bytes of its STL (mm) and of its STEP; without the latter ``brep`` of the proof is None.

    ``lamps``: all that have the part, on a plate or apart, whose light is compared with their sum. ``designed``: every
    file of the part, these among them, to compare its form. ``exported``: size of the part as exported, its box within
    ``chord_mm`` of the solid's. ``inputs``: hashes of what it was made from, by name.
    """

    stl: bytes
    step: bytes | None = None
    lamps: LampsOnPlate | LampsApart | None = None
    designed: Sequence[DesignedFile] = ()
    exported: BodySize | None = None
    chord_mm: float = 0.0
    inputs: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class LightOfDesign:
    """Rays and the design's results on each receiver, of ``names``: its light, and their landings.

    ``polished``: the same of a lens whose faces scatter, were they polished: rays are compared one by one there, since
    some facets turn light almost along themselves, and magnify an error of a normal without limit. ``independent``:
    further rays, drawn by independent code, and the light of the design to compare theirs with. ``optical``: the faces
    of the part, and the events of its light.
    """

    rays: RayBundle
    media: Media
    expected: Sequence[Expected]
    polished: Sequence[Expected] | None = None
    names: Sequence[str] = ("light",)
    independent: IndependentLight | None = None
    optical: OpticalFaces = USUAL_LENS


@dataclass(frozen=True)
class Referees:
    """Rays that each further tracer casts: trimesh's own ray cast, the CAD kernel through the STEP, and Mitsuba.

    With 0 Mitsuba is not loaded, and ``mitsuba`` of the proof is None.
    """

    plain_rays: int = 200
    step_rays: int = BREP_RAYS
    mitsuba_rays: int = 0


def verify_part(
    files: FilesOfPart,
    light: LightOfDesign,
    referees: Referees = Referees(),
    *,
    threads: int = 1,
    second: ChildPool = IN_TURN,
) -> Proof:
    """Cast the rays into the part in the bytes of its files, and compare with the design.

    The result does not depend on ``threads``. ``second``: casts by the CAD kernel and by trimesh, where there is one.

    Raises :class:`InputError` for bytes that hold no mesh or no solid and for arrays that do not fit; a wrong part
    misses its criteria instead.
    """
    rays = light.rays
    media = light.media
    expected = light.expected
    optical = light.optical
    bare = media.polished
    by_ray = light.polished or expected
    limit_rad = DEVIATION_RAD + OF_SPREAD * media.spread_rad
    step = files.step
    lamps = files.lamps
    independent = light.independent
    exported = files.exported
    started = perf_counter()
    _require_rays(rays, expected)
    through = None
    designed = None
    if step is not None:
        # Here it is read before the casts: a file that is refused costs no more than that.
        file = step if second.runs else read_step(step, optical)
        designed = next((file for file in files.designed if file.content == step), None)
        sized = exported is not None
        through = cast_step(
            file, rays, bare, referees.step_rays, optical=optical, sized=sized, designed=designed, second=second
        )
    solids = {
        file.name: second.call(form_of_step, file) for file in files.designed if file.is_step and file is not designed
    }
    part = read_part_mesh(files.stl, optical)
    plates = {lamps.stl: lamps.part.mesh} if isinstance(lamps, LampsOnPlate) else {}
    grid = Grid(part.mesh)
    plain = cast_plain(part, grid, rays, bare, referees.plain_rays, second)
    passage = send_through(part, grid, rays, media, threads)
    alone = passage if light.polished is None else send_through(part, grid, rays, bare, threads)
    none: list[Any] = [None] * len(expected)
    by_mitsuba = cast_mitsuba(part, rays, media, expected, referees.mitsuba_rays) if referees.mitsuba_rays else none
    by_own = none
    on_bodies: tuple[BodyLightProof, ...] = ()
    if independent is not None:
        independent_passage = send_through(part, grid, independent.rays, media, threads, independent.seed)
        by_own = _own_light(independent, independent_passage, expected)
        on_bodies = tuple(body.judge(independent.rays, independent_passage) for body in independent.bodies)
    compared = plain()
    cast = None if through is None else through()
    by_step = none if cast is None else judge_brep(cast, rays, by_ray, alone)
    received = tuple(
        _on_receiver(name, rays, passage, by_design, (alone.landed(by_design.screen), polished), other_casts, limit_rad)
        for name, by_design, polished, *other_casts in zip(
            light.names, expected, by_ray, by_step, by_mitsuba, by_own, strict=True
        )
    )
    sizes = None if exported is None else _sizes(part, cast, exported, files.chord_mm)
    known = {files.stl: part.mesh} | plates
    forms = mesh_forms(files.designed, known) | {name: solid.result() for name, solid in solids.items()}
    if cast is not None and cast.form is not None:
        forms[cast.form.name] = cast.form
    heights = np.abs(passage.facets_um)
    return Proof(
        inputs=dict(files.inputs),
        receivers=received,
        rays=len(rays),
        triangles=len(part.mesh.faces),
        open_edges=part.open_edges,
        volume_mm3=float(part.mesh.volume),
        sizes=sizes,
        emission_apart=None if independent is None else emission_difference(independent.rays, rays),
        facet_height_um=Extent(rms=float(np.sqrt(np.mean(heights**2))), max=float(heights.max())),
        far_facets=part.far,
        plain_cast=compared,
        together=() if lamps is None else light_of_lamps(lamps, passage, rays, media, threads),
        on_bodies=on_bodies,
        forms=tuple(forms[file.name] for file in files.designed),
        on_plate=isinstance(lamps, LampsOnPlate),
        seconds=perf_counter() - started,
    )


def passage_through(file: bytes, optical: OpticalFaces, media: Media, rays: RayBundle) -> Passage:
    """Exit points, directions, flux and fates of ``rays`` through a STEP or STL file, to be compared ray by ray."""
    if file.lstrip().startswith(b"ISO-10303-21"):
        return send_through_body(read_step(file, optical), rays, media)
    part = read_part_mesh(file, optical)
    return send_through(part, Grid(part.mesh), rays, media)


def _own_light(independent: IndependentLight, passage: Passage, expected: Sequence[Expected]) -> list[IndependentRays]:
    pairs = zip(expected, independent.designs, strict=True)
    return [judge_independent_rays(independent.rays, passage, by_design, design) for by_design, design in pairs]


def _sizes(part: PartMesh, cast: StepCast | None, exported: BodySize, chord_mm: float) -> Sizes:
    step = None if cast is None or cast.size is None else SizedFile(size=cast.size)
    return Sizes(exported=exported, chord_mm=chord_mm, mesh=sized_mesh(part.mesh), step=step)


def _require_rays(rays: RayBundle, expected: Sequence[Expected]) -> None:
    """Raise :class:`InputError` for rays without flux, and for arrays of other lengths."""
    for receiver in expected:
        receiver.require_shapes(len(rays))
    flux = float(rays.flux.sum())
    if not flux > 0.0:
        raise InputError(f"rays: {len(rays)} rays carry {flux:g} W, must be above 0; is the source empty?")


def _on_receiver(
    name: str,
    rays: RayBundle,
    passage: Passage,
    expected: Expected,
    by_ray: tuple[LandedRays, Expected],
    other_casts: Sequence[Any],
    limit_rad: float,
) -> ReceiverProof:
    """The light on a receiver; ``by_ray``: of polished faces, compared ray by ray; ``other_casts``: of the referees."""
    brep, mitsuba, own_rays = other_casts
    screen = expected.screen
    landed = passage.landed(expected.screen)
    image, off, noise_floor = screen.against(landed.landings, landed.flux, expected.irradiance)
    flux = flux_budget(rays, landed, screen)
    return ReceiverProof(
        name=name,
        width=screen.width,
        height=screen.height,
        far_field=screen.is_far,
        nmse_vs_design=off,
        noise_floor_nmse=noise_floor,
        nmse_same_rays=nmse(image, screen.irradiance(expected.landings, expected.flux)),
        efficiency=flux.detected,
        efficiency_design_same_rays=share(rays, expected.flux[screen.in_window(expected.landings)]),
        against_design=compare(rays, *by_ray),
        deviation_limit_mm=limit_rad * screen.reach_mm(expected.irradiance),
        flux=flux,
        brep=brep[0] if brep else None,
        mitsuba=mitsuba[0] if mitsuba else None,
        own_rays=own_rays,
        irradiance=image,
        design_irradiance=expected.irradiance,
        gaps_mesh_mm=gap_quantiles(*by_ray),
        gaps_step_mm=brep[1] if brep else None,
        gaps_mitsuba_mm=mitsuba[1] if mitsuba else None,
    )
