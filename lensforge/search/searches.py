"""The search for a lens, once or from several starts: the verbs ``design`` and ``best_design``."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict, Unpack

from lensforge import seeds
from lensforge.errors import InputError, SourceWarning, remedy
from lensforge.light.lens_light import name_of_source, other_source, searched_source, source_of
from lensforge.light.source_photometry import SourceLumens
from lensforge.public import public
from lensforge.results.arguments import count_of, path_of, require, threads_of_torch, with_known_names, with_options_of
from lensforge.results.cluster import connected
from lensforge.scene.lens import Lens, load_lens
from lensforge.search.design_result import Design, Observer, Start
from lensforge.search.smallest_lens import lens_by_search
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.several_sources import SeveralSources
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.accuracy import accuracy_of
from lensforge.spec.application import application_warnings
from lensforge.spec.design_spec import require_spec
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.feasible import base_warnings
from lensforge.spec.spec_files import joined_name
from lensforge.surfaces.mirror_group import contains

if TYPE_CHECKING:
    import torch

    from lensforge.sources.ray_bundle import Source

Warn = Callable[[str], None]
MOST_STARTS = 1000


class SearchOptions(TypedDict, total=False):
    """Keywords of :func:`design`, which :func:`best_design` and :func:`lensforge.run` hand on."""

    accuracy: AnyAccuracy
    seed: int
    threads: int | None
    start: Lens | None
    checkpoint: Path | str | None
    progress: Observer | None
    device: Literal["cpu", "cuda"]
    warn: Warn | None
    force: bool
    preview: bool


@public
@with_known_names
def design(
    spec: Spec,
    *,
    accuracy: AnyAccuracy = "standard",
    seed: int = 0,
    threads: int | None = None,
    start: Lens | None = None,
    checkpoint: Path | str | None = None,
    resume: bool = True,
    progress: Observer | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    warn: Warn | None = None,
    force: bool = False,
    preview: bool = False,
) -> Design:
    """Search for the lens of a spec, coarse to fine: the paper's Eq. (15), constraints by augmented Lagrangian.

    Args:
        spec: what is wanted; :func:`load_spec` reads it from a file.
        accuracy: a preset by name, or one of your own; it sets steps and rays here and in every later stage.
        seed: of the random rays, 0 to 1,048,576; the same seed gives the same bits.
        threads: number of threads, from 1; None: all cores. The result does not depend on it.
        start: lens to begin from; None: that of ``spec.lens.start``, else the faces of the spec.
        checkpoint: file that is written every few seconds; where it exists already, the search continues from it and
            ends with the same bits as an uninterrupted one.
        resume: False begins anew, whatever ``checkpoint`` holds.
        progress: called with a :class:`Progress` after every gradient step; where it returns False, the search stops
            with :class:`Cancelled` and leaves its checkpoint; where "enough", it ends with the lens that it has.
        device: where rays are traced; "cuda" is experimental.
        warn: called with each warning on the source before the search; None: Python's own, :class:`SourceWarning`.
        force: search even where less than half of the light that a target asks for can reach it.
        preview: take fewer steps on levels that the search chooses itself, for a first look.
    Returns: The search: its ``lens``, the ``history`` of its levels, the margins of all ``constraints``.
    Raises: :class:`InputError` for an argument that is not allowed, or a scene that no lens can light.
        :class:`Cancelled`: ``progress`` returned False.
    Example:
        >>> spec = lf.load_spec("examples/quickstart.toml")
        >>> design = lf.design(spec, accuracy="draft", progress=lambda step: print(step.steps_done, step.nmse))
        >>> design.lens.save("lens.json")
    """
    require_spec(spec, "design")
    accuracy = accuracy_of(accuracy)
    seed = count_of("seed", seed, 0) or 0
    path = path_of("checkpoint", checkpoint)
    if progress is not None and not callable(progress):
        raise InputError(f"progress = {progress!r}: a function that takes a Progress")
    start = _start_of(spec, start)
    source, warned = _checked_scene(spec, start, warn, force=force)
    with threads_of_torch(threads):
        return lens_by_search(
            spec,
            source,
            accuracy=accuracy,
            seed=seed,
            device=device_of(device),
            start=start,
            checkpoint=path,
            resume=resume and path is not None and path.exists(),
            progress=progress,
            warnings=warned,
            preview=preview,
        )


def require_searchable(spec: Spec, *, accuracy: AnyAccuracy = "standard", force: bool = False) -> None:
    """Raise :class:`InputError` for all that :func:`design` refuses before its first step."""
    from lensforge.search.optimiser import require_start

    start = _start_of(spec)
    source, _ = _checked_scene(spec, start, lambda _: None, force=force)
    one_kind = spec.lamps is not None and spec.all_lamps.kinds and (start is None or not start.others)
    first = spec.changed(lamps=spec.lamps.of_one_kind) if one_kind and spec.lamps is not None else spec
    require_start(first, source, accuracy, start)


@public
@with_options_of(design)
def redesign(lens: Lens, source: EmitterSection | Path | str, **options: Unpack[SearchOptions]) -> Design:
    """Search for a lens for another LED, from a finished lens on, on automatic levels.

    Args:
        lens: lens to begin from; its spec says all but the source.
        source: the other LED; a section, or a ray file, which takes its place from the spec's source.
        options: as of :func:`design`; accuracy and seed are by default those of ``lens``.
    Returns: The search; the name of its spec ends with that of the source.
    Raises: :class:`InputError` as :func:`design` does.
    Example:
        >>> lens = lf.load("cad_out/quickstart").lens
        >>> design = lf.redesign(lens, lf.DiscSource(diameter_mm=1.6), accuracy="draft")
        >>> print(design.lens.spec.name)
    """
    require(lens, Lens, "redesign")
    other = other_source(lens.spec, source)
    spec = lens.spec.with_automatic_levels()
    built = build_source(other, lens.dispersion, facets=lens.media.scattering)
    symmetry = spec.lens.symmetry if contains(built.symmetry, spec.lens.symmetry) else "auto"
    name = joined_name(spec.name, name_of_source(other))
    if spec.states:
        raise InputError("redesign: this lens has states, each with its LED; change the LED in its spec, and design it")
    changed = spec.replace({"lens.symmetry": symmetry, "sources": ()}, source=other, name=name)
    chosen: SearchOptions = {"accuracy": lens.accuracy, "seed": lens.seed, "start": lens}
    chosen.update(options)
    return design(changed, **chosen)


def _start_of(spec: Spec, start: Lens | None = None) -> Lens | None:
    if start is not None:
        return require(start, Lens, "start")
    return None if spec.lens.start is None else load_lens(spec.lens.start)


def device_of(name: str) -> "torch.device | None":
    """The device on which torch traces the rays of a search; None for "cpu", where the compiled kernels trace them.

    Raises :class:`InputError` where torch does not find the device.
    """
    import torch

    if name == "cpu":
        return None
    if name != "cuda" or not torch.cuda.is_available():
        raise InputError(
            f"device = {name!r}: torch {torch.__version__} finds no such device; allowed here: cpu; "
            "for an NVIDIA GPU install a CUDA build of torch"
        )
    return torch.device(name)


def _checked_scene(
    spec: Spec, start: Lens | None, warn: Warn | None, *, force: bool
) -> "tuple[Source, tuple[str, ...]]":
    """The source of ``spec``, and the warnings on its scene; all that a search would be in vain for is refused.

    ``warn`` is called with each warning, on source and given faces, too. Raises :class:`InputError` for a base that
    cannot be, where no light enters the lens and, unless ``force``, where less than half of what the targets ask for is
    possible.
    """
    from lensforge.search.scene_check import SceneCheck, source_clearance_warnings
    from lensforge.search.travel import require_clear_travel

    if spec.base.file is not None:
        from lensforge.cad.custom_base import read_custom_base

        read_custom_base(spec.base.file)
    held = base_warnings(spec.lens, spec.constraints, spec.base, spec.manufacture.process) if spec.plate is None else []
    remarks = [*spec.lens.warnings, *held]
    of_scene = tuple[str, ...]()
    states = spec.by_state
    noun = "state" if spec.states else "LED"
    for name, alone in states.items():
        source = source_of(alone)
        summary = summarise(source, alone.source)
        SourceLumens.of(None, summary).require_known(alone.photometry)  # not after a search
        line = f"{name}: " if name else ""
        with remedy(f"the {noun} is {name}") if name else nullcontext():
            room = source_clearance_warnings(alone, source)
            scene = SceneCheck.of(alone, source, start)
            scene.require_light(force=force)
        lenses = alone.photometry.lenses * len(alone.all_lamps)
        twice = application_warnings(alone.applications, alone.all_receivers, lenses, summary.flux_lm)
        stated = (*scene.warnings(), *twice, *alone.lens.temperature_warnings)
        of_scene += tuple(f"{line}{warning}" for warning in stated)
        remarks += [f"{line}{remark}" for remark in (*summary.warnings, *stated, *room)]
    remarks += require_clear_travel(spec)
    wanted = searched_source(spec)
    if isinstance(wanted, SeveralSources):
        remarks += _led_warnings(wanted, list(states))
    for remark in remarks:
        if warn is None:
            warnings.warn(remark, SourceWarning, stacklevel=3)
        else:
            warn(remark)
    return wanted, of_scene


def _led_warnings(source: SeveralSources, names: Sequence[str]) -> Iterator[str]:
    """A line for each LED that is traced at one wavelength beside others with theirs."""
    for number in source.without_wavelengths:
        yield (
            f"{names[number]}: no wavelengths, as other LEDs have: its light is traced at lens.design_wavelength_nm = "
            f"{source.wavelength_nm:g}; give its source a spectrum"
        )


@dataclass(frozen=True)
class SeededSearch:
    """A search but for its seed.

    ``warnings``: on its scene. ``progress`` is called in this process only. ``rays_seed``: of the rays that choose.
    """

    spec: Spec
    accuracy: AnyAccuracy
    warnings: tuple[str, ...]
    progress: Observer | None
    rays_seed: int

    def made(self, seed: int) -> tuple[Design, Start]:
        """One search, and the light of its lens."""
        from lensforge.search.other_rays import light_by_other_rays  # a second, which one search alone does not need

        design = lens_by_search(
            self.spec,
            searched_source(self.spec),
            accuracy=self.accuracy,
            seed=seed,
            start=_start_of(self.spec),
            progress=self.progress,
            warnings=self.warnings,
        )
        lights = light_by_other_rays(design.lens, self.rays_seed)
        missed = sum(not criterion.holds for criterion in design.criteria)
        missed += sum(limit.state == "fail" for light in lights for limit in light.limits)
        errors = [receiver.nmse.value for light in lights for receiver in light.receivers if receiver.nmse is not None]
        return design, Start(
            seed=seed,
            nmse=lights[0].nmse,
            efficiency=lights[0].efficiency,
            merit=sum(errors) / len(errors),
            missed=missed,
            seconds=design.seconds,
            size_mm=design.least_mm,
        )


@public
@with_options_of(design)
def best_design(
    spec: Spec,
    *,
    starts: int,
    scheduler: str | None = None,
    announce: Callable[[str], None] | None = None,
    **options: Unpack[SearchOptions],
) -> Design:
    """Search several times, with one seed after another, and return the best.

    The best keeps most constraints and limits and, of those, has the smallest NMSE. Rays that judge no lens afterwards
    choose it: by those that do, the best of many would be the luckiest.

    Args:
        spec: what is wanted.
        starts: number of searches, 1 to 1,000.
        scheduler: address of a Dask cluster, "tcp://10.0.0.5:8786", or "local:4" for processes here; the same bits.
        announce: called with a line for each search that has ended.
        options: as of :func:`design`, but for ``start``, ``checkpoint`` and ``device``; ``seed`` is the first.
    Returns: The best search; its ``starts`` has the figures of all, its ``spread`` how far they scatter.
    Raises: :class:`InputError` as :func:`design` does, and where no scheduler answers.
    Example:
        >>> spec = lf.load_spec("examples/quickstart.toml")
        >>> best = lf.best_design(spec, starts=2, accuracy="draft")
        >>> print(best.lens.seed, best.spread)
    """
    require_spec(spec, "best_design")
    if any(options.get(name) not in (None, "cpu") for name in ("start", "checkpoint", "device")):
        raise InputError("several starts, or a scheduler: without start, checkpoint (--resume) and device")
    accuracy = accuracy_of(options.get("accuracy", "standard"))
    given = options.get("seed", 0)
    count = count_of("starts", starts, most=MOST_STARTS) or 1
    first = count_of("seed", given, 0) or 0
    if first + count - 1 > seeds.MOST:
        raise InputError(f"seed = {first}: with {count} starts the last seed is above {seeds.MOST}")
    _, warned = _checked_scene(spec, _start_of(spec), options.get("warn"), force=options.get("force", False))
    progress = options.get("progress") if scheduler is None else None
    seeded = SeededSearch(spec, accuracy, warned, progress, seeds.of_choice(first))
    made: dict[int, tuple[Design, Start]] = {}
    with threads_of_torch(options.get("threads")), connected(scheduler) as workers:
        for number, (design_made, start) in workers.map(SeededSearch.made, seeded, range(first, first + count)):
            made[number] = design_made, start
            if announce is not None:
                announce(f"start {len(made)} of {count}: seed {start.seed}, {start.phrase}")
    ordered = [made[number] for number in range(count)]
    best, _ = min(ordered, key=lambda pair: pair[1].rank)  # of equals the first seed
    return best.changed(starts=tuple(start for _, start in ordered))
