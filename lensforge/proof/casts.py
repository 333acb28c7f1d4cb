"""Rays cast through the files of the part: the verbs ``verify`` and ``stray_light``.

Here the design and its verification meet: what the casts get of the design are plain numbers.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from lensforge import seeds
from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate, inputs_of, judging_source, rays_of
from lensforge.proof.proof_result import Proof, StrayLight
from lensforge.proof.sandboxed_casts import stray_in_sandbox, verify_in_sandbox
from lensforge.results.arguments import count_of, require, threads_of_torch
from lensforge.results.child_pool import IN_TURN, ChildPool
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec
from lensforge.spec.accuracy import preset_of

if TYPE_CHECKING:
    from lensforge.proof.optical_faces import OpticalFaces
    from lensforge.proof.part_comparison import Expected


def verify(part: Part, light: Light, *, rays: int | None = None, threads: int | None = None) -> Proof:
    """Cast rays through the STL and STEP of ``part``, and compare their landings with the design's.

    ``light``: of the same lens. The ray cast shares no code with the design's tracer; further rays are drawn by code
    that shares nothing with its sampler, and make the light of the design; of several lamps that of one. Both files are
    measured, and compared with the size as exported. With a plate the light of all lamps goes through its mesh as well,
    and is compared with their sum.
    """
    with threads_of_torch(threads):
        return verify_with(IN_TURN, part, light, rays)


def verify_with(second: ChildPool, part: Part, light: Light, rays: int | None = None) -> Proof:
    """Do as :func:`verify` does, with a second process for referees that hold Python's lock; the same bits."""
    import torch

    from lensforge.proof.form_inputs import designed_files
    from lensforge.proof.mitsuba_cast import RAYS as MITSUBA_RAYS
    from lensforge.proof.mitsuba_cast import installed as mitsuba_installed
    from lensforge.proof.proof_inputs import independent_light, lamps_on_plate, optical_of
    from lensforge.proof.verification import FilesOfPart, LightOfDesign, Referees

    lens, spec = require(part, Part, "verify").lens, part.lens.spec
    rays = count_of("rays", rays)
    whole, known = light, require(light, Light, "verify").inputs
    wanted = inputs_of(lens, spec.source)
    for name, words in (("lens", "another lens than the part"), ("source", "another source than the spec's")):
        if known.get(name) != wanted[name]:
            raise InputError(f"verify: the light is that of {words}; evaluate the part's lens with its own source")
    lens, light = _of_one_lamp(lens, light)
    spec, preset, source = lens.spec, preset_of(lens.accuracy), judging_source(spec)
    count, conditions = rays_of(rays, preset.verify_rays, source)
    bundle = source.sample(count, seeds.of_verification(lens.seed))
    optical = optical_of(lens.body, lens.events)
    lamps = lamps_on_plate(part.plate_stl, part.lens, whole, bundle, optical)
    files = FilesOfPart(
        part.stl,
        part.step,
        lamps,
        designed=list(designed_files(part)),
        exported=part.size,
        chord_mm=1e-3 * part.triangulation.chord_error_um,
        inputs={"lens": part.lens.sha256, "export": part.sha256, "evaluate": whole.sha256},
    )
    of_design = LightOfDesign(
        bundle,
        lens.media,
        expected_of(lens, light, bundle, optical),
        names=[receiver.name for receiver in light.receivers],
        own=independent_light(lens, source, light, count),
        optical=optical,
    )
    referees = Referees(mitsuba_rays=MITSUBA_RAYS if mitsuba_installed() else 0)
    proof = verify_in_sandbox(files, of_design, referees, torch.get_num_threads(), second)
    return proof.changed(conditions=conditions, altered_files=part.altered)


def expected_of(lens: Lens, light: Light, rays: RayBundle, optical: "OpticalFaces") -> "list[Expected]":
    """Results of the design for ``rays`` on each receiver, whose ``light`` is known; faces by the numbers of a part."""
    from lensforge.light.simulation import TracedLens, design_landings
    from lensforge.proof.part_comparison import Expected
    from lensforge.proof.proof_inputs import screens_of

    traced = TracedLens.of(lens, preset_of(lens.accuracy).evaluate_nodes_per_sigma)
    screens, landed = screens_of(lens.spec, light.pixels), design_landings(traced, lens.spec, rays)
    order = optical.numbers_of(traced.scene.names)
    return [
        Expected(screen, lit.map, own.hits, own.flux, own.fates, None if own.met is None else order[own.met])
        for screen, lit, own in zip(screens, light.receivers, landed, strict=True)
    ]


def _of_one_lamp(lens: Lens, light: Light) -> tuple[Lens, Light]:
    """The lens without other lamps, and its light: what a cast through one part can show."""
    if lens.spec.all_lamps.is_single:
        return lens, light
    alone = replace(lens, spec=_of_first_lamp(lens), others={})
    return alone, evaluate(alone, rays=light.rays, pixels=light.pixels)


def _of_first_lamp(lens: Lens) -> Spec:
    """The spec of one lamp at the origin, of those with heights and aims the first with ``lens``, and what it sees."""
    from lensforge.scene.receiver_shapes import seen_by_lamp

    lamps = lens.spec.all_lamps
    if not lamps.posed:
        return lens.spec.of_one_lamp
    return seen_by_lamp(lens.spec, next((kind.numbers[0] for kind in lamps.kinds if kind.name == lens.kind), 0))


def stray_light(
    part: Part, *, rays: int | None = None, base: Literal["polished", "black"] = "polished", threads: int | None = None
) -> StrayLight:
    """Follow rays through the part with reflections and the base, which the sequential design leaves out.

    Where the part has a plate they go through all of it, from the lamp nearest to its middle, which is at the origin.
    """
    import torch

    from lensforge.proof.proof_inputs import optical_of, plate_of, screens_of

    lens, spec = require(part, Part, "stray_light").lens, part.lens.spec
    rays = count_of("rays", rays)
    preset, source = preset_of(lens.accuracy), judging_source(spec)
    count, conditions = rays_of(rays, min(preset.verify_rays, preset.stray_rays), source)
    optical, stl = optical_of(lens.body, lens.events), part.stl
    if spec.plate is not None and part.plate_stl is not None:
        optical, stl = replace(optical, plate=plate_of(spec.plate.lenses(spec.lamps))), part.plate_stl
    with threads_of_torch(threads):
        stray = stray_in_sandbox(
            stl,
            rays=source.sample(count, seeds.of_verification(lens.seed)),
            media=lens.media,
            screens=screens_of(_of_first_lamp(lens) if spec.all_lamps.posed else spec),
            names=[receiver.name or receiver.kind for receiver in spec.all_receivers],
            base=base,
            optical=optical,
            threads=torch.get_num_threads(),
            inputs={"lens": lens.sha256, "export": part.sha256},
        )
    return stray.changed(conditions=conditions)
