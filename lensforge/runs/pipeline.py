"""Runs in a result folder: all stages in turn, or one stage again; each writes its files.

A result that misses a criterion is still written; ``run.json`` holds the verdict and is renewed by every stage. A
result under other conditions than the lens's own, such as another source, goes beside the lens's own one.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.results.folder_lock import in_locked_folder, locked
from lensforge.results.ownership import require_own
from lensforge.runs import cast_stages, stages
from lensforge.runs.arguments import threads_of_torch
from lensforge.runs.later_stages import Announce, Ended, Told, process_for_later_stages, run_later_stages
from lensforge.runs.other_conditions import light_conditions, source_with_file
from lensforge.runs.results import REPORT_FILE
from lensforge.runs.run_folder import Run, folder_of, load_to_show, open_run, renew, require_free, write_result
from lensforge.runs.starts import best_design
from lensforge.scene.lens import Lens, load_lens
from lensforge.search.checkpoint import CHECKPOINT, delete_checkpoint, is_checkpoint
from lensforge.search.design_result import Design, Observer
from lensforge.shop.check_result import Check
from lensforge.sources.photometric.ies import NEWEST, IesVersion
from lensforge.spec import Accuracy, DrawingSection, Spec
from lensforge.spec.design_spec import require_spec
from lensforge.spec.feasible import require_base_around_cavity
from lensforge.surfaces.imported_face import LENS_FILE

if TYPE_CHECKING:
    from lensforge.shop.dense_table import GridRequest
    from lensforge.shop.handover import Handover


def run(
    spec: Spec,
    folder: Path | str,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    threads: int | None = None,
    start: Lens | None = None,
    checkpoint: Path | str | None = None,
    progress: Observer | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    announce: Announce | None = None,
    ended: Ended | None = None,
    warn: Callable[[str], None] | None = None,
    anyway: bool = False,
    starts: int = 1,
    scheduler: str | None = None,
) -> Run:
    """Run every stage and write ``folder``: design, evaluate, photometry, export, check, verify, report.

    Arguments are those of :func:`lensforge.design`. Without ``checkpoint`` the search starts anew and keeps one
    in the folder until the run has ended; a file given as ``checkpoint`` is never deleted. ``announce`` is called with
    the name of every later stage as it begins, ``ended`` with its name and seconds as it ends: where there are two
    cores, some run side by side. A missed criterion raises nothing: see the run's ``verdict``. Raises
    :class:`InputError` at once where another process or thread writes in ``folder``, as does every stage below.
    ``starts``, ``scheduler``: as of :func:`best_design`; they keep no checkpoint, and take no ``start``.
    """
    began = time.perf_counter()
    require_spec(spec, "run")
    require_base_around_cavity(spec.lens, spec.constraints, spec.base)  # a run makes the part, its search may be long
    several = starts != 1 or scheduler is not None
    if several and (start is not None or checkpoint is not None or device != "cpu"):
        raise InputError("several starts, or a scheduler: without start, checkpoint (--resume) and device")
    folder, announce, ended = folder_of(folder), announce or (lambda _: None), ended or (lambda _name, _seconds: None)
    if spec.lens.start is not None and spec.lens.start.resolve() == (folder / LENS_FILE).resolve():
        raise InputError(f"lens.start = {spec.lens.start}: the run would overwrite it; give another result folder")
    with locked(folder, create=True), threads_of_torch(threads):
        require_own(folder / REPORT_FILE)
        told = Told(announce, ended)
        with process_for_later_stages() as second:
            result = (
                best_design(
                    spec,
                    starts=starts,
                    accuracy=accuracy,
                    seed=seed,
                    scheduler=scheduler,
                    progress=progress,
                    announce=announce,
                    warn=warn,
                    anyway=anyway,
                )
                if several
                else stages.design(
                    spec,
                    accuracy=accuracy,
                    seed=seed,
                    start=start,
                    checkpoint=folder / CHECKPOINT if checkpoint is None else checkpoint,
                    resume=checkpoint is not None,
                    progress=progress,
                    device=device,
                    warn=warn,
                    anyway=anyway,
                )
            )
            write_design(result, folder)
            run_later_stages(folder, told, second)
        with told.timed("report"):
            refresh_report(folder, seconds=time.perf_counter() - began)
        delete_checkpoint(folder / CHECKPOINT)  # not earlier: a run interrupted in any stage resumes from it
        return open_run(folder)


def resumable(folder: Path) -> bool:
    """True where an interrupted run in ``folder`` can be resumed."""
    return is_checkpoint(folder / CHECKPOINT)


def write_design(result: Design, folder: Path) -> Design:
    """Write ``lens.json`` and ``design.json``."""
    result.lens.save(folder / LENS_FILE)
    return write_result(result, folder)


@in_locked_folder
def run_evaluate(
    folder: Path,
    *,
    rays: int | None = None,
    pixels: int | None = None,
    source: Path | None = None,
    temperature_c: float | None = None,
    name: str | None = None,
) -> Light:
    """Simulate the finished lens again.

    Where ``rays``, ``pixels``, ``source`` (a ray file in place of the spec's source) or ``temperature_c`` are not the
    lens's own, the light is written to ``evaluate_<name>.json``; ``name`` is by default made from what differs. Raises
    :class:`InputError` where that file holds the light under other conditions.
    """
    lens = load_lens(folder / LENS_FILE)
    other = source_with_file(lens.spec, source)
    conditions = light_conditions(lens, source=other, rays=rays, pixels=pixels, temperature_c=temperature_c)
    if conditions is not None:
        conditions = conditions if name is None else conditions.renamed(name)
        require_free(folder, lens, conditions)
    elif name is not None:
        raise InputError(f"name = {name!r}: these are the lens's own conditions; give it with another source or rays")
    light = stages.evaluate(lens, rays=rays, pixels=pixels, source=other, temperature_c=temperature_c)
    if conditions is not None and light.conditions is not None:
        light = light.model_copy(update={"conditions": light.conditions.renamed(conditions.name)})
    return write_result(light, folder)


@in_locked_folder
def run_export(
    folder: Path,
    *,
    schema: Literal["AP214", "AP242"] = "AP214",
    runout_deg: float | None = None,
    nodes: int | None = None,
    rings: int | None = None,
    date: str | None = None,
) -> Part:
    """Write STEP, STL and 3MF, verified by reading them back."""
    lens = load_lens(folder / LENS_FILE)
    part = stages.build(lens, schema=schema, runout_deg=runout_deg, nodes=nodes, rings=rings, date=date)
    return write_result(part, folder)


@in_locked_folder
def run_check(folder: Path) -> Check:
    """Check whether the part can be cut: the exported one or, before an export, the one to be exported."""
    from lensforge.shop.check import check_lens, check_part

    part = open_run(folder).find(Part)
    return write_result(check_lens(load_lens(folder / LENS_FILE)) if part is None else check_part(part), folder)


@in_locked_folder
def run_verify(folder: Path, *, rays: int | None = None) -> Proof:
    """Cast rays through the exported part, and compare their landings with the design's.

    With other ``rays`` than the preset's the proof is written to ``verify_<rays>rays.json``; so are, under their own
    names, the results of the functions below.
    """
    results = open_run(folder)
    return write_result(cast_stages.verify(results.part, results.light, rays=rays), folder)


@in_locked_folder
def run_stray(folder: Path, *, rays: int | None = None, base: Literal["polished", "black"] = "polished") -> StrayLight:
    """Follow rays through the exported part with reflections, base and absorption."""
    return write_result(cast_stages.stray_light(open_run(folder).part, rays=rays, base=base), folder)


@in_locked_folder
def run_photometry(
    folder: Path, *, rays: int | None = None, lumens: float | None = None, ies_version: IesVersion = NEWEST
) -> Photometry:
    """Write the light of the lens as IES, EULUMDAT, TM-33 and TM-25 files."""
    lens = load_lens(folder / LENS_FILE)
    return write_result(stages.photometry(lens, rays=rays, lumens=lumens, ies_version=ies_version), folder)


@in_locked_folder
def run_handover(folder: Path, request: "GridRequest | None" = None, words: DrawingSection | None = None) -> "Handover":
    """Write the documents that go to the shop with the STEP file.

    ``request``: of the dense tables of points. ``words``: of the drawing's title block; None: those of the spec.
    """
    from lensforge.shop.shop_files import make_handover

    handover = make_handover(load_to_show(folder), request, words)
    handover.save(folder)
    renew(folder)
    return handover


@in_locked_folder
def run_report(folder: Path) -> Path:
    """Write ``report.html`` from the results in ``folder``; a PDF of an earlier page is deleted.

    Raises :class:`InputError` for a record or a file of other content than the hashes say, before anything is written.
    """
    load_to_show(folder)
    return refresh_report(folder)


def refresh_report(folder: Path, *, seconds: float | None = None) -> Path:
    """Write ``report.html`` as :func:`run_report` does; a record that it would refuse counts as not run.

    ``seconds``: that a whole run has taken so far.
    """
    from lensforge.report.lens_page import render_report
    from lensforge.report.page import write_page

    renew(folder, seconds=seconds)  # before the page is written: it states the hash of every file
    write_page(render_report(open_run(folder), folder), folder / REPORT_FILE)
    return folder / REPORT_FILE


def run_comparison(folders: Sequence[Path], page: Path) -> Path:
    """Write one page that compares the designs in ``folders``; a PDF of an earlier page is deleted."""
    from lensforge.report.compare import folder_names, render_comparison
    from lensforge.report.page import write_page

    names = folder_names(folders)
    write_page(render_comparison([load_to_show(folder) for folder in folders], names), page)
    return page
