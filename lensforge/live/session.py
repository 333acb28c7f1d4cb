"""Session of a page: the text of a spec, physics of it, and the process that searches.

All of it lives in one event loop. What takes longer than a moment is done by the process, or by a thread for the text
of that moment: of several changes in a row only the last one counts.
"""

import asyncio
import json
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from lensforge.errors import InputError, LensforgeError
from lensforge.live.page_frames import Fields, head_of
from lensforge.live.spec_text import SpecText
from lensforge.live.toml_edit import edited
from lensforge.results.files import write_file
from lensforge.results.folder_lock import locked
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.sources.photometric.photometric_summary import PhotometricSummary, rays
from lensforge.surfaces.imported_face import LENS_FILE

JOB_FILE, DROPPED = "studio_search.json", "dropped"  # a search that may go on; a folder of files that were dropped in
_PROCESS, _PACKAGES = Path(__file__).with_name("search_process.py"), Path(__file__).resolve().parents[2]
_SETTLED_S, _ENDING_S = 0.35, 20.0  # after a change, before a search goes on with it; for the process to end
DOWNLOADS = {".html", ".pdf", ".dxf", ".step", ".stl", ".3mf", ".ies", ".ldt", ".xml", ".csv", ".json", ".tm25ray"}
_PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}


class Session:
    """One design on a page: the ``text`` of its spec, its result ``folder``, and the ``state`` that the page shows.

    ``frames``: pictures as bytes by place. ``listeners`` hear of every change of the state.
    """

    def __init__(self, text: SpecText, folder: Path) -> None:
        self.text, self.folder, self.listeners = text, folder, set[asyncio.Queue[None]]()
        self.frames: dict[str, bytes] = {}
        self.state: Fields = {"phase": "idle", "stage": "", "folder": str(folder), "frames": {}, "version": 0}
        self.state.update(warnings=[], refused=[], accuracy="draft", seed=0, force=False)
        self._thread = ThreadPoolExecutor(1)
        self._process: Process | None = None
        self._following: asyncio.TimerHandle | None = None
        self._next: Fields | None = None

    async def open(self) -> None:
        """Start the process, and show what the folder holds. Raises :class:`InputError` for one that is in use."""
        with locked(self.folder):
            finished = (self.folder / LENS_FILE).exists()  # the page asks before the first search replaces it
            self.tell(phase="paused" if self._resumable else "idle", asks=finished)
        self._serving = asyncio.create_task(self._serve())
        self.change(self.text)

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
        self.state.update(changes, files=self.files())
        for queue in self.listeners:
            if queue.empty():
                queue.put_nowait(None)

    def _show(self, place: str, frame: bytes) -> None:
        self.frames[place] = frame
        self.tell(frames={**self.state["frames"], place: self.state["frames"].get(place, 0) + 1})

    def change(self, text: SpecText) -> Fields:
        """Take another text; a search that runs goes on with it, from the lens that it has, once it has settled."""
        self.text = text
        self.tell(version=self.state["version"] + 1)
        if text.spec is not None:
            loop = asyncio.get_running_loop()
            self._looking = loop.create_task(self._physics(text))
            if self._following is not None:
                self._following.cancel()
            if self.state["phase"] == "searching":
                self._following = loop.call_later(_SETTLED_S, self.search)
        return self.spec_shown()

    def spec_shown(self) -> Fields:
        """The text with its tables, values and lines, and its version."""
        return {"version": self.state["version"], **self.text.shown()}

    def save(self) -> None:
        """Write the text in its place. Raises :class:`InputError` where it cannot be written."""
        write_file(self.text.path, self.text.text.encode())

    async def _physics(self, text: SpecText) -> None:
        """Ask a thread for what physics allows, the quick figures first."""
        for name in ("wanted", "bounds", "lens_kinds", "doubts"):
            found: Any = None
            if text is self.text:
                try:
                    found = await self._in_thread(_physics_of, name, text.spec)
                except LensforgeError as error:
                    found = {"problem": str(error)}
            if isinstance(found, bytes):
                self._show(name, found)
            elif found is not None and text is self.text:
                self.tell(**{name: found})

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
            self._look_at_own()
            assert process.stdout is not None
            with suppress(asyncio.IncompleteReadError):
                while True:
                    length = int.from_bytes(await process.stdout.readexactly(4), "little")
                    self._hear(await process.stdout.readexactly(length))
            await process.wait()
            words = f"the process that works for this page has ended ({process.returncode})"
            lost = [f"{words}; Go on continues from its checkpoint" if self._resumable else words]
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
            case "stage":
                self.tell(stage=head["name"])
            case "warning":
                self.tell(warnings=[*dict.fromkeys([*self.state["warnings"], head["words"]])])
            case "ended" if head["job"] in ("search", "part"):
                following, self._next = self._next, None
                if following is not None:
                    self._begin(following)
                else:
                    paused = head["how"] != "done" and self._resumable
                    self.tell(phase="paused" if paused else "idle", stage="", refused=head["lines"])
            case "ended" if head["lines"]:
                self.tell(refused=head["lines"])

    @property
    def _resumable(self) -> bool:
        return (self.folder / CHECKPOINT).exists() and (self.folder / JOB_FILE).exists()

    def _of_text(self) -> dict[str, str]:
        return {"folder": str(self.folder), "text": self.text.text, "path": str(self.text.path)}

    def _begin(self, job: Mapping[str, Any]) -> None:
        phase, stage = ("making", "export") if job["job"] == "part" else ("searching", "design")
        self.tell(phase=phase, stage=stage, refused=[])
        self._send(**job)

    def _look_at_own(self) -> None:
        if (self.folder / LENS_FILE).exists():
            self._send("look", folder=str(self.folder), place="own")

    def search(self, *, anew: bool = False, **settings: Any) -> None:
        """Search for the lens of the text, from the lens that is there unless ``anew``; one that runs ends first.

        Raises :class:`InputError` where the text is no spec.
        """
        self.text.required()
        self.tell(warnings=[], asks=False, **settings)
        asked = {name: self.state[name] for name in ("accuracy", "seed", "force")}
        job = {"job": "search", **self._of_text(), **asked, "resume": False, "start": not anew}
        if self.state["phase"] in ("searching", "making"):
            self._next = job
            self._send("stop")
        else:
            self._begin(job)

    def go_on(self) -> None:
        """Resume a search that was paused or killed; where the text has changed, go on from its lens."""
        with suppress(OSError, ValueError, KeyError):
            job = json.loads((self.folder / JOB_FILE).read_text(encoding="utf-8"))
            if job["text"] == self.text.text and self._resumable:
                return self._begin({**job, **self._of_text(), "resume": True})
        return self.search()

    def ask(self, what: str) -> None:
        """Ask for ``pause``, ``stop``, ``enough``, or the ``part`` of the lens."""
        if what == "part":
            self._begin({"job": "part", "folder": str(self.folder)})
        else:
            self._send(what)

    def colour_by(self, figure: str) -> None:
        """Show the lens by another figure, at once or with its next picture."""
        self._send("figure", name=figure)
        if self.state["phase"] not in ("searching", "making"):
            self._look_at_own()

    def beside(self, name: str) -> None:
        """Show the design of another folder beside this one, "" for none. Raises :class:`InputError` for no such."""
        if not name:
            self.frames.pop("beside", None)
            self.tell(frames={place: number for place, number in self.state["frames"].items() if place != "beside"})
            return
        if name not in self.others():
            raise InputError(f"{name}: no result folder beside {self.folder}")
        self._send("look", folder=str(self.folder.resolve().parent / name), place="beside")

    def others(self) -> list[str]:
        """Names of the result folders beside this one."""
        own = self.folder.resolve()
        return sorted(path.parent.name for path in own.parent.glob(f"*/{LENS_FILE}") if path.parent != own)

    def files(self) -> list[str]:
        """Names of the files in the folder that a reader may open or take."""
        paths = self.folder.iterdir() if self.folder.is_dir() else ()
        fit = (path for path in paths if path.suffix.lower() in DOWNLOADS and path.is_file() and not path.is_symlink())
        return sorted(path.name for path in fit)

    def place_of(self, name: str) -> Path:
        """The place in the folder for a file that is dropped in. Raises :class:`InputError` for a name of no use."""
        known = "".join(each if each.isalnum() or each in "-_." else "_" for each in Path(name).name)[-80:].lstrip(".")
        if not Path(known).suffix:
            raise InputError(f"{name[:60]!r}: a file of rays, an IES or LDT file, or a picture, each with its suffix")
        return self.folder.resolve() / DROPPED / known

    async def dropped(self, path: Path) -> Fields:
        """Describe a file that was dropped in, and draw it beside it by its own plot."""
        if path.suffix.lower() in _PICTURES:
            return {"name": path.name, "plot": path.name, "words": path.name, "fits": ["target"]}
        return dict(await self._in_thread(_plotted, path))

    def use(self, name: str, place: str) -> SpecText:
        """The text with a file that was dropped in as its ``source`` or its ``target``."""
        path, before, text = self.place_of(name), dict(self.text.tables.get("target", {})), self.text.text
        table: dict[str, object] = {"kind": "rayfile", "file": str(path), "origin": "virtual_focus"}
        if place == "target" and path.suffix.lower() in _PICTURES:
            size = {name: before.get(name, usual) for name, usual in (("width_mm", 200.0), ("distance_mm", 300.0))}
            table = {"kind": "image", "file": str(path), **size}
        elif place == "target":
            table = {"kind": "photometric", "file": str(path)}
        for gone in {place, "receivers" if place == "target" else "sources"} & set(self.text.tables):
            text = edited(text, (gone,), None)
        return self.text.with_text(edited(text, (place,), table))


def _physics_of(name: str, spec: Any) -> object:
    from lensforge.live import physics

    return getattr(physics, name)(spec)


def _plotted(path: Path) -> dict[str, object]:
    summary, plot = rays(path), path.with_name(f"{path.name}.png")
    summary.save(plot)
    if isinstance(summary, PhotometricSummary):
        words, fits = f"{summary.lumens:.4g} lm, peak {summary.peak.intensity_cd:.4g} cd", ["target"]
    else:
        words, fits = f"{summary.rays:,} rays", ["source"]
    return {"name": path.name, "plot": plot.name, "words": f"{path.name}: {summary.format}, {words}", "fits": fits}
