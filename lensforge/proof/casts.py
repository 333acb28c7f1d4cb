"""Rays cast through the files of the part: the verbs ``verify`` and ``stray_light``.

Here the design and its verification meet: the casts receive only plain numbers from the design.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from lensforge import seeds
from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.kernels.parallel import kernel_threads, thread_count
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate, inputs_of, judging_source, rays_of
from lensforge.proof.proof_result import Proof, StrayLight
from lensforge.proof.sandboxed_casts import stray_in_sandbox, verify_in_sandbox
from lensforge.public import public
from lensforge.results.arguments import count_of, require, with_known_names
from lensforge.results.child_pool import IN_TURN, ChildPool
from lensforge.scene.lens import Lens
from lensforge.sources.measured_rays import rays_of_file
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec
from lensforge.spec.accuracy import preset_of

if TYPE_CHECKING:
    from lensforge.light.simulation import TracedLens
    from lensforge.proof.optical_faces import OpticalFaces
    from lensforge.proof.part_comparison import Expected


@public
@with_known_names
def verify(part: Part, light: Light, *, rays: int | None = None, threads: int | None = None) -> Proof:
    """Cast rays through the STL and STEP files of a part, and compare their landings with the design's.

    The cast shares no code with the design's tracer; further rays are drawn by code of its own, too.

    Args:
        part: the part.
        light: of the same lens and source, by :func:`evaluate`.
        rays: number of rays, from 1; None: the preset's.
        threads: number of threads, from 1; None: all cores.
    Returns: The proof, on every receiver; of several states in each. Of several lamps the rays of one are compared one
        by one, and the light of all with their sum: with a plate through its mesh.
    Raises: :class:`InputError` for the light of another lens or source.
    Example:
        >>> run = lf.load("cad_out/quickstart")
        >>> proof = lf.verify(run.part, run.light, rays=2**14)
        >>> print(proof.nmse_vs_design, proof.deviation_mm.rms)
    """
    with kernel_threads(count_of("threads", threads)):
        return verify_with(IN_TURN, part, light, rays)


def verify_with(second: ChildPool, part: Part, light: Light, rays: int | None = None) -> Proof:
    """:func:`verify`, with a second process for referees that hold Python's lock; the same bits."""
    lens = require(part, Part, "verify").lens
    known = require(light, Light, "verify").inputs
    rays = count_of("rays", rays)
    wanted = inputs_of(lens, lens.spec.source)
    for name, culprit in (("lens", "another lens than the part"), ("source", "another source than the spec's")):
        if known.get(name) != wanted[name]:
            raise InputError(f"verify: the light is that of {culprit}; evaluate the part's lens with its own source")
    lenses = lens.by_state
    by_led = light.by_led
    if missing := [name for name in lenses if name not in by_led]:
        raise InputError(f"verify: the light is without that of {missing[0]!r}; evaluate the lens in all its states")
    inputs = {"lens": lens.sha256, "export": part.sha256, "evaluate": light.sha256}
    first = next(iter(lenses))
    proofs = {
        name: _verified(part, (lens, by_led[name]), rays, inputs, second, measured=name == first)
        for name, lens in lenses.items()
    }
    return Proof.joined(proofs).changed(altered_files=part.altered)


def _verified(
    part: Part, lit: tuple[Lens, Light], rays: int | None, inputs: dict[str, str], second: ChildPool, *, measured: bool
) -> Proof:
    """The proof for a single LED, whose light is known; ``measured``: also form and size of the files."""
    from lensforge.proof.form_inputs import designed_files
    from lensforge.proof.mitsuba_cast import RAYS as MITSUBA_RAYS
    from lensforge.proof.mitsuba_cast import installed as mitsuba_installed
    from lensforge.proof.proof_inputs import independent_light, lamps_together, optical_at_work
    from lensforge.proof.verification import FilesOfPart, LightOfDesign, Referees
    from lensforge.scene.rough_faces import with_facets

    lens, light = lit
    preset = preset_of(lens.accuracy)
    optical = optical_at_work(lens)
    judging = judging_source(lens.spec)
    source = rays_of_file(judging)
    count, conditions = rays_of(rays, preset.verify_rays, source)
    bundle = with_facets(source.sample(count, seeds.of_verification(lens.seed)), lens.media.scattering)
    alone, seen = _light_of_one_lamp(lens, light)
    files = FilesOfPart(
        part.stl,
        part.step,
        lamps_together(part.plate_stl, (lens, light) if lens.lamps_on_plate else _of_own_lamps(lens, light), bundle),
        designed=list(designed_files(part)) if measured else (),
        exported=part.size if measured else None,
        chord_mm=1e-3 * part.triangulation.chord_error_um,
        inputs=inputs,
    )
    of_design = LightOfDesign(
        bundle,
        lens.media,
        expected_of(alone, seen, bundle, optical),
        expected_of(alone, seen, bundle, optical, polished=True) if lens.media.scattering else None,
        names=[receiver.name for receiver in seen.receivers],
        independent=independent_light(alone, judging, seen, count),
        optical=optical,
    )
    by_mitsuba = mitsuba_installed() and not lens.media.has_rings  # it knows facets only
    referees = Referees(mitsuba_rays=MITSUBA_RAYS if by_mitsuba else 0)
    return verify_in_sandbox(files, of_design, referees, thread_count(), second).changed(conditions=conditions)


# Over the tables of light, whose error is a hundredth of its noise: at draft it moves single rays by up to 0.8 of what
# a STEP file may move them. It falls with the fourth power of the nodes.
_TABLES_FINER = 1.5


def traced_exactly(lens: Lens) -> "TracedLens":
    """The lens with tables so fine that they displace no ray by a relevant share of its limit."""
    from lensforge.light.simulation import TracedLens
    from lensforge.surfaces.bicubic_table import most_per_sigma

    finer = _TABLES_FINER * preset_of(lens.accuracy).evaluate_nodes_per_sigma
    return TracedLens.of(lens, min(finer, most_per_sigma(lens.detail_rad)))


def expected_of(
    lens: Lens,
    light: Light | None,
    rays: RayBundle,
    optical: "OpticalFaces",
    *,
    polished: bool = False,
    traced: "TracedLens | None" = None,
) -> "list[Expected]":
    """Results of the design for ``rays`` on each receiver; faces by the numbers of a part.

    ``light``: on the receivers; None: that of the rays. ``polished``: of the rays where no face scatters. ``traced``:
    the lens with other tables than its own.
    """
    from lensforge.light.simulation import design_landings
    from lensforge.proof.part_comparison import Expected
    from lensforge.proof.proof_inputs import screens_of

    traced = traced or traced_exactly(lens)
    if polished:
        traced = replace(traced, scene=replace(traced.scene, media=lens.media.polished))
    screens = screens_of(lens.spec, None if light is None else light.pixels)
    landed = design_landings(traced, lens.spec, rays)
    maps = [None] * len(screens) if light is None else [lit.map for lit in light.receivers]
    order = optical.numbers_of(traced.scene.names)
    return [
        Expected(
            screen,
            screen.irradiance(landings.hits, landings.flux) if lit is None else lit,
            landings.hits,
            landings.flux,
            landings.fates,
            None if landings.met is None else order[landings.met],
        )
        for screen, lit, landings in zip(screens, maps, landed, strict=True)
    ]


def of_one_lamp(lens: Lens) -> Lens:
    """The lens with a single lamp, whose rays are followed one by one; unchanged if it has only one."""
    return lens if lens.spec.all_lamps.is_single else replace(lens, spec=_of_first_lamp(lens), others={})


def _light_of_one_lamp(lens: Lens, light: Light) -> tuple[Lens, Light]:
    alone = of_one_lamp(lens)
    return alone, light if alone is lens else evaluate(alone, rays=light.rays, pixels=light.pixels)


def _of_own_lamps(lens: Lens, light: Light) -> tuple[Lens, Light]:
    single = lens.of_own_lamps
    known = single is lens or len(single.spec.all_lamps) == 1  # one lamp alone is not compared
    return single, light if known else evaluate(single, rays=light.rays, pixels=light.pixels)


def _of_first_lamp(lens: Lens) -> Spec:
    """Reduce the scene to one lamp at the origin: of posed lamps the first that carries ``lens``."""
    from lensforge.scene.receiver_shapes import seen_by_lamp

    spec = lens.spec
    return seen_by_lamp(spec, lens.first_lamp) if spec.all_lamps.posed or spec.scene else spec.of_one_lamp


@public
@with_known_names
def stray_light(
    part: Part, *, rays: int | None = None, base: Literal["polished", "black"] = "polished", threads: int | None = None
) -> StrayLight:
    """Follow rays through a part with the reflections and the base, which the sequential design leaves out.

    Args:
        part: the part; where it has a plate, rays go through all of it, from the lamp nearest to its middle.
        rays: number of rays, from 1, each of which splits into about ten; None: the preset's.
        base: whether the base is polished, or absorbs all that meets it.
        threads: number of threads, from 1; None: all cores.
    Returns: The light on every receiver, and where all flux ends; of several states in each.
    Raises: :class:`InputError` for an argument that is not allowed.
    Example:
        >>> stray = lf.stray_light(lf.load("cad_out/quickstart").part, rays=2**12)
        >>> print(stray.efficiency, stray.efficiency_sequential)
    """
    lens = require(part, Part, "stray_light").lens
    rays = count_of("rays", rays)
    with kernel_threads(count_of("threads", threads)):
        return StrayLight.joined(
            {name: _stray_light(part, led_lens, rays, base) for name, led_lens in lens.by_state.items()}
        )


def _stray_light(part: Part, lens: Lens, rays: int | None, base: Literal["polished", "black"]) -> StrayLight:
    from lensforge.proof.proof_inputs import optical_at_work, optical_on, plate_of, screens_of, stands_of
    from lensforge.scene.rough_faces import with_facets

    spec = lens.spec
    preset = preset_of(lens.accuracy)
    source = judging_source(lens.spec)
    count, conditions = rays_of(rays, min(preset.verify_rays, preset.stray_rays), source)
    optical = optical_at_work(lens)
    stl = part.stl
    if spec.plate is not None and part.plate_stl is not None:
        optical = optical_on(plate_of(spec.plate.lenses(spec.lamps)), lens)
        stl = part.plate_stl
    return stray_in_sandbox(
        stl,
        rays=with_facets(source.sample(count, seeds.of_verification(lens.seed)), lens.media.scattering),
        media=lens.media,
        screens=screens_of(spec),
        lamps=stands_of(lens.of_own_lamps.spec.all_lamps),
        names=[receiver.name or receiver.kind for receiver in spec.all_receivers],
        base=base,
        optical=optical,
        threads=thread_count(),
        inputs={"lens": part.lens.sha256, "export": part.sha256},
    ).changed(conditions=conditions)
