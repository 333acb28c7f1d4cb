"""The light of a finished lens: the verbs ``evaluate`` and ``photometry``."""

from collections.abc import Mapping
from math import isclose
from pathlib import Path
from typing import Any, TypeVar

from lensforge.errors import InputError
from lensforge.kernels.parallel import kernel_threads
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.public import public
from lensforge.results import Conditions
from lensforge.results.arguments import count_of, number_of, require, with_known_names
from lensforge.results.record import MOST_PIXELS
from lensforge.scene.lens import Lens
from lensforge.scene.lens_at_temperature import at_temperature
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.joined_spectrum import efficacy_of
from lensforge.sources.measured_rays import held_back
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion, require_ies_version
from lensforge.sources.ray_bundle import Source
from lensforge.sources.several_sources import SeveralSources
from lensforge.sources.source_place import SourcePlace
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.accuracy import Preset, preset_of
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.source_list import source_with_file
from lensforge.spec.spec_files import input_hashes, section_sha256


@public
@with_known_names
def evaluate(
    lens: Lens,
    *,
    state: str | None = None,
    accuracy: AnyAccuracy | None = None,
    source: EmitterSection | Path | str | None = None,
    rays: int | None = None,
    pixels: int | None = None,
    seed: int | None = None,
    temperature_c: float | None = None,
    name: str | None = None,
    threads: int | None = None,
) -> Light:
    """Simulate a finished lens: the light on its receivers, every metric with its standard error.

    NMSE is the paper's Eq. (7), with the target scaled to the flux that arrives; RSD is Eq. (8).

    Args:
        lens: the lens.
        state: name of the state in which it is; None: in each.
        accuracy: a preset; None: that of the design.
        source: another LED in the place of the spec's; a section, or a ray file.
        rays: number of rays, from 1; None: as in the spec or the preset.
        pixels: number along the longer side of a map, 1 to 4096; None: as in the spec.
        seed: of the rays, from 0; None: that of the design. No ray has designed the lens.
        temperature_c: of the lens and the air around it, at which its index and its size are others.
        name: ends the name of the file of a light under other conditions; None: made from what differs.
        threads: number of threads, from 1; None: all cores.
    Returns: The light; its ``conditions`` are those that are not nominal, None if all are.
    Raises: :class:`InputError` for an argument that is not allowed, or a file that cannot be read.
    Example:
        >>> lens = lf.load("cad_out/quickstart").lens
        >>> light = lf.evaluate(lens, rays=2**16)
        >>> print(light.nmse, light.efficiency)
        >>> light.save("light.png")
    """
    from lensforge.light.evaluation import evaluate_lens
    from lensforge.light.travel_light import light_on_travel

    lens = require(lens, Lens, "evaluate").of_state(state or "")
    if source is not None and lens.spec.states:
        raise InputError("source: this lens has states, each with its LED; give the name of one as state")
    other = None if source is None else other_source(lens.spec, source)
    first, *further = lens.by_state
    designed_led = lens.spec.in_first_state.source
    chosen = designed_led if other is None else other
    rays = count_of("rays", rays)
    pixels = count_of("pixels", pixels, most=MOST_PIXELS)
    seed = count_of("seed", seed, 0)
    temperature_c = number_of("temperature_c", temperature_c)
    body = lens if temperature_c is None else at_temperature(lens, temperature_c)
    preset = preset_of(lens.accuracy if accuracy is None else accuracy)
    coloured = lens.spec.colour is not None
    emitter = build_source(chosen, body.dispersion, coloured=coloured, facets=body.media.scattering)
    summary = summarise(emitter, chosen)
    requested = {"accuracy": str(preset), "rays": rays, "pixels": pixels, "seed": seed, "temperature_c": temperature_c}
    conditions = _conditions(lens, other, summary.warnings, name, requested, preset)
    settings: Mapping[str, Any] = {"rays": rays, "pixels": pixels, "seed": seed}
    with kernel_threads(count_of("threads", threads)):
        light = evaluate_lens(
            body.of_state(first),
            emitter,
            preset,
            **settings,
            efficacy=efficacy_of(emitter, chosen, photons=lens.spec.counts_photons),
            searched_with=has_rays_of(chosen, designed_led),
        )
        others = tuple(_in_state(body, state, preset, settings) for state in further) if other is None else ()
        others = tuple(light.changed(inputs={"lens": lens.sha256}) for light in others)
        traced = light.rays + sum(in_state.rays for in_state in others)
        travel = light_on_travel(body, held_back(emitter), preset, traced, light.seed) if others else None
    led = first if others else ""
    place = SourcePlace.of(chosen, summary)
    update = {"inputs": inputs_of(lens, other or lens.spec.source), "conditions": conditions, "led": led}
    return light.changed(**update, others=others, place=place, travel=travel)


@public
@with_known_names
def photometry(
    lens: Lens,
    *,
    state: str | None = None,
    rays: int | None = None,
    lumens: float | None = None,
    seed: int | None = None,
    threads: int | None = None,
    ies_version: IesVersion = NEWEST,
) -> Photometry:
    """Compute the far field of a lens, and its IES, EULUMDAT, TM-33 and TM-25 files.

    Of several lamps they hold the light of all. Angles are of type C: gamma = 0 is the lens axis (LM-63, TM-33).

    Args:
        lens: the lens.
        state: name of the state in which it is; None: in each.
        rays: number of rays, from 1; None: as many as the noise of the intensities asks for.
        lumens: of the source, in lm; None: as spec or its file say, else 1000.
        seed: of the rays, from 0; None: that of the design.
        threads: number of threads, from 1; None: all cores.
        ies_version: year of LM-63: 2019, or 2002 for older programs.
    Returns: The far field of each LED; another seed, other lumens than the source's own, and any ``rays``, are other
        ``conditions``.
    Raises: :class:`InputError` for an argument that is not allowed.
    Example:
        >>> photometry = lf.photometry(lf.load("cad_out/quickstart").lens, lumens=120.0)
        >>> print(photometry.peak_cd, photometry.beam_c0.beam_angle_deg)
        >>> photometry.save("lens.ies")
    """
    from lensforge.light.photometry_export import measure_photometry

    lens = require(lens, Lens, "photometry").of_state(state or "")
    version = require_ies_version(ies_version)
    rays = count_of("rays", rays)
    preset = preset_of(lens.accuracy)
    lumens = number_of("lumens", lumens)
    seed = count_of("seed", seed, 0)
    by_state = dict[str, Photometry]()
    settings: Mapping[str, Any] = {"rays": rays, "seed": seed, "lumens": lumens}
    with kernel_threads(count_of("threads", threads)):
        for name, led_lens in lens.by_state.items():
            source = judging_source(led_lens.spec)
            measured = measure_photometry(led_lens, source, preset, ies_version=version, led=name, **settings)
            conditions = photometry_conditions(led_lens, source, **settings)
            by_state[name] = measured.changed(conditions=conditions, inputs={"lens": lens.sha256})
    return Photometry.joined(by_state)


def _in_state(lens: Lens, name: str, preset: Preset, settings: Mapping[str, Any]) -> Light:
    """The light in a further state, beside that in the first."""
    from lensforge.light.evaluation import evaluate_lens

    alone = lens.of_state(name)
    section = alone.spec.source
    emitter = build_source(
        section, lens.dispersion, coloured=alone.spec.colour is not None, facets=lens.media.scattering
    )
    summary = summarise(emitter, section)
    efficacy = efficacy_of(emitter, section, photons=alone.spec.counts_photons)
    light = evaluate_lens(alone, emitter, preset, **settings, efficacy=efficacy, searched_with=True)
    return light.changed(
        conditions=Conditions.of(source_name=name, source=section.title),
        led=name,
        place=SourcePlace.of(section, summary),
        preset_error=None,
        fitted=None,
    )


def _conditions(
    lens: Lens,
    source: EmitterSection | None,
    warnings: tuple[str, ...],
    name: str | None,
    requested: Mapping[str, Any],
    preset: Preset,
) -> Conditions | None:
    """The ``requested`` conditions that differ from the lens's; None if all agree. ``warnings``: on the ``source``."""
    evaluate = lens.spec.evaluate
    law = lens.spec.lens.temperature_law
    rays = evaluate.rays or preset.evaluate_rays
    defaults: dict[str, Any] = {
        "accuracy": str(lens.accuracy),
        "rays": rays,
        "pixels": evaluate.pixels,
        "seed": lens.seed,
    }
    defaults["temperature_c"] = law.reference_c
    other = None if source is None or is_same_source(source, lens.spec.source) else source
    conditions = Conditions.of(
        source_name="" if other is None else name_of_source(other),
        source=None if other is None else other.title,
        source_sha256=None if other is None else section_sha256(other),
        **{field: unless_default(value, defaults[field]) for field, value in requested.items()},
    )
    if conditions is None and name is not None:
        raise InputError(f"name = {name!r}: these are the nominal conditions; give it with another source or rays")
    if conditions is None:
        return None
    warned = () if conditions.source is None else warnings
    if conditions.temperature_c is not None:
        warned += law.warnings(conditions.temperature_c)
    named = conditions if name is None else conditions.renamed(name)
    return named.changed(warnings=warned)


_Value = TypeVar("_Value")


def source_of(spec: Spec) -> Source:
    """The source of ``spec`` with the lens material's dispersion, and with colours if these are evaluated."""
    facets = spec.media.scattering
    return build_source(spec.source, spec.lens.dispersion, coloured=spec.colour is not None, facets=facets)


def searched_source(spec: Spec) -> Source:
    """The source of a search: the LED in all states that the lens of ``spec`` is for."""
    if not spec.all_states:
        return source_of(spec)
    return SeveralSources(tuple(map(source_of, spec.by_state.values())), spec.lens.design_wavelength_nm)


def judging_source(spec: Spec) -> Source:
    """The source of ``spec`` for judging its lens: of measured rays those that no search uses."""
    return held_back(source_of(spec))


def other_source(spec: Spec, source: EmitterSection | Path | str) -> EmitterSection:
    """The source that replaces that of ``spec``. Raises :class:`InputError` for anything else."""
    if isinstance(source, Path | str):
        return source_with_file(spec.source, Path(source))
    if not isinstance(source, EmitterSection):
        raise InputError(f"source: {type(source).__name__} given; give one of the sources, such as SquareSource(...)")
    return source


def inputs_of(lens: Lens, source: EmitterSection) -> dict[str, str]:
    """Hashes of the inputs of an evaluation: the lens, the source, and every file that the source names."""
    return {"lens": lens.sha256, "source": section_sha256(source), **input_hashes(source)}


def rays_of(rays: int | None, default: int, source: Source) -> tuple[int, Conditions | None]:
    """Number of rays to trace, at most those that ``source`` has, and the conditions if it differs from ``default``."""
    most = source.ray_count or 2**40
    count = min(rays or default, most)
    return count, Conditions.of(rays=unless_default(count, min(default, most)))


def photometry_conditions(
    lens: Lens, source: Source, *, rays: int | None, seed: int | None, lumens: float | None
) -> Conditions | None:
    """Conditions of a photometry of ``lens``.

    Stated ``rays`` always count: by default their number follows the noise. ``lumens`` count only if the spec has
    others.
    """
    known_lm = summarise(source, lens.spec.source).flux_lm
    as_known = known_lm is None or lumens is None or isclose(lumens, known_lm)
    return Conditions.of(rays=rays, seed=unless_default(seed, lens.seed), lumens=None if as_known else lumens)


def unless_default(value: _Value | None, default: _Value) -> _Value | None:
    """``value``, or None if it is None or equals ``default``."""
    return None if value == default else value


def has_rays_of(source: EmitterSection, lens_source: EmitterSection) -> bool:
    """True if ``source`` uses rays of a file of ``lens_source``, whatever its name and pose, or is the same source."""
    if source == lens_source:
        return True
    files = set(input_hashes(source).values())
    try:
        return not files.isdisjoint(input_hashes(lens_source).values())
    except InputError:  # the lens's own files are no longer there
        return False


def is_same_source(source: EmitterSection, lens_source: EmitterSection) -> bool:
    """True if both have the same fields and files; False if the files of ``lens_source`` no longer exist."""
    if source == lens_source:
        return True
    wanted = section_sha256(source)
    try:
        return wanted == section_sha256(lens_source)
    except InputError:
        return False


def name_of_source(source: EmitterSection) -> str:
    """Short name of a source: its file names without endings, or its title."""
    return "_".join(Path(file.removeprefix("file:")).stem for file in input_hashes(source)) or source.title
