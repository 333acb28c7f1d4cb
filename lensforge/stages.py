"""The stages as verbs: what a stage needs comes in, one frozen result comes out, nothing is written.

What a verb needs loads when it is called: torch and numba with the first light, the CAD kernel with the first solid.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar, overload

from lensforge.accuracy import PRESETS, Preset
from lensforge.errors import InputError
from lensforge.evaluation.light import Light
from lensforge.far_field.photometry import Photometry
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.manufacturing.cut import Check
from lensforge.measurement.cloud import read_cloud
from lensforge.measurement.comparison import PhotoComparison, SurfaceComparison
from lensforge.optimisation.design import Design
from lensforge.optimisation.progress import Observer
from lensforge.spec import Accuracy, Spec
from lensforge.spec.design import require_spec
from lensforge.spec.section import Section
from lensforge.spec.source import Source as SourceSpec
from lensforge.tolerancing.sensitivity_table import Sensitivity
from lensforge.verification.proof import Proof, StrayLight

if TYPE_CHECKING:
    from lensforge.sources.bundle import Source

_VERIFY_SEED = 2**41  # apart from the seeds of the design and of its evaluation
_STRAY_RAYS = 2**15  # every one of them becomes some ten: more would not be waited for

_Kind = TypeVar("_Kind")


def design(
    spec: Spec,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    threads: int | None = None,
    start: Lens | None = None,
    checkpoint: Path | str | None = None,
    progress: Observer | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
) -> Design:
    """Search for the lens of ``spec``, Eq. (15): coarse to fine, its constraints by multipliers.

    ``seed``: of the rays. ``threads``: by default all cores; the result does not depend on them. ``start``: a lens to
    begin from. ``checkpoint``: a file that is written every few seconds; where it is there already, the search goes on
    from it and ends with the same bits as one that was never interrupted. ``progress`` is called after every gradient
    step; where it returns False, the search stops with :class:`Cancelled` and leaves its checkpoint. ``device``: where
    the search traces its rays (``cuda`` is experimental). Raises :class:`InputError` for what cannot be used.
    """
    path = None if checkpoint is None else Path(checkpoint)
    resume = path is not None and path.exists()
    return search_lens(spec, accuracy, seed, threads, start, path, resume, progress, device)


def search_lens(
    spec: Spec,
    accuracy: Accuracy,
    seed: int,
    threads: int | None,
    start: Lens | None,
    checkpoint: Path | None,
    resume: bool,
    progress: Observer | None,
    device: Literal["cpu", "cuda"],
) -> Design:
    """What :func:`design` does; a checkpoint that is there already is used only with ``resume``."""
    from lensforge.optimisation.optimiser import search
    from lensforge.tracing.on_device import search_device

    require_spec(spec, "design")
    preset_of(accuracy)
    if not isinstance(seed, int) or seed < 0:
        raise InputError(f"seed = {seed!r}: an integer, 0 or above")
    if start is not None:
        _require(start, Lens, "start")
    if spec.base.file is not None:  # a file that is no base is better known before the search than after it
        from lensforge.geometry.step_base import read_base

        read_base(spec.base.file)
    with threads_of_torch(threads):
        return search(
            spec,
            source_of(spec),
            accuracy=accuracy,
            seed=seed,
            device=search_device(device),
            start=start,
            checkpoint=checkpoint,
            resume=resume,
            progress=progress,
        )


def evaluate(
    lens: Lens,
    *,
    accuracy: Accuracy | None = None,
    source: SourceSpec | None = None,
    rays: int | None = None,
    pixels: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
) -> Light:
    """Simulate ``lens``: the light on its receiver, every metric with its standard error.

    What is None is the lens's own: its accuracy, the spec's source, the rays and pixels of spec or preset, its seed.
    """
    from lensforge.evaluation.evaluate import evaluate_lens

    _require(lens, Lens, "evaluate")
    if source is not None:
        _require(source, Section, "source")
    _require_count("rays", rays)
    _require_count("pixels", pixels)
    preset, emitter = preset_of(accuracy or lens.accuracy), source_of(lens.spec, source)
    with threads_of_torch(threads):
        return evaluate_lens(lens, emitter, preset, rays=rays, pixels=pixels, seed=seed)


def build(
    lens: Lens,
    *,
    schema: Literal["AP214", "AP242"] = "AP214",
    runout_deg: float | None = None,
    nodes: int | None = None,
    rings: int | None = None,
) -> Part:
    """Make the part: one solid as STEP, STL and 3MF, proven by reading them back.

    ``schema``: of the STEP. ``runout_deg``: also the optical faces untrimmed, going on by this angle beyond the rim.
    ``nodes``: spline nodes across each optical face, ``rings``: rings of the mesh; by default as many as form and
    facets need. Raises :class:`InputError` for a lens that is no body.
    """
    from lensforge.geometry.export import build_part

    _require(lens, Lens, "build")
    return build_part(lens, schema=schema, runout_deg=runout_deg, nodes=nodes, rings=rings)


def check(part: Part) -> Check:
    """Say whether ``part`` can be made, and with what: spheres, curvature, cutter, wall, draft, tools."""
    from lensforge.manufacturing.check import check_part

    return check_part(_require(part, Part, "check"))


def verify(part: Part, light: Light, *, rays: int | None = None, threads: int | None = None) -> Proof:
    """Cast rays through the part's own STL and STEP, and compare with where the design sends them.

    ``light``: the design's, of the same lens. The tracing shares no code with the design's.
    """
    import torch

    from lensforge.evaluation.simulate import TracedLens, design_landings
    from lensforge.verification.mitsuba_cast import RAYS as MITSUBA_RAYS
    from lensforge.verification.mitsuba_cast import installed as mitsuba_installed
    from lensforge.verification.verify import verify_part

    lens, spec = _require(part, Part, "verify").lens, part.lens.spec
    _require_count("rays", rays)
    if _require(light, Light, "verify").inputs.get("lens") != lens.sha256:
        raise InputError("verify: the light is that of another lens than the part; evaluate the part's lens")
    preset, source = preset_of(lens.accuracy), source_of(spec)
    with threads_of_torch(threads):
        bundle = source.sample(min(rays or preset.verify_rays, source.population or 2**40), _VERIFY_SEED + lens.seed)
        hits, flux = design_landings(TracedLens.of(lens, preset.judge_nodes_per_sigma), spec, bundle)
        return verify_part(
            part.stl,
            rays=bundle,
            refractive_index=lens.refractive_index,
            distance_mm=spec.target.distance_mm,
            receiver_mm=light.receiver_mm,
            window_mm=light.window_mm,
            pixels=light.pixels,
            design_irradiance=light.map,
            design_hits=hits,
            design_weights=flux,
            filter_variance=spec.evaluate.filter_variance,
            step=part.step,
            mitsuba_rays=MITSUBA_RAYS if mitsuba_installed() else 0,
            threads=torch.get_num_threads(),
            inputs={"lens": lens.sha256, "export": part.sha256, "evaluate": light.sha256},
        )


def stray_light(
    part: Part, *, rays: int | None = None, base: Literal["polished", "black"] = "polished", threads: int | None = None
) -> StrayLight:
    """Follow rays through the part with reflections, base and absorption: what the sequential design leaves out."""
    from lensforge.verification.picture import Receiver
    from lensforge.verification.stray import trace_stray

    lens, spec = _require(part, Part, "stray_light").lens, part.lens.spec
    _require_count("rays", rays)
    preset, source = preset_of(lens.accuracy), source_of(spec)
    count = min(rays or min(preset.verify_rays, _STRAY_RAYS), source.population or 2**40)
    with threads_of_torch(threads):
        return trace_stray(
            part.stl,
            rays=source.sample(count, _VERIFY_SEED + lens.seed),
            refractive_index=lens.refractive_index,
            absorption_per_mm=spec.lens.absorption_per_mm,
            distance_mm=spec.target.distance_mm,
            receiver=Receiver(spec.target.receiver_mm, spec.evaluate.pixels, spec.evaluate.filter_variance),
            window_mm=spec.evaluate.window_mm or spec.target.receiver_mm,
            base=base,
            inputs={"lens": lens.sha256, "export": part.sha256},
        )


def sensitivity(lens: Lens, *, rays: int | None = None, threads: int | None = None) -> Sensitivity:
    """Say what small errors of form, position, source and index do to the light of ``lens``."""
    from lensforge.tolerancing.sensitivity import measure_sensitivity

    _require(lens, Lens, "sensitivity")
    _require_count("rays", rays)
    with threads_of_torch(threads):
        return measure_sensitivity(lens, source_of(lens.spec), preset_of(lens.accuracy), rays=rays)


def photometry(
    lens: Lens, *, rays: int | None = None, lumens: float | None = None, threads: int | None = None
) -> Photometry:
    """Measure the far field of ``lens`` and make its IES, EULUMDAT and TM-25 files.

    ``lumens``: of the source; by default by the spec's luminous efficacy, or 1000.
    """
    from lensforge.far_field.export import measure_photometry

    _require(lens, Lens, "photometry")
    _require_count("rays", rays)
    with threads_of_torch(threads):
        return measure_photometry(lens, source_of(lens.spec), preset_of(lens.accuracy), rays=rays, lumens=lumens)


@overload
def compare(
    measured: Light,
    *,
    on: Path | str,
    off: Path | str | None = None,
    corners: Sequence[tuple[float, float]] | None = None,
    target_mm: float | None = None,
    gamma: float = 1.0,
) -> PhotoComparison: ...


@overload
def compare(
    measured: Lens,
    *,
    points: Path | str,
    surface: Literal["inner", "outer"],
    registration: Literal["rigid", "shift", "none"] = "rigid",
    rays: int | None = None,
) -> SurfaceComparison: ...


def compare(
    measured: Light | Lens,
    *,
    on: Path | str | None = None,
    off: Path | str | None = None,
    corners: Sequence[tuple[float, float]] | None = None,
    target_mm: float | None = None,
    gamma: float = 1.0,
    points: Path | str | None = None,
    surface: Literal["inner", "outer"] | None = None,
    registration: Literal["rigid", "shift", "none"] = "rigid",
    rays: int | None = None,
) -> PhotoComparison | SurfaceComparison:
    """Compare the machined part with the design: a photograph with its light, or measured points with its lens.

    A photograph with the LED ``on``, and one with it ``off``; ``corners``: pixels (column, row) of the target in it,
    found if None; ``target_mm``: side of the square that they span. ``points``: a file of x, y, z (mm) on one
    ``surface``; ``registration``: how they may be moved onto the design.
    """
    if isinstance(measured, Light) and on is not None and points is None:
        return _compare_photo(measured, on, off, corners, target_mm, gamma)
    if isinstance(measured, Lens) and points is not None and on is None:
        return _compare_surface(measured, points, surface, registration, rays)
    raise InputError("compare: give a Light with on=PHOTO, or a Lens with points=FILE and surface='inner' or 'outer'")


def _compare_photo(
    light: Light,
    on: Path | str,
    off: Path | str | None,
    corners: Sequence[tuple[float, float]] | None,
    target_mm: float | None,
    gamma: float,
) -> PhotoComparison:
    import numpy as np

    from lensforge.measurement.photo import Shot, compare_photo

    given = None if corners is None else np.array(corners, dtype=np.float64)
    if given is not None and given.shape != (4, 2):
        raise InputError(f"corners: shape {given.shape}, must be (4, 2): column, row; top left, and on clockwise")
    shot = Shot(Path(on), None if off is None else Path(off), given, target_mm, gamma)
    found = compare_photo(shot, simulated=light.map, receiver_mm=light.receiver_mm, uniform_mm=light.uniform_mm)
    return found.model_copy(update={"inputs": dict(light.inputs)})


def _compare_surface(
    lens: Lens,
    points: Path | str,
    surface: Literal["inner", "outer"] | None,
    registration: Literal["rigid", "shift", "none"],
    rays: int | None,
) -> SurfaceComparison:
    from lensforge.measurement.surface import compare_surface

    if surface not in ("inner", "outer"):
        raise InputError(f"surface = {surface!r}: 'inner' or 'outer', the one on which the points were measured")
    return compare_surface(
        read_cloud(Path(points)),
        lens=lens,
        side=surface,
        source=source_of(lens.spec),
        preset=preset_of(lens.accuracy),
        rays=rays,
        freedom=registration,
    )


def source_of(spec: Spec, instead: SourceSpec | None = None) -> "Source":
    """The emitter of ``spec``, or ``instead`` of it, in the material of its lens."""
    from lensforge.sources.build import build_source

    return build_source(spec.source if instead is None else instead, spec.lens.dispersion)


def preset_of(accuracy: str) -> Preset:
    """The knobs of an accuracy preset. Raises :class:`InputError` for a name that is none."""
    for name, preset in PRESETS.items():
        if name == accuracy:
            return preset
    raise InputError(f"accuracy = {accuracy!r}: one of {', '.join(PRESETS)}")


@contextmanager
def threads_of_torch(threads: int | None) -> Iterator[None]:
    """Let torch and the tracer use ``threads`` threads inside of the block; None leaves the number as it is."""
    if threads is None:
        yield
        return
    if not (isinstance(threads, int) and threads >= 1):
        raise InputError(f"threads = {threads!r}: an integer, at least 1")
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _require_count(name: str, value: object) -> None:
    """Raise :class:`InputError` for what is neither None nor a whole number above 0."""
    if value is not None and not (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        raise InputError(f"{name} = {value!r}: an integer, at least 1")


def _require(value: object, kind: type[_Kind], verb: str) -> _Kind:
    if isinstance(value, kind):
        return value
    remedy = _MAKES.get(kind.__name__, "one of the classes of lensforge")
    raise InputError(f"{verb}: {str(value)[:60]!r} is a {type(value).__name__}, must be a {kind.__name__}: {remedy}")


_MAKES = {"Lens": "design(spec).lens or load(folder).lens", "Part": "build(lens)", "Light": "evaluate(lens)"}
