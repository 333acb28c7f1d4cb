"""The stages of one lens as verbs: each takes objects and returns one frozen result; none writes a file.

Heavy libraries are loaded by the verb that first needs them: torch and numba to trace, the CAD kernel to build.
"""

import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Literal, get_args

from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.results.array_fields import MOST_PIXELS
from lensforge.runs.arguments import (
    count_of,
    date_of,
    device_of,
    inputs_of,
    judging_source,
    number_of,
    path_of,
    preset_of,
    require,
    threads_of_torch,
    warned_source,
)
from lensforge.runs.other_conditions import has_rays_of, light_conditions, photometry_conditions
from lensforge.scene.lens import Lens, load_lens
from lensforge.scene.lens_at_temperature import at_temperature
from lensforge.search.design_result import Design, Observer
from lensforge.shop.check_result import Check
from lensforge.sources.photometric.ies import NEWEST, IesVersion, require_ies_version
from lensforge.spec import Accuracy, Spec
from lensforge.spec.design_spec import require_spec
from lensforge.spec.source_sections import SourceSpec


def design(
    spec: Spec,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    threads: int | None = None,
    start: Lens | None = None,
    checkpoint: Path | str | None = None,
    resume: bool = True,
    progress: Observer | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    warn: Callable[[str], None] | None = None,
    anyway: bool = False,
) -> Design:
    """Search for the lens of ``spec``, Eq. (15): coarse to fine, constraints by augmented Lagrangian.

    ``seed``: of the rays. ``threads``: by default all cores; the result does not depend on it. ``start``: a lens to
    begin from; by default that of ``spec.lens.start``, or none. ``checkpoint``: a file that is written every few
    seconds; where it exists already, the search continues from it and ends with the same bits as an uninterrupted one,
    unless ``resume`` is False. ``progress`` is called after every gradient step; where it returns False, the search
    stops with :class:`Cancelled` and leaves its checkpoint. ``device``: where the rays of the search are traced
    (``cuda`` is experimental). ``warn`` is called with each warning on the source before the search begins; by default
    they are Python's own, :class:`SourceWarning`. ``anyway``: search even where less than half of the light that a
    target asks for can reach it.
    Raises :class:`InputError` for invalid arguments.
    """
    from lensforge.search.optimiser import search

    require_spec(spec, "design")
    preset_of(accuracy)
    seed, path = count_of("seed", seed, 0) or 0, path_of("checkpoint", checkpoint)
    if progress is not None and not callable(progress):
        raise InputError(f"progress = {progress!r}: a function that takes a Progress")
    start = start_of(spec, start)
    if spec.base.file is not None:  # an invalid base is reported before the search, not after it
        from lensforge.cad.custom_base import read_custom_base

        read_custom_base(spec.base.file)
    if spec.constraints.keep_out is not None:
        from lensforge.search.keep_out_extent import require_keep_out_fits

        require_keep_out_fits(spec)
    source = warned_source(spec, warn, start, anyway=anyway)
    with threads_of_torch(threads):
        return search(
            spec,
            source,
            accuracy=accuracy,
            seed=seed,
            device=device_of(device),
            start=start,
            checkpoint=path,
            resume=resume and path is not None and path.exists(),
            progress=progress,
            anyway=anyway,
        )


def start_of(spec: Spec, start: Lens | None) -> Lens | None:
    """The lens from which a search goes on: ``start``, or the one that the spec names; None for hemispheres."""
    if start is not None:
        require(start, Lens, "start")
        return start
    return None if spec.lens.start is None else load_lens(spec.lens.start)


def evaluate(
    lens: Lens,
    *,
    accuracy: Accuracy | None = None,
    source: SourceSpec | None = None,
    rays: int | None = None,
    pixels: int | None = None,
    seed: int | None = None,
    temperature_c: float | None = None,
    threads: int | None = None,
) -> Light:
    """Simulate ``lens``: the light on its receiver, every metric with its standard error.

    None: as in the design (accuracy, seed, source), or as in the spec or the preset (rays, pixels). ``temperature_c``:
    of the lens and the air around it, at which its index and its size are others (Celsius). The light names all
    ``conditions`` that are not the lens's own, and the warnings on another source.
    """
    from lensforge.light.evaluation import evaluate_lens
    from lensforge.sources.build_source import build_source, summarise

    require(lens, Lens, "evaluate")
    chosen = lens.spec.source if source is None else source
    if not isinstance(chosen, get_args(get_args(SourceSpec)[0])):
        raise InputError(f"source: {type(chosen).__name__} given; give one of the sources, such as SquareSource(...)")
    rays, pixels, seed = count_of("rays", rays), count_of("pixels", pixels, most=MOST_PIXELS), count_of("seed", seed, 0)
    temperature_c = number_of("temperature_c", temperature_c)
    conditions = light_conditions(
        lens, accuracy=accuracy, source=source, rays=rays, pixels=pixels, seed=seed, temperature_c=temperature_c
    )
    body = lens if temperature_c is None else at_temperature(lens, temperature_c)
    preset, emitter = preset_of(accuracy or lens.accuracy), build_source(chosen, body.dispersion)
    if conditions is not None and conditions.source is not None:
        conditions = conditions.model_copy(update={"warnings": summarise(emitter, chosen).warnings})
    if conditions is not None and conditions.temperature_c is not None:
        warned = (*conditions.warnings, *lens.spec.lens.temperature_law.warnings(conditions.temperature_c))
        conditions = conditions.model_copy(update={"warnings": warned})
    efficacy = summarise(emitter, chosen).lumens_per_watt
    with threads_of_torch(threads):
        light = evaluate_lens(
            body,
            emitter,
            preset,
            rays=rays,
            pixels=pixels,
            seed=seed,
            lumens_per_watt=efficacy,
            searched_with=has_rays_of(chosen, lens.spec.source),
        )
    return light.model_copy(update={"inputs": inputs_of(lens, chosen), "conditions": conditions})


def build(
    lens: Lens,
    *,
    schema: Literal["AP214", "AP242"] = "AP214",
    runout_deg: float | None = None,
    nodes: int | None = None,
    rings: int | None = None,
    date: datetime.date | str | None = None,
) -> Part:
    """Make the part: one solid as STEP, STL and 3MF, verified by reading them back.

    ``schema``: of the STEP. ``runout_deg``: adds the optical faces untrimmed, extended by this angle beyond the rim.
    ``nodes``: spline nodes across each optical face, ``rings``: rings of the mesh; by default as many as their
    tolerances need. ``date``: of the files, by default that of the spec. Raises :class:`InputError` for a lens whose
    surfaces enclose no body.
    """
    from lensforge.cad.part_export import build_part

    require(lens, Lens, "build")
    runout_deg = number_of("runout_deg", runout_deg)
    return build_part(
        lens,
        schema=schema,
        runout_deg=runout_deg,
        nodes=count_of("nodes", nodes),
        rings=count_of("rings", rings),
        date=date_of("date", date),
    )


def check(part: Part) -> Check:
    """Check whether ``part`` can be cut, and with which tools: best-fit spheres, curvature, cutter, wall, draft."""
    from lensforge.shop.check import check_part

    return check_part(require(part, Part, "check"))


def photometry(
    lens: Lens,
    *,
    rays: int | None = None,
    lumens: float | None = None,
    threads: int | None = None,
    ies_version: IesVersion = NEWEST,
) -> Photometry:
    """Compute the far field of ``lens`` and make its IES, EULUMDAT, TM-33 and TM-25 files.

    ``lumens``: of the source; default: as spec or file of the source say, or relative to 1000. ``rays``: by default as
    many as the noise of the intensities asks for. Other lumens than the source's own, and any ``rays`` that are given,
    are other ``conditions`` than the lens's own. ``ies_version``: year of LM-63 that the IES file follows, 2019 or, for
    programs that read no newer one, 2002, 1995, 1991 or 1986.
    """
    from lensforge.light.photometry_export import measure_photometry

    require(lens, Lens, "photometry")
    version = require_ies_version(ies_version)
    rays, preset = count_of("rays", rays), preset_of(lens.accuracy)
    lumens, source = number_of("lumens", lumens), judging_source(lens.spec)
    with threads_of_torch(threads):
        found = measure_photometry(lens, source, preset, rays=rays, lumens=lumens, ies_version=version)
    return found.model_copy(update={"conditions": photometry_conditions(lens, source, rays, lumens)})
