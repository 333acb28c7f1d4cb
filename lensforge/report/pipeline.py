"""The verbs on a lens as it is made, whole runs in a result folder, and studies.

The CAD kernel computes on one core and holds Python's lock. So the part is made in a second process while this one
simulates the light, and is checked there while this one verifies it with the second one's help. Only this one writes.
A result that misses a criterion is still written; the verdict says so. Heavy libraries are loaded by the verb that
first needs them: torch and numba to trace, the CAD kernel to build.
"""

import datetime
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar, Unpack

from lensforge.cad.face_tolerance import MAX_NODES, face_tolerance
from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.kernels.parallel import kernel_threads
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate, photometry, searched_source
from lensforge.light.photometry_result import Photometry
from lensforge.proof.casts import verify, verify_with
from lensforge.proof.proof_result import Proof
from lensforge.public import public
from lensforge.report.folder import Run, RunFolder, existing, folder_of, opened
from lensforge.report.results import REPORT_FILE, Results
from lensforge.report.sweep import Sweep, sweep_of
from lensforge.report.tradeoff import Tradeoff
from lensforge.report.variation import AnyVariation, sources_of, variation_of
from lensforge.results import StageResult
from lensforge.results.arguments import (
    count_of,
    number_of,
    require,
    threads_of_torch,
    with_known_names,
    with_options_of,
)
from lensforge.results.child_pool import ChildPool, child_pool
from lensforge.results.criteria import state_of
from lensforge.results.file_bounds import remembered
from lensforge.results.files import require_own
from lensforge.results.worker import return_freed_memory
from lensforge.scene.lens import Lens
from lensforge.search.checkpoint import CHECKPOINT, delete_checkpoint
from lensforge.search.design_result import COSTS, Design, Observer
from lensforge.search.searches import SearchOptions, Warn, best_design, design
from lensforge.search.tool_costs import holding_tools, tool_costs
from lensforge.shop.check_result import Check
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.accuracy import accuracy_of, preset_of
from lensforge.spec.design_spec import require_spec
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.feasible import require_base_around_cavity
from lensforge.spec.processes import Process
from lensforge.spec.source_sections import NamedSource
from lensforge.spec.spec_section import date_of
from lensforge.surfaces.imported_face import LENS_FILE

_Result = TypeVar("_Result", bound=StageResult)
_FINER = 1.5  # nodes of a spline over those of one whose STEP does not read back as it was


@public
@with_known_names
def build(
    lens: Lens,
    *,
    schema: Literal["AP214", "AP242"] = "AP214",
    extension_deg: float | None = None,
    nodes: int | None = None,
    form_nm: float | None = None,
    normal_mrad: float | None = None,
    rings: int | None = None,
    date: datetime.date | str | None = None,
) -> Part:
    """Make the part: one solid as STEP, STL and 3MF, verified by reading them back.

    Args:
        lens: the lens.
        schema: of the STEP file.
        extension_deg: also writes the optical faces untrimmed, extended by this angle beyond the rim.
        nodes: number of spline nodes across a face; None: as many as the tolerances need.
        form_nm: largest form error of an optical face, in nm; None: the spec's.
        normal_mrad: largest error of its normal, in mrad, or less where light asks for it; None: the spec's.
        rings: number of equal rings of the mesh; None: as many as its tolerance and the light need.
        date: of the files, a date or "2026-01-31"; None: the spec's.
    Returns: The part: the bytes of its files, its errors, ``solid`` for cadquery and ``mesh`` for trimesh.
    Raises: :class:`InputError` for an argument that is not allowed, or a lens whose surfaces enclose no body.
    Example:
        >>> part = lf.build(lf.load("cad_out/quickstart").lens)
        >>> print(part.volume_mm3, part.form_error_nm.max)
        >>> part.save("lens.step")
    """
    from lensforge.cad.part_export import build_part
    from lensforge.proof.export_trial import fineness

    require(lens, Lens, "build")
    nodes = count_of("nodes", nodes)
    rings = count_of("rings", rings) or preset_of(lens.accuracy).part.mesh_rings
    extension_deg = number_of("extension_deg", extension_deg)
    date = date_of("date", date)
    tolerance = face_tolerance(lens, number_of("form_nm", form_nm), number_of("normal_mrad", normal_mrad))
    fine = fineness(lens, tolerance, nodes, rings)
    make = partial(
        build_part,
        lens,
        schema=schema,
        extension_deg=extension_deg,
        tolerance=fine.tolerance,
        rings=rings,
        least_rings=fine.rings,
        date=date,
    )
    part = make(nodes=nodes)
    while nodes is None and _needs_finer_rim(part):
        part = make(nodes=round(_FINER * max(part.nodes.values())))
    return part


def _needs_finer_rim(part: Part) -> bool:
    """True where the STEP does not read back as it was written, and its splines may have more nodes.

    Few of them may keep the tolerance of a face, and yet meet the rim by an edge that the kernel writes too coarsely.
    """
    changed = state_of(part.criteria, "step_volume_change") == "fail"
    return changed and max(part.nodes.values()) <= MAX_NODES / _FINER


@public
@with_known_names
def check(part: Part | Lens, *, process: Process | None = None) -> Check:
    """Check whether a part can be made: best-fit sphere, curvature, cutter, wall, draft.

    Args:
        part: the part, or a lens.
        process: by which it is made; None: that of its spec.
    Returns: The check: each face and tool, and ``verdicts`` that say what fails and which field to change.
    Raises: :class:`InputError` for a process by which no such part is made.
    Example:
        >>> check = lf.check(lf.load("cad_out/quickstart").part)
        >>> for fact in check.verdicts:
        ...     print(fact.label, fact.state)
    """
    from lensforge.shop.check import check_lens, check_made_by

    lens = part if isinstance(part, Lens) else require(part, Part, "check").lens
    if process is None or process == lens.spec.manufacture.process:
        return check_lens(lens)
    return check_made_by(lens, process)


@dataclass(frozen=True)
class Listener:
    """Functions that hear of the stages: ``begins`` gets a stage's name, ``ended`` its name and seconds."""

    begins: Callable[[str], None] = lambda _name: None
    ended: Callable[[str, float], None] = lambda _name, _seconds: None

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Tell of a stage that takes the time of the block."""
        self.begins(name)
        started = time.perf_counter()
        yield
        self.ended(name, time.perf_counter() - started)


@public
@with_options_of(design)
def run(
    spec: Spec,
    folder: Path | str,
    *,
    starts: int = 1,
    scheduler: str | None = None,
    announce: Callable[[str], None] | None = None,
    ended: Callable[[str, float], None] | None = None,
    **options: Unpack[SearchOptions],
) -> Run:
    """Run every stage and write a result folder: design, evaluate, photometry, export, check, verify, report.

    A missed criterion raises nothing: see the run's ``verdict``.

    Args:
        spec: what is wanted.
        folder: result folder, which is made where there is none.
        starts: number of searches, of which the best counts: :func:`best_design`.
        scheduler: a Dask cluster for them, as of :func:`best_design`; they keep no checkpoint, and take no ``start``.
        announce: called with the name of every later stage as it begins.
        ended: called with its name and seconds as it ends; with two cores some stages run side by side.
        options: as of :func:`design`. Without ``checkpoint`` the search begins anew and keeps one in the folder until
            the run has ended; a file given as ``checkpoint`` is never deleted.
    Returns: All results, as :func:`load` reads them.
    Raises: :class:`InputError` as :func:`design` does, and where another process or thread writes in ``folder``.
    Example:
        >>> spec = lf.load_spec("examples/quickstart.toml")
        >>> run = lf.run(spec, "cad_out/first", accuracy="draft")
        >>> print(run.verdict.light, run.light.nmse)
    """
    began = time.perf_counter()
    require_spec(spec, "run")
    require_base_around_cavity(spec.lens, spec.constraints, spec.base_made)  # before a long search
    folder = folder_of(folder)
    heard = Listener(announce or Listener.begins, ended or Listener.ended)
    if spec.lens.start is not None and spec.lens.start.resolve() == (folder / LENS_FILE).resolve():
        raise InputError(f"lens.start = {spec.lens.start}: the run would overwrite it; give another result folder")
    with opened(folder, create=True) as here, threads_of_torch(options.get("threads")):
        require_own(folder / REPORT_FILE)
        with _second_process(spec, options.get("warn") or warnings.warn) as second:
            if starts != 1 or scheduler is not None:
                made = best_design(spec, starts=starts, scheduler=scheduler, announce=announce, **options)
            else:
                resume = options.get("checkpoint") is not None
                options["checkpoint"] = options.get("checkpoint") or folder / CHECKPOINT
                made = design(spec, resume=resume, **options)
            here.write(_with_tool_costs(made, heard))
            run_later_stages(here, heard, second)
            write_kinds(here.run, heard)
        with heard.timed("report"):
            here.write_report(seconds=time.perf_counter() - began)
        delete_checkpoint(folder / CHECKPOINT)  # not earlier: a run interrupted in any stage resumes from it
        return here.run


def _with_tool_costs(made: Design, heard: Listener) -> Design:
    """The search with what it costs that its lens can be made."""
    if not holding_tools(made):
        return made
    with heard.timed(COSTS):
        return made.changed(tool_costs=tool_costs(made))


@contextmanager
def _second_process(spec: Spec, warn: Warn) -> Iterator[ChildPool]:
    """A second process where there are two cores.

    It compiles the search's kernels while this one checks the scene, and loads the CAD kernel while this one searches.
    """
    import torch

    from lensforge.kernels.compiled import are_compiled
    from lensforge.search.scene_check import compile_search_kernels

    with child_pool(int(torch.get_num_threads() > 1), warn) as second:
        if second.runs:
            if not are_compiled():
                second.call(compile_search_kernels, spec)
            second.call(_load_cad_kernel)
        yield second


def _load_cad_kernel() -> None:
    import OCP.gp  # noqa: F401  two seconds

    import lensforge.cad.part_export  # noqa: F401


def run_later_stages(here: RunFolder, heard: Listener, second: ChildPool) -> None:
    """Evaluate, export, check, verify and photometry of the lens in a folder; the same bits on one core or more."""
    import torch

    return_freed_memory()  # of the search: two processes are to need no more than one did
    if second.runs:
        _side_by_side(here, heard, second, torch.get_num_threads())
    else:
        _one_after_another(here, heard)


def _one_after_another(here: RunFolder, heard: Listener) -> None:
    lens = here.run.lens
    with heard.timed(Light.stage):
        light = here.write(evaluate(lens))
    with heard.timed(Part.stage):
        part = here.write(build(lens))
    with heard.timed(Check.stage):
        here.write(check(part))
    with heard.timed(Proof.stage):
        here.write(verify(part, light))
    with heard.timed(Photometry.stage):
        here.write(photometry(lens))


def _side_by_side(here: RunFolder, heard: Listener, second: ChildPool, threads: int) -> None:
    """Run the stages with a second process, which has the part to make and to check, and then a share of verify.

    It takes one of the ``threads`` while it is busy: a light of many rays takes longer than the part.
    """
    lens = here.run.lens
    made = second.call(build, lens)
    checked = second.call(check, lens)
    heard.begins(Part.stage)
    with kernel_threads(lambda: max(1, threads - second.busy)):
        with heard.timed(Light.stage):
            light = here.write(evaluate(lens))
        with heard.timed(Photometry.stage):
            here.write(photometry(lens))
    return_freed_memory()
    part = made.result()
    for content in (part.step, part.stl, part.threemf, part.plate_stl or b""):
        remembered(content)  # this program made them, if not this process
    here.write(part)
    heard.ended(Part.stage, part.seconds)
    heard.begins(Check.stage)
    with heard.timed(Proof.stage), kernel_threads(max(1, threads - 1)):
        proof = verify_with(second, part, light)
        check_result = here.write(checked.result())
        heard.ended(Check.stage, check_result.seconds)
        here.write(proof)


def write_kinds(first: Run, heard: Listener) -> None:
    """Write a whole result folder for the lens of each further kind: built, checked and verified as any other.

    Its light is that of all lamps, its search that of all lenses: both are the first one's.
    """
    for lens in (kind for kind in first.lens.kinds if kind.kind != first.lens.kind):
        with heard.timed(lens.kind), opened(first.folder / lens.kind, create=True) as there:
            there.write(_of_lens(first.design, lens).changed(lens=lens))
            light = there.write(_of_lens(first.light, lens))
            there.write(_of_lens(first.photometry, lens))
            part = there.write(build(lens))
            there.write(check(part))
            there.write(verify(part, light))
            there.write_report()


def _of_lens(result: _Result, lens: Lens) -> _Result:
    return result.changed(inputs={**result.inputs, "lens": lens.sha256})


def write_report(folder: Path) -> Run:
    """Write ``report.html`` from the results in ``folder``, and return the run.

    Raises :class:`InputError` for a record or a file of other content than the hashes say, before anything is written.
    """
    with opened(folder) as here:
        here.to_show()
        here.write_report()
        return here.run


def write_comparison(folders: Sequence[Path], page: Path) -> None:
    """Write one page that compares the designs in ``folders``."""
    from lensforge.report.compare import folder_names, render_comparison
    from lensforge.report.page import write_page

    names = folder_names(folders)
    write_page(render_comparison([existing(folder).to_show() for folder in folders], names), page)


@public
@with_known_names
def sweep(
    spec: Spec,
    field: str | None = None,
    values: Sequence[float | str] | None = None,
    *,
    source: Sequence[NamedSource | EmitterSection | Path | str] | None = None,
    scale: Sequence[str] = (),
    accuracy: AnyAccuracy = "standard",
    seed: int = 0,
    threads: int | None = None,
    progress: Observer | None = None,
) -> Sweep:
    """Run every stage for each value of a field, or for each of several LEDs, in memory.

    Args:
        spec: the spec that is varied.
        field: dotted name of the field, such as "constraints.max_radius_mm".
        values: its values, at least two: numbers in the field's unit, or words of a choice.
        source: in their place, LEDs: sections, ray files, or :class:`NamedSource`.
        scale: further fields, which keep their ratio to the varied one.
        accuracy: as of :func:`design`, as are ``seed``, ``threads`` and ``progress``.
        seed: of every search.
        threads: number of threads, from 1; None: all cores.
        progress: called after every gradient step.
    Returns: The designs, smallest value first; ``failed`` has the reasons for those without.
    Raises: :class:`InputError` for an unknown field, or values that it does not take.
    Example:
        >>> spec = lf.load_spec("examples/quickstart.toml")
        >>> sweep = lf.sweep(spec, "constraints.max_radius_mm", [13.0, 14.0], accuracy="draft")
        >>> sweep.save("sweep.png")
    """
    require_spec(spec, "sweep")
    if source is not None:
        if field is not None or values is not None or scale:
            raise InputError("sweep: field, values or scale, and source: give a field with its values, or sources")
        variation: AnyVariation = sources_of(source, spec)
    else:
        variation = variation_of(field, values or (), tuple(scale))
    designs = []
    for variant in variation.variants(spec):
        made = design(variant.spec, accuracy=accuracy, seed=seed, threads=threads, progress=progress)
        designs.append((variant, list(_run_in_memory(made, threads))))
    return sweep_of(spec, variation, designs)


def _run_in_memory(made: Design, threads: int | None) -> Iterator[Results]:
    """Evaluate, build, check and verify the lens of each kind: the stages of a run, without a folder."""
    evaluated = evaluate(made.lens, threads=threads)
    for lens in made.lens.kinds:
        result = _of_lens(made, lens).changed(lens=lens)
        light = _of_lens(evaluated, lens)
        part = build(lens)
        results: tuple[StageResult, ...] = (result, light, part, check(part), verify(part, light, threads=threads))
        yield Results(lens, {result.stage: result for result in results})


@public
@with_known_names
def tradeoff(
    spec: Spec,
    *,
    lens: Lens | None = None,
    most_rays: int = 2**20,
    accuracy: AnyAccuracy = "standard",
    threads: int | None = None,
    announce: Callable[[str], None] | None = None,
) -> Tradeoff:
    """Measure accuracy against computing time for the scene of a spec.

    Args:
        spec: the scene.
        lens: lens on which it is measured, of the same scene; None: a draft, designed first.
        most_rays: of the largest sample, 2^12 to 2^24.
        accuracy: of the search whose stages are followed.
        threads: number of threads, from 1; None: all cores.
        announce: called with the name of each study as it begins.
    Returns: A row for each stage of the search, each number of rays and each preset.
    Raises: :class:`InputError` for an argument that is not allowed, or a lens of another scene.
    Example:
        >>> lens = lf.load("cad_out/quickstart").lens
        >>> study = lf.tradeoff(lens.spec, lens=lens, most_rays=2**12, accuracy="draft")
        >>> study.save("tradeoff.png")
    """
    from lensforge.report.tradeoff_study import measure, require_same_scene

    require_spec(spec, "tradeoff")
    if not (isinstance(most_rays, int) and 2**12 <= most_rays <= 2**24):
        raise InputError(f"most_rays = {most_rays!r}: an integer from {2**12} to {2**24}")
    source = searched_source(spec)
    if lens is None:
        lens = design(spec, accuracy="draft", threads=threads).lens
    else:
        require_same_scene(require(lens, Lens, "tradeoff"), spec, source, "tradeoff")
    with threads_of_torch(threads):
        return measure(lens, source, most_rays, accuracy_of(accuracy), announce or (lambda _: None))
