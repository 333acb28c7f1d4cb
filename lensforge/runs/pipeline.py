"""The whole run: a search, and every stage after it, side by side where there are two cores.

The CAD kernel computes on one core and holds Python's lock. So the part is made in a second process while this one
simulates the light, and is checked there while this one verifies it with the second one's help. Only this one writes.
A result that misses a criterion is still written; the verdict says so.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate
from lensforge.light.photometry_result import Photometry
from lensforge.proof.casts import verify, verify_with
from lensforge.proof.proof_result import Proof
from lensforge.report.results import REPORT_FILE
from lensforge.results.arguments import threads_of_torch
from lensforge.results.file_bounds import remembered
from lensforge.results.freed_memory import return_freed_memory
from lensforge.results.ownership import require_own
from lensforge.results.second_process import SecondProcess, second_process
from lensforge.runs.folder import Run, RunFolder, existing, folder_of, opened
from lensforge.runs.stage import build, check, photometry
from lensforge.search.checkpoint import CHECKPOINT, delete_checkpoint
from lensforge.search.searches import SearchOptions, best_design, design
from lensforge.shop.check_result import Check
from lensforge.spec import Spec
from lensforge.spec.design_spec import require_spec
from lensforge.spec.feasible import require_base_around_cavity
from lensforge.surfaces.imported_face import LENS_FILE


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
    """Run every stage and write ``folder``: design, evaluate, photometry, export, check, verify, report.

    ``options`` are those of :func:`lensforge.design`. Without ``checkpoint`` the search starts anew and keeps one
    in the folder until the run has ended; a file given as ``checkpoint`` is never deleted. ``announce`` is called with
    the name of every later stage as it begins, ``ended`` with its name and seconds as it ends: where there are two
    cores, some run side by side. A missed criterion raises nothing: see the run's ``verdict``. Raises
    :class:`InputError` at once where another process or thread writes in ``folder``, as does every stage.
    ``starts``, ``scheduler``: as of :func:`best_design`; they keep no checkpoint, and take no ``start``.
    """
    began = time.perf_counter()
    require_spec(spec, "run")
    require_base_around_cavity(spec.lens, spec.constraints, spec.base)  # a run makes the part, its search may be long
    folder, heard = folder_of(folder), Listener(announce or Listener.begins, ended or Listener.ended)
    if spec.lens.start is not None and spec.lens.start.resolve() == (folder / LENS_FILE).resolve():
        raise InputError(f"lens.start = {spec.lens.start}: the run would overwrite it; give another result folder")
    with opened(folder, create=True) as here, threads_of_torch(options.get("threads")):
        require_own(folder / REPORT_FILE)
        with _process_for_later_stages() as second:
            if starts != 1 or scheduler is not None:
                made = best_design(spec, starts=starts, scheduler=scheduler, announce=announce, **options)
            else:
                resume = options.get("checkpoint") is not None
                if not resume:
                    options["checkpoint"] = folder / CHECKPOINT
                made = design(spec, resume=resume, **options)
            here.write(made)
            run_later_stages(here, heard, second)
        with heard.timed("report"):
            here.write_report(seconds=time.perf_counter() - began)
        delete_checkpoint(folder / CHECKPOINT)  # not earlier: a run interrupted in any stage resumes from it
        return here.run


@contextmanager
def _process_for_later_stages() -> Iterator[SecondProcess]:
    """A second process where there are two cores, which loads the CAD kernel while this one searches."""
    import torch

    with second_process(torch.get_num_threads() > 1) as second:
        if second.runs:
            second.call(_load_cad_kernel)
        yield second


def _load_cad_kernel() -> None:
    import cadquery  # noqa: F401  two seconds

    import lensforge.cad.part_export  # noqa: F401


def run_later_stages(here: RunFolder, heard: Listener, second: SecondProcess) -> None:
    """Evaluate, export, check, verify and photometry of the lens in a folder; the same bits on one core or more."""
    import torch

    return_freed_memory()  # of the search: two processes are to need no more than one did
    if second.runs:
        with threads_of_torch(max(1, torch.get_num_threads() - 1)):
            _side_by_side(here, heard, second)
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


def _side_by_side(here: RunFolder, heard: Listener, second: SecondProcess) -> None:
    """Run the stages with a second process, which has the part to make and to check, and then a share of verify."""
    from lensforge.shop.check import check_lens

    lens = here.run.lens
    made = second.call(build, lens)
    checked = second.call_after(made, lambda part: (lens, part.nodes), check_lens)
    heard.begins(Part.stage)
    with heard.timed(Light.stage):
        light = here.write(evaluate(lens))
    with heard.timed(Photometry.stage):
        here.write(photometry(lens))
    return_freed_memory()
    part = made.result()
    for content in (part.step, part.stl, part.threemf):
        remembered(content)  # this program made them, if not this process
    here.write(part)
    heard.ended(Part.stage, part.seconds)
    heard.begins(Check.stage)
    with heard.timed(Proof.stage):
        proof = verify_with(second, part, light)
        found = here.write(checked.result())
        heard.ended(Check.stage, found.seconds)
        here.write(proof)


def write_report(folder: Path) -> Run:
    """Write ``report.html`` from the results in ``folder``, and return the run; a PDF of an earlier page is deleted.

    Raises :class:`InputError` for a record or a file of other content than the hashes say, before anything is written.
    """
    with opened(folder) as here:
        here.to_show()
        here.write_report()
        return here.run


def write_comparison(folders: Sequence[Path], page: Path) -> None:
    """Write one page that compares the designs in ``folders``; a PDF of an earlier page is deleted."""
    from lensforge.report.compare import folder_names, render_comparison
    from lensforge.report.page import write_page

    names = folder_names(folders)
    write_page(render_comparison([existing(folder).to_show() for folder in folders], names), page)
