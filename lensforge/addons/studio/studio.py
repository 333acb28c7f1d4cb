"""The verb ``studio``: the page opened, its server in a thread of its own."""

import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lensforge.addon import require_libraries
from lensforge.addons.studio.door import Door
from lensforge.addons.studio.search_job import SearchJob
from lensforge.errors import InputError
from lensforge.public import public
from lensforge.results.arguments import with_known_names
from lensforge.results.validation import its_type
from lensforge.scene.lens import load_lens
from lensforge.spec import Spec
from lensforge.spec.spec_files import toml_text
from lensforge.surfaces.imported_face import LENS_FILE

if TYPE_CHECKING:
    from lensforge.addons.studio.server import Server

_TEXT_FILE = "studio.toml"  # of a folder that is opened
_EXAMPLE = "quickstart"  # of a new one


@dataclass(frozen=True)
class _Opened:
    """The ``text`` of a spec, the place ``path`` where it is saved, and the ``folder`` of its results.

    None for the folder by its name. ``is_file``: the text is that of its file.
    """

    text: str
    path: Path
    folder: Path | None = None
    is_file: bool = False


@public
class Studio:
    """A page on one design, open until :meth:`close` or the end of the program.

    ``address``: of the page, with its secret. ``shown``: True where a browser was there to open it.
    """

    def __init__(self, server: "Server") -> None:
        import asyncio  # with all that is beneath it a twentieth of a second

        self._session = server.session
        self.address = ""
        self._error = list[BaseException]()
        self.shown = False
        self._door: Door | None = None
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, args=(server,), daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._error:
            raise self._error[0]

    def _run(self, server: "Server") -> None:
        try:
            self._loop.run_until_complete(self._serve(server))
        except BaseException as error:
            self._error.append(error)
        self._ready.set()

    async def _serve(self, server: "Server") -> None:
        await server.start()
        try:
            await server.session.open()
            self.address = server.address
            self._ready.set()
            await self._end.wait()
            await server.session.close()
        finally:
            await server.stop()

    @property
    def folder(self) -> Path:
        """The folder of its results, by the name of its spec unless a folder was opened."""
        return self._session.folder

    def show(self) -> None:
        """Open the page in the desktop's browser, where there is one."""
        self._door = Door(self.address)
        self.shown = self._door.open()

    def wait(self) -> None:
        """Wait until it is closed."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """End the page; a search that runs leaves its checkpoint in the folder."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join()
        if self._door is not None:
            self._door.close()

    def __repr__(self) -> str:
        return f"Studio({str(self.folder)!r}, {self.address})"


@public
@with_known_names
def studio(spec: Spec | Path | str | None = None, *, port: int = 0, browser: bool = True) -> Studio:
    """Open a page in the browser on which a spec is written and its light is seen while a lens is searched.

    Args:
        spec: a spec, a TOML file, or a result folder; None: an example.
        port: of the page on this machine, 0 to 65535; 0: any that is free.
        browser: open the page in the desktop's browser.
    Returns: The studio: the ``address`` of its page, its ``folder``, and ``close``.
    Raises: :class:`InputError` for a file that is not there, a folder or a port that is in use, a library that is not
        installed.
    Example:
        >>> page = lf.studio("examples/quickstart.toml", browser=False)
        >>> page.close()
    """
    if not isinstance(port, int) or not 0 <= port <= 65535:
        raise InputError(f"port = {port!r}: a whole number from 0 to 65535")
    require_libraries("studio", "aiohttp", "tomlkit")
    opened = _opened(spec)
    from lensforge.addons.studio.server import Server
    from lensforge.addons.studio.session import Session
    from lensforge.addons.studio.spec_text import SpecText

    text = SpecText.of(opened.text, opened.path)
    text = text if opened.text else text.from_example(_EXAMPLE)
    started = Studio(Server(Session(text, opened.folder, is_file=opened.is_file), port))
    if browser:
        started.show()
    return started


def _opened(spec: Any) -> _Opened:
    if spec is None:
        return _Opened("", Path(f"{_EXAMPLE}.toml"))
    if isinstance(spec, Spec):
        return _Opened(spec.to_toml(), Path(f"{spec.name}.toml"))
    if not isinstance(spec, Path | str):
        raise InputError(f"studio: {its_type(spec)} given; give a spec, a TOML file or a result folder")
    path = Path(spec)
    if path.suffix == ".toml" and not path.is_dir():
        text = toml_text(path, "`lensforge new` writes one, `lensforge examples` lists the shipped ones")
        return _Opened(text, path, is_file=True)
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: neither a .toml file nor a folder; give a spec or a result folder")
    return _of_folder(path)


def _of_folder(folder: Path) -> _Opened:
    """The text that was saved in a result folder, that of its last search, that of its lens, or none."""
    from lensforge.addons.studio.spec_text import SpecText

    path = folder / _TEXT_FILE
    if path.is_file():
        return _Opened(toml_text(path, ""), path, folder, is_file=True)
    with suppress(InputError):  # the page tells of a damaged one
        job = SearchJob.read(folder)
        if job is not None and SpecText.of(job.text, path).spec is not None:  # it names no file beside another
            return _Opened(job.text, path, folder)
    if (folder / LENS_FILE).is_file():
        return _Opened(load_lens(folder / LENS_FILE).spec.to_toml(), path, folder)
    return _Opened("", path, folder)
