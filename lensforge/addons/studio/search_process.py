"""The process of the studio that searches and makes the part, by the stages of the commands, in the same folder.

Where its pipe ends, so does it: a search leaves its checkpoint.
"""

import os
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, sys.argv[1])  # the folder of the package, of the version that started this

from lensforge.results.worker import collect_garbage_seldom, ignore_settings_of_libraries, keep_freed_memory

if __name__ == "__main__":
    ignore_settings_of_libraries()
    collect_garbage_seldom()
    keep_freed_memory()

import torch

from lensforge.addons.studio.job_pipe import JobPipe
from lensforge.addons.studio.run_view import run_arrays, run_words
from lensforge.addons.studio.search_job import SearchJob
from lensforge.addons.studio.search_watch import SearchWatch
from lensforge.addons.studio.spec_text import SpecText, lines_of
from lensforge.errors import Cancelled, FileWarning, LensforgeError, SourceWarning
from lensforge.light.lens_light import evaluate
from lensforge.proof.casts import verify
from lensforge.report.folder import Run, RunFolder, load, opened
from lensforge.report.pipeline import Listener, build, check, run_later_stages, write_kinds
from lensforge.report.results import handover
from lensforge.results.child_pool import child_pool
from lensforge.scene.lens import Lens
from lensforge.search.checkpoint import CHECKPOINT, delete_checkpoint
from lensforge.search.scene_check import compile_search_kernels
from lensforge.search.searches import design, require_searchable
from lensforge.spec import Spec
from lensforge.spec.feasible import require_base_around_cavity

_START_FILE = "studio_start.json"  # the lens from which a search has begun


class Worker:
    """Jobs of the ``pipe`` in their order."""

    def __init__(self, pipe: JobPipe) -> None:
        self._pipe = pipe
        self._latest: Lens | None = None  # from which another search may go on

    def work(self) -> None:
        """Do jobs until there are no more."""
        for job in self._pipe.jobs():
            how, lines = self._ended(job)
            if job["job"] not in ("warm", "judge"):
                self._pipe.send("ended", job=job["job"], how=how, lines=lines)

    def _ended(self, job: Mapping[str, Any]) -> tuple[str, list[str]]:
        """Do a job. Returns how it ended, and the lines that say why it was refused."""
        kinds = {
            "search": self._search,
            "part": self._part,
            "look": self._look,
            "warm": self._warm,
            "judge": self._judge,
        }
        try:
            with self._pipe.interrupting(job):
                kinds[job["job"]](job)
        except (Cancelled, KeyboardInterrupt):
            return self._pipe.asked or "stop", []
        except LensforgeError as error:
            return "refused", str(error).splitlines()
        except Exception as error:  # a bug: the page says so, and the next job begins
            return "refused", [f"internal error: {type(error).__name__}: {error}"]
        return "done", []

    def _warm(self, job: Mapping[str, Any]) -> None:
        """Load and compile what a search of this spec needs, before it is asked for."""
        import lensforge.light.evaluation  # noqa: F401

        compile_search_kernels(_spec_of(job))

    def _judge(self, job: Mapping[str, Any]) -> None:
        """Say why no search of a text would begin; a text that has been changed since is left out."""
        if job["version"] == self._pipe.newest:
            lines = tuple[tuple[str, str], ...]()
            try:
                _require_searchable(_spec_of(job), job)
            except LensforgeError as error:
                lines = lines_of(error)
            self._pipe.send("judged", version=job["version"], lines=lines)

    def _search(self, job: Mapping[str, Any]) -> None:
        """Search, evaluate, and write both; a search that is paused or stopped leaves its checkpoint and its job.

        A search that is refused leaves nothing: what was there before may still go on.
        """
        folder = Path(job["folder"])
        spec = _spec_of(job)
        begins_from_lens = job["start"]
        with opened(folder, create=True) as here:
            if not job["resume"]:
                _require_searchable(spec, job)
                begins_from_lens = begins_from_lens and self._written_start(folder, spec)
                settings = {name: job[name] for name in ("text", "accuracy", "seed", "force")}
                SearchJob(**settings, start=begins_from_lens).write(folder)
            if begins_from_lens:
                spec = spec.replace({"lens.start": str((folder / _START_FILE).resolve())})
            watch = SearchWatch(self._pipe, spec)
            try:
                made = design(
                    spec,
                    accuracy=job["accuracy"],
                    seed=job["seed"],
                    checkpoint=folder / CHECKPOINT,
                    resume=job["resume"],
                    progress=watch.on_step,
                    warn=self._pipe.warn,
                    force=job["force"],
                )
            finally:
                self._latest = watch.closed() or self._latest
            here.write(made)
            self._pipe.send("stage", name="evaluate")
            here.write(evaluate(made.lens))
            delete_checkpoint(folder / CHECKPOINT)  # not earlier: a run interrupted in any stage resumes from it
            self._show(here.run, "own")

    def _written_start(self, folder: Path, spec: Spec) -> bool:
        """Write the lens that is there as the one to begin from; False where there is none, or another kind."""
        lens = self._latest
        if lens is None or lens.others or spec.all_lamps.kinds:
            return False
        if lens.spec.lens.kind != spec.lens.kind:
            self._pipe.warn(
                f"lens: there is no way from kind {lens.spec.lens.kind!r} to this one; the search begins anew"
            )
            return False
        lens.save(folder / _START_FILE)
        return True

    def _part(self, job: Mapping[str, Any]) -> None:
        """All stages after the search, as ``lensforge design`` runs them, documents for the shop, and the report."""
        heard = Listener(lambda name: self._pipe.send("stage", name=name))
        if self._pipe.asked:
            raise Cancelled
        with opened(Path(job["folder"])) as here:
            if job["rings"]:
                _export_finer(here, heard, job["rings"])
            else:
                with child_pool(int(torch.get_num_threads() > 1), self._pipe.warn) as second:
                    run_later_stages(here, heard, second)
                    write_kinds(here.run, heard)
            with heard.timed("drawing"):
                handover(here.run).save(here.path)
            with heard.timed("report"):
                here.write_report()
            self._show(here.run, "own")

    def _look(self, job: Mapping[str, Any]) -> None:
        """Show the lens of a folder, the studio's own or one beside it."""
        self._show(load(Path(job["folder"])), job["place"])

    def _show(self, run: Run, place: str) -> None:
        """Send a finished lens with its light, its search and its figures."""
        if place == "own":
            self._latest = run.lens
        figure = self._pipe.figure
        self._pipe.send(place, run_arrays(run, figure), figure=figure, **run_words(run))


def _export_finer(here: RunFolder, heard: Listener, rings: int) -> None:
    """Export the lens of a folder with a mesh of so many ``rings``, and judge its part again."""
    with heard.timed("export"):
        part = here.write(build(here.run.lens, rings=rings))
    with heard.timed("check"):
        here.write(check(part))
    with heard.timed("verify"):
        here.write(verify(part, here.run.light))


def _require_searchable(spec: Spec, job: Mapping[str, Any]) -> None:
    """Raise :class:`InputError` for what no search begins with; the part's base, too, before a long search."""
    require_base_around_cavity(spec.lens, spec.constraints, spec.base_made)
    require_searchable(spec, accuracy=job["accuracy"], force=job["force"])


def _spec_of(job: Mapping[str, Any]) -> Spec:
    return SpecText.of(job["text"], Path(job["path"])).required()


def main() -> None:
    """Do jobs until the studio ends."""
    pipe = JobPipe()
    warnings.showwarning = lambda message, kind, *_place, **_more: (
        pipe.warn(str(message)) if issubclass(kind, FileWarning | SourceWarning) else None
    )
    Worker(pipe).work()
    os._exit(0)  # nothing to be saved; libraries would take a second to end


if __name__ == "__main__":
    main()
