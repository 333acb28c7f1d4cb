"""Session of a page: the text of a spec, physics of it, and the process that searches.

All of it lives in one event loop. What takes longer than a moment is done by the process, or by a thread for the text
of that moment: of several changes in a row only the last one counts.
"""

import asyncio
import codecs
import json
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from lensforge import seeds
from lensforge.addons.studio.dropped_files import DROPPED, DroppedFile, Use
from lensforge.addons.studio.folder_files import files_to_take
from lensforge.addons.studio.page_frames import Fields, head_of
from lensforge.addons.studio.search_job import SearchJob
from lensforge.addons.studio.spec_text import SpecText
from lensforge.errors import InputError, LensforgeError
from lensforge.results.arguments import count_of
from lensforge.results.files import write_file
from lensforge.results.folder_lock import locked
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.imported_face import LENS_FILE

_PROCESS = Path(__file__).with_name("search_process.py")
_PACKAGES = Path(__file__).resolve().parents[3]
_SETTLED_S = 0.35  # after a change, before a search goes on with it
_ENDING_S = 20.0  # for the process to end
_READING_S = 10.0  # for the text of a spec; the bounds of its reader let it take a second
FIGURES = ("sag", "slope", "curvature", "wall", "ball")
RESULTS = Path("cad_out")


class Session:
    """One design on a page: the ``text`` of its spec, its result ``folder``, and the ``state`` that the page shows.

    Without a ``folder`` results go to that of the spec's name, and follow it. ``is_file``: the text is that of its
    file, which Save may write over. ``frames``: pictures as bytes by place.
    ``listeners`` hear of every change of the state.
    """

    def __init__(self, text: SpecText, folder: Path | None = None, *, is_file: bool = False) -> None:
        self._follows_name = folder is None
        self.text = text
        self.folder = folder or RESULTS / _name_of(text)
        self.listeners = set[asyncio.Queue[None]]()
        self.frames = dict[str, bytes]()
        self.state: Fields = {"phase": "idle", "stage": "", "folder": str(self.folder), "frames": {}, "version": 0}
        self.state.update(warnings=[], refused=[], accuracy="draft", seed=0, force=False, asks=False)
        self.state.update(judged={"version": -1, "lines": []}, saved=str(text.path))
        self.dropped = dict[str, DroppedFile]()
        self._is_file = is_file
        self._thread = ThreadPoolExecutor(1)
        self._reader = ThreadPoolExecutor(1)
        self._changing = asyncio.Lock()
        self._process: Process | None = None
        self._following: asyncio.TimerHandle | None = None
        self._next: Fields | None = None

    async def open(self) -> None:
        """Start the process, and show what the folder holds. Raises :class:`InputError` for one that is in use."""
        with locked(self.folder):
            self._show_folder()
        self._serving = asyncio.create_task(self._serve())
        self._take(self.text)

    def _show_folder(self) -> None:
        """Tell what the folder holds: a search that may go on with its settings, and a lens that is to be kept."""
        settings = dict[str, object]()
        damage = list[str]()
        try:
            job = SearchJob.read(self.folder)
            settings = {} if job is None else job.model_dump(include={"accuracy", "seed", "force"})
        except InputError as error:
            damage = str(error).splitlines()
        finished = (self.folder / LENS_FILE).exists()  # the page asks before the first search replaces it
        phase = "paused" if self._resumable else "idle"
        self.tell(phase=phase, folder=str(self.folder), asks=finished, refused=damage, **settings)

    def _enter(self, folder: Path) -> None:
        """Go on in another folder: that of the spec's new name."""
        self.folder = folder
        self._take_away("own")
        self._show_folder()
        self._look_at_own()

    async def close(self) -> None:
        """End the process: a search leaves its checkpoint."""
        self._serving.cancel()
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._process.wait(), _ENDING_S)
            if self._process.returncode is None:
                self._process.kill()

    def tell(self, **changes: object) -> None:
        """Change the state, and let all pages hear of it."""
        self.state.update(changes, files=files_to_take(self.folder))
        for queue in self.listeners:
            if queue.empty():
                queue.put_nowait(None)

    def _show(self, place: str, frame: bytes) -> None:
        self.frames[place] = frame
        self.tell(frames={**self.state["frames"], place: self.state["frames"].get(place, 0) + 1})

    def _take_away(self, place: str) -> None:
        self.frames.pop(place, None)
        self.tell(frames={name: number for name, number in self.state["frames"].items() if name != place})

    async def change(self, changed: Callable[[SpecText], SpecText]) -> Fields:
        """Take the text that ``changed`` makes of this one, in a thread: one change after another.

        Raises :class:`InputError` where there is no such change, or where its text takes too long to read.
        """
        async with self._changing:
            loop = asyncio.get_running_loop()
            try:
                text = await asyncio.wait_for(loop.run_in_executor(self._reader, changed, self.text), _READING_S)
            except TimeoutError:
                self._reader = ThreadPoolExecutor(1)  # the thread before ends by itself
                raise InputError(f"the text takes more than {_READING_S:g} s to read; shorten it") from None
            self._take(text)
            return self.spec_shown()

    def _take(self, text: SpecText) -> None:
        """Take another text, and see to what follows from it once it has settled."""
        self.text = text
        if self._following is not None:
            self._following.cancel()
        self._follow_name()
        self.tell(version=self.state["version"] + 1)
        if text.spec is not None:
            loop = asyncio.get_running_loop()
            self._looking = loop.create_task(self._physics(self.text))
            self._following = loop.call_later(_SETTLED_S, self._settled)

    def _follow_name(self) -> None:
        """Go to the folder of the spec's name where results go there, but for one in which something runs."""
        spec = self.text.spec
        if spec is None or not self._follows_name or self._runs:
            return
        if not self._is_file:
            self.text = self.text.moved(self.text.path.with_name(f"{spec.name}.toml"))
            self.tell(saved=str(self.text.path))
        if self.folder != RESULTS / spec.name:
            self._enter(RESULTS / spec.name)

    def _settled(self) -> None:
        """Let a search that runs go on with the text, from the lens that it has; else ask if one would begin."""
        if self.state["phase"] == "searching":
            self.search()
        else:
            self._judge()

    @property
    def _runs(self) -> bool:
        return self.state["phase"] in ("searching", "making")

    def _judge(self) -> None:
        """Ask the process why no search of the text would begin."""
        if self.text.spec is not None and not self._runs:
            settings = {name: self.state[name] for name in ("version", "accuracy", "force")}
            self._send("judge", **self._of_text(), **settings)

    def spec_shown(self) -> Fields:
        """The text with its tables, values and lines, and its version."""
        return {"version": self.state["version"], **self.text.shown()}

    def save(self) -> None:
        """Write the text in its place; a byte-order mark stays.

        Raises :class:`InputError` where it cannot be written, and for another file of this name.
        """
        path = self.text.path
        if path.exists() and not self._is_file:
            raise InputError(f"{path}: is there already; give the spec another name, or open that file")
        write_file(path, (codecs.BOM_UTF8 if _has_mark(path) else b"") + self.text.text.encode())
        self._is_file = True

    async def _physics(self, text: SpecText) -> None:
        """Ask a thread for what physics allows, the quick figures first."""
        for name in ("wanted", "bounds", "lens_kinds", "doubts"):
            if text is not self.text:
                return
            answer: Any
            try:
                answer = await self._in_thread(_physics_of, name, text.spec)
            except LensforgeError as error:
                answer = {"problem": str(error)}
            except Exception as error:  # a bug: the page says so, and goes on
                answer = {"problem": f"internal error: {type(error).__name__}: {error}"}
            if text is not self.text:
                return
            if isinstance(answer, bytes):
                self._show(name, answer)
            else:
                self.tell(**{name: answer})

    async def _in_thread(self, function: Callable[..., Any], *given: object) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._thread, function, *given)

    async def _serve(self) -> None:
        """Keep a process, and hear it; one that has ended is followed by another."""
        while True:
            command = (sys.executable, "-P", str(_PROCESS), str(_PACKAGES))
            pipes: Fields = {"stdin": PIPE, "stdout": PIPE, "stderr": DEVNULL, "start_new_session": True}
            process = self._process = await asyncio.create_subprocess_exec(*command, **pipes, limit=2**22)
            if self.text.spec is not None:
                self._send("warm", **self._of_text())
                self._judge()
            self._look_at_own()
            assert process.stdout is not None
            with suppress(asyncio.IncompleteReadError):
                while True:
                    length = int.from_bytes(await process.stdout.readexactly(4), "little")
                    self._hear(await process.stdout.readexactly(length))
            await process.wait()
            ended = f"the process that works for this page has ended ({process.returncode})"
            lost = [f"{ended}; Go on continues from its checkpoint" if self._resumable else ended]
            running = self.state["phase"] in ("searching", "making")
            self.tell(phase="paused" if self._resumable else "idle", refused=lost if running else [])

    def _send(self, job: str, **more: object) -> None:
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.write((json.dumps({"job": job, **more}) + "\n").encode())

    def _hear(self, frame: bytes) -> None:
        head = head_of(frame)
        match head["kind"]:
            case "step" | "own":
                self._show("own", frame)
            case "beside":
                self._show("beside", frame)
            case "judged":
                self.tell(judged={"version": head["version"], "lines": head["lines"]})
            case "stage":
                self.tell(stage=head["name"])
            case "warning":
                self.tell(warnings=[*dict.fromkeys([*self.state["warnings"], head["words"]])])
            case "ended" if head["job"] in ("search", "part"):
                following = self._next
                self._next = None
                if following is not None:
                    self._begin(following)
                else:
                    paused = head["how"] != "done" and self._resumable
                    self.tell(phase="paused" if paused else "idle", stage="", refused=head["lines"])
            case "ended" if head["lines"]:
                self.tell(refused=head["lines"])

    @property
    def _kept_job(self) -> SearchJob | None:
        """The search that may go on: its record beside its checkpoint."""
        if (self.folder / CHECKPOINT).exists():
            with suppress(InputError):  # told when the folder is entered
                return SearchJob.read(self.folder)
        return None

    @property
    def _resumable(self) -> bool:
        return self._kept_job is not None

    def _of_text(self) -> dict[str, str]:
        return {"folder": str(self.folder), "text": self.text.text, "path": str(self.text.path)}

    def _begin(self, job: Mapping[str, Any]) -> None:
        phase, stage = ("making", "export") if job["job"] == "part" else ("searching", "design")
        self.tell(phase=phase, stage=stage, refused=[])
        self._send(**job)

    def _look_at_own(self) -> None:
        if (self.folder / LENS_FILE).exists():
            self._send("look", folder=str(self.folder), place="own")

    def search(self, *, anew: bool = False, accuracy: Any = None, seed: Any = None, force: bool | None = None) -> None:
        """Search for the lens of the text, from the lens that is there unless ``anew``; one that runs ends first.

        A setting of None stays as it is. Raises :class:`InputError` where the text is no spec, or a setting is wrong.
        """
        self.text.required()
        given = {"accuracy": _accuracy(accuracy), "seed": count_of("seed", seed, 0, seeds.MOST), "force": force}
        if self.state["phase"] == "making":
            raise InputError("search: the part is being made; stop that first")
        before = self.folder
        self._follow_name()
        if self.folder != before and self.state["asks"]:
            raise InputError(f"search: {self.folder} holds a finished lens; search again to replace it")
        self.tell(warnings=[], asks=False, **{name: value for name, value in given.items() if value is not None})
        settings = {name: self.state[name] for name in ("accuracy", "seed", "force")}
        job = {"job": "search", **self._of_text(), **settings, "resume": False, "start": not anew}
        if self.state["phase"] == "searching":
            self._next = job
            self._send("stop")
        else:
            self._begin(job)

    def go_on(self) -> None:
        """Resume a search that was paused or killed; where the text has changed, go on from its lens."""
        self._require_at_rest("go on")
        job = self._kept_job
        if job is not None and job.text == self.text.text:
            self._begin({"job": "search", **job.model_dump(), **self._of_text(), "resume": True})
        else:
            self.search()

    def make_part(self, rings: int | None = None) -> None:
        """Make the part of the lens that is there; with ``rings`` only export it again, with so fine a mesh.

        Raises :class:`InputError` where there is no lens yet, or something else runs.
        """
        self._require_at_rest("make the part")
        if not (self.folder / LENS_FILE).is_file():
            raise InputError(f"make the part: no lens in {self.folder}; search first")
        self._begin({"job": "part", "folder": str(self.folder), "rings": rings})

    def ask(self, what: str) -> None:
        """Ask what runs for ``pause``, ``stop`` or ``enough``. Raises :class:`InputError` where nothing runs."""
        if not self._runs:
            raise InputError(f"{what}: nothing runs")
        self._send(what)

    def _require_at_rest(self, what: str) -> None:
        if self._runs:
            raise InputError(f"{what}: another job runs; stop it first")

    def colour_by(self, figure: str) -> None:
        """Show the lens by another figure, at once or with its next picture. Raises :class:`InputError`."""
        if figure not in FIGURES:
            raise InputError(f"figure {figure[:60]!r}: must be one of {', '.join(FIGURES)}")
        self._send("figure", name=figure)
        if not self._runs:
            self._look_at_own()

    def beside(self, name: str) -> None:
        """Show the design of another folder beside this one, "" for none. Raises :class:`InputError` for no such."""
        if not name:
            self._take_away("beside")
        elif name in self.others():
            self._send("look", folder=str(self.folder.resolve().parent / name), place="beside")
        else:
            raise InputError(f"{name[:60]}: no result folder beside {self.folder}")

    def others(self) -> list[str]:
        """Names of the result folders beside this one."""
        folder = self.folder.resolve()
        return sorted(path.parent.name for path in folder.parent.glob(f"*/{LENS_FILE}") if path.parent != folder)

    @property
    def dropped_folder(self) -> Path:
        """The folder for files that are dropped in."""
        return self.folder.resolve() / DROPPED

    async def keep_dropped(self, path: Path) -> Fields:
        """Read a file that has come to ``path``, keep it, and describe it. Raises :class:`InputError` for no such."""
        file = (await self._in_thread(DroppedFile.read, path)).kept(path.parent.parent)
        self.dropped[file.path.name] = file
        return {"name": file.path.name, "plot": file.plot.name, "words": file.phrase, "fits": file.fits}

    def dropped_plot(self, name: str) -> Path | None:
        """The plot ``name`` of a file that was dropped in, None if there is none."""
        return next((file.plot for file in self.dropped.values() if file.plot.name == name), None)

    def use(self, name: str, place: Use) -> Callable[[SpecText], SpecText]:
        """The change of a text by which a file that was dropped in is its ``source`` or its ``target``."""
        if name not in self.dropped:
            raise InputError(f"{name[:60]}: no such file has been dropped in")
        file = self.dropped[name]
        return lambda text: text.with_table(place, file.table(place, text.tables.get(place, {})))


def _name_of(text: SpecText) -> str:
    return text.path.stem if text.spec is None else text.spec.name


def _has_mark(path: Path) -> bool:
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(codecs.BOM_UTF8)) == codecs.BOM_UTF8
    return False


def _accuracy(given: object) -> str | None:
    if given is not None and given not in tuple(PRESETS):
        raise InputError(f"accuracy = {str(given)[:60]!r}: must be one of {', '.join(PRESETS)}")
    return None if given is None else str(given)


def _physics_of(name: str, spec: Any) -> object:
    from lensforge.addons.studio import physics

    return getattr(physics, name)(spec)
