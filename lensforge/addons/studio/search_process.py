"""The process of the studio that searches and makes the part, by the stages of the commands, in the same folder.

It takes jobs as lines of JSON and answers by frames, each after its length (uint32). A search is looked at by a thread
of its own, so that it never waits for a picture. Where its pipe ends, so does it: a search leaves its checkpoint.
"""

import _thread
import json
import os
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, sys.argv[1])  # the folder of the package, of the version that started this

from lensforge.results.worker import collect_garbage_seldom, ignore_settings_of_libraries, keep_freed_memory

if __name__ == "__main__":
    ignore_settings_of_libraries()
    collect_garbage_seldom()
    keep_freed_memory()

import numpy as np
import torch

from lensforge.addons.studio.cures import cure_of
from lensforge.addons.studio.folder_files import DOWNLOADS
from lensforge.addons.studio.lens_view import as_tabulated, drawn
from lensforge.addons.studio.page_frames import Fields, packed
from lensforge.addons.studio.physics import chart_head
from lensforge.addons.studio.search_job import SearchJob
from lensforge.addons.studio.spec_text import SpecText, lines_of
from lensforge.errors import Cancelled, FileWarning, InputError, LensforgeError, SourceWarning
from lensforge.kernels.fate import Fate
from lensforge.light.lens_light import evaluate, source_of
from lensforge.proof.casts import verify
from lensforge.report.folder import Run, RunFolder, load, opened
from lensforge.report.headline import headline, required_facts
from lensforge.report.pipeline import Listener, build, check, run_later_stages, write_kinds
from lensforge.report.results import REPORT_FILE, handover
from lensforge.results.child_pool import child_pool
from lensforge.results.files import MIB, read_file
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.search.checkpoint import CHECKPOINT, delete_checkpoint
from lensforge.search.design_result import ENOUGH, Progress
from lensforge.search.scene_check import compile_search_kernels
from lensforge.search.searches import design, require_searchable
from lensforge.sources.build_source import summarise
from lensforge.spec import Spec
from lensforge.spec.feasible import require_base_around_cavity

_START_FILE = "studio_start.json"  # the lens from which a search has begun
_PHOTOMETRIC = (".ies", ".ldt", ".iesxml", ".tm25ray")
_BETWEEN_S = (0.25, 0.9)  # from one look to the next
_SHARE = 0.04  # of the time of one core for looks
_MEMORY = 0.8  # of the mean picture of the steps of a level, that stays at each step
_MOST_REPORT_BYTES = 256 * MIB
_ENDINGS = {"": None, "enough": ENOUGH}  # what an observer answers to a wish; False to any other


class Worker:
    """Jobs in their order, and the pipe to the studio; ``asked`` of the job that runs, "" for nothing."""

    def __init__(self) -> None:
        self.asked = ""
        self.figure = "sag"
        self._interruptible = False
        self._jobs = SimpleQueue[Fields | None]()
        self._lock = threading.Lock()
        self._pipe = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)  # what libraries print
        self._latest: Lens | None = None  # from which another search may go on
        self._newest = 0  # version of the text that was to be judged last
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            job = json.loads(line)
            if job["job"] == "figure":
                self.figure = job["name"]
            elif job["job"] in ("pause", "stop", "enough"):
                self._ask(job["job"])
            else:
                if job["job"] == "judge":
                    self._newest = job["version"]
                elif job["job"] in ("search", "part"):
                    self.asked = ""  # now, not when it begins: what is asked from here on is of this job
                self._jobs.put(job)
        self._ask("stop")
        self._jobs.put(None)

    def _ask(self, what: str) -> None:
        self.asked = what
        if self._interruptible:
            _thread.interrupt_main()

    def send(self, kind: str, arrays: Mapping[str, np.ndarray] | None = None, **more: object) -> None:
        """Send a frame."""
        frame = packed({"kind": kind, **more}, arrays or {})
        with self._lock:
            self._pipe.write(len(frame).to_bytes(4, "little") + frame)
            self._pipe.flush()

    def warn(self, words: str) -> None:
        """Send a warning."""
        self.send("warning", words=words)

    def work(self) -> None:
        """Do jobs until there are no more."""
        kinds = {"search": self._search, "part": self._part, "look": self._look}
        kinds |= {"warm": self._warm, "judge": self._judge}
        while (job := self._jobs.get()) is not None:
            self._interruptible = job["job"] in ("part", "look")
            how = "done"
            lines = list[str]()
            try:
                kinds[job["job"]](job)
            except (Cancelled, KeyboardInterrupt):
                how = self.asked or "stop"
            except LensforgeError as error:
                how = "refused"
                lines = str(error).splitlines()
            except Exception as error:  # a bug: the page says so, and the next job begins
                how = "refused"
                lines = [f"internal error: {type(error).__name__}: {error}"]
            self._interruptible = False
            if job["job"] not in ("warm", "judge"):
                self.send("ended", job=job["job"], how=how, lines=lines)

    def _warm(self, job: Mapping[str, Any]) -> None:
        """Load and compile what a search of this spec needs, before it is asked for."""
        import lensforge.light.evaluation  # noqa: F401

        compile_search_kernels(_spec_of(job))

    def _judge(self, job: Mapping[str, Any]) -> None:
        """Say why no search of a text would begin; a text that has been changed since is left out."""
        if job["version"] == self._newest:
            lines = tuple[tuple[str, str], ...]()
            try:
                _require_searchable(_spec_of(job), job)
            except LensforgeError as error:
                lines = lines_of(error)
            self.send("judged", version=job["version"], lines=lines)

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
            watch = _Watch(self, spec)
            try:
                made = design(
                    spec,
                    accuracy=job["accuracy"],
                    seed=job["seed"],
                    checkpoint=folder / CHECKPOINT,
                    resume=job["resume"],
                    progress=watch.on_step,
                    warn=self.warn,
                    force=job["force"],
                )
            finally:
                self._latest = watch.closed() or self._latest
            here.write(made)
            self.send("stage", name="evaluate")
            here.write(evaluate(made.lens))
            delete_checkpoint(folder / CHECKPOINT)  # not earlier: a run interrupted in any stage resumes from it
            self._show(here.run, "own")

    def _written_start(self, folder: Path, spec: Spec) -> bool:
        """Write the lens that is there as the one to begin from; False where there is none, or another kind."""
        lens = self._latest
        if lens is None or lens.others or spec.all_lamps.kinds:
            return False
        if lens.spec.lens.kind != spec.lens.kind:
            self.warn(f"lens: there is no way from kind {lens.spec.lens.kind!r} to this one; the search begins anew")
            return False
        lens.save(folder / _START_FILE)
        return True

    def _part(self, job: Mapping[str, Any]) -> None:
        """All stages after the search, as ``lensforge design`` runs them, documents for the shop, and the report."""
        heard = Listener(lambda name: self.send("stage", name=name))
        if self.asked:
            raise Cancelled
        with opened(Path(job["folder"])) as here:
            if job["rings"]:
                _export_finer(here, heard, job["rings"])
            else:
                with child_pool(int(torch.get_num_threads() > 1), self.warn) as second:
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
        arrays = dict[str, np.ndarray]()
        heads = list[dict[str, object]]()
        levels = run.design.history if "design" in run.found else ()
        for name in ("nmse", "efficiency"):
            arrays[name] = np.array([value for level in levels for value in getattr(level, name)])
        lights = run.light.receivers if "evaluate" in run.found else ()
        lumens = run.light.lumens_per_watt if lights else None
        for number, (light, section) in enumerate(zip(lights, run.spec.in_first_state.all_receivers, strict=True)):
            heads.append(chart_head(section, light.width, light.height, lumens))
            arrays[f"light{number}"] = (lumens or 1.0) * light.map
            arrays[f"target{number}"] = (lumens or 1.0) * light.target_map
        facts = [[fact.label, fact.sentence, fact.state] for fact in required_facts(run)]
        words = {
            "name": run.spec.name,
            "folder": run.folder.resolve().name,
            "facts": facts,
            "sentence": headline(run).sentence,
            "verdicts": _verdicts(run),
            "old": list(_files_of_lens_before(run)),
        }
        fates = [fate.name.lower().replace("_", " ") for fate in Fate]
        if place == "own":
            self._latest = run.lens
        arrays |= drawn(run.lens, self.figure, whole=True)
        self.send(place, arrays, receivers=heads, figure=self.figure, fates=fates, **words)


def _export_finer(here: RunFolder, heard: Listener, rings: int) -> None:
    """Export the lens of a folder with a mesh of so many ``rings``, and judge its part again."""
    with heard.timed("export"):
        part = here.write(build(here.run.lens, rings=rings))
    with heard.timed("check"):
        here.write(check(part))
    with heard.timed("verify"):
        here.write(verify(part, here.run.light))


def _verdicts(run: Run) -> list[dict[str, object]]:
    """Verdicts that do not pass: each with its reasons, and what cures it."""
    failing = [badge for badge in headline(run).parts if badge.shown != "pass"]
    return [
        {"name": each.name, "word": each.word, "reasons": each.sentences, "cure": cure_of(each.name, run)}
        for each in failing
    ]


def _require_searchable(spec: Spec, job: Mapping[str, Any]) -> None:
    """Raise :class:`InputError` for what no search begins with; the part's base, too, before a long search."""
    require_base_around_cavity(spec.lens, spec.constraints, spec.base_made)
    require_searchable(spec, accuracy=job["accuracy"], force=job["force"])


def _spec_of(job: Mapping[str, Any]) -> Spec:
    return SpecText.of(job["text"], Path(job["path"])).required()


def _files_of_lens_before(run: Run) -> Iterator[str]:
    """Names of the files to take whose stage has not run for this lens, and of a report without its hash."""
    for path in filter(Path.is_file, run.folder.iterdir()):
        stages = ("photometry",) if path.suffix in _PHOTOMETRIC else ("export", "check")
        if path.name == REPORT_FILE:
            is_old = not _names_lens(path, run)
        else:
            is_old = not all(stage in run.found for stage in stages)
        if is_old and path.suffix in DOWNLOADS - {".json"}:
            yield path.name


def _names_lens(page: Path, run: Run) -> bool:
    """True where a report states the hash of the lens; one that cannot be read is of no lens."""
    with suppress(InputError):
        return run.lens.sha256.encode() in read_file(page, missing="", most_bytes=_MOST_REPORT_BYTES)
    return False


class _Watch:
    """An observer of a search: it keeps the mean picture and the figures of all steps, and looks at the lens."""

    def __init__(self, worker: Worker, spec: Spec) -> None:
        self._worker = worker
        self._steps = list[tuple[float, float]]()
        self._light = tuple[np.ndarray, ...]()
        first = spec.in_first_state
        pairs = list(zip(first.all_receivers, receivers_of(first, spec.optimise.pixels), strict=True))
        lumens = summarise(source_of(first), first.source).lumens_per_watt
        self._heads = [chart_head(section, each.grid.width, each.grid.height, lumens) for section, each in pairs]
        self._measures = [each.pixel_measure / (lumens or 1.0) for _, each in pairs]
        self._targets = [target_light(section.targets, each) for section, each in pairs]
        self._last: Progress | None = None
        self._new = threading.Event()
        self._over = threading.Event()
        self._looking = threading.Thread(target=self._look_on, daemon=True)
        self._looking.start()

    def on_step(self, step: Progress) -> object:
        """Note a step, and answer whether the search goes on."""
        self._steps.append((step.nmse, step.efficiency))
        same_level = self._last is not None and step.level == self._last.level
        before = self._light if same_level else step.images
        self._light = tuple(_MEMORY * a + (1.0 - _MEMORY) * b for a, b in zip(before, step.images, strict=True))
        self._last = step
        self._new.set()
        return _ENDINGS.get(self._worker.asked, False)

    def closed(self) -> Lens | None:
        """End the thread, and return the lens of the last step."""
        self._over.set()
        self._new.set()
        self._looking.join()
        return None if self._last is None else self._last.lens()

    def _look_on(self) -> None:
        torch.set_num_threads(1)  # of this thread: those of a pool of its own would spin beside the search
        while not self._over.is_set():
            self._new.wait()
            self._new.clear()
            if self._last is not None:
                begun = time.thread_time()
                try:
                    self._look(self._last, self._light)
                except LensforgeError as error:  # of a lens on its way; the search goes on
                    self._worker.warn(f"no picture: {error}")
                least, most = _BETWEEN_S
                self._over.wait(min(max(least, (time.thread_time() - begun) / _SHARE), most))

    def _look(self, step: Progress, images: tuple[np.ndarray, ...]) -> None:
        arrays = dict[str, np.ndarray]()
        for number, (image, target, measure) in enumerate(zip(images, self._targets, self._measures, strict=True)):
            arrays |= {f"light{number}": image / measure, f"target{number}": target * (image.sum() / measure)}
        arrays["nmse"], arrays["efficiency"] = np.array(self._steps).T
        lens = step.lens()
        lens, traced = (lens, None) if step.tables is None or lens.others else as_tabulated(lens, *step.tables())
        arrays |= drawn(lens, self._worker.figure, traced)
        figures = {"level": step.level, "step": step.steps_done, "steps": step.steps_total, "seconds": step.seconds}
        self._worker.send("step", arrays, receivers=self._heads, figure=self._worker.figure, **figures)


def main() -> None:
    """Do jobs until the studio ends."""
    worker = Worker()
    warnings.showwarning = lambda message, kind, *_place, **_more: (
        worker.warn(str(message)) if issubclass(kind, FileWarning | SourceWarning) else None
    )
    worker.work()
    os._exit(0)  # nothing to be saved; libraries would take a second to end


if __name__ == "__main__":
    main()
