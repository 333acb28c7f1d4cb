"""The verb ``studio``: the page opened, its server in a thread of its own."""

import json
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lensforge.errors import InputError
from lensforge.results.validation import its_type
from lensforge.scene.lens import load_lens
from lensforge.spec import Spec
from lensforge.spec.spec_files import toml_text
from lensforge.surfaces.imported_face import LENS_FILE

if TYPE_CHECKING:
    from lensforge.live.server import Server

_TEXT_FILE, _EXAMPLE = "studio.toml", "quickstart"  # the text of a folder that is opened; of a new one


class Studio:
    """A page on one design, open until :meth:`close` or the end of the program.

    ``address``: of the page, with its secret. ``folder``: in which it writes, its result folder. ``shown``: True where
    a browser was there to open it.
    """

    def __init__(self, server: "Server") -> None:
        import asyncio  # with all that is beneath it a twentieth of a second

        self.folder, self.address, self._error = server.session.folder, "", list[BaseException]()
        self.shown = False
        self._loop, self._ready, self._end = asyncio.new_event_loop(), threading.Event(), asyncio.Event()
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

    def wait(self) -> None:
        """Wait until it is closed."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """End the page; a search that runs leaves its checkpoint in the folder."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join()

    def __repr__(self) -> str:
        return f"Studio({str(self.folder)!r}, {self.address})"


def studio(spec: Spec | Path | str | None = None, *, port: int = 0, browser: bool = True) -> Studio:
    """Open a page in the browser on which a spec is written and its light is seen while a lens is searched.

    Args:
        spec: a spec, a TOML file, or a result folder; None: an example, in cad_out/studio.
        port: of the page on this machine, 0 to 65535; 0: any that is free.
        browser: open the page in the desktop's browser.
    Returns: The studio: the ``address`` of its page, its ``folder``, and ``close``.
    Raises: :class:`InputError` for a file that is not there, a folder or a port that is in use.
    Example:
        >>> page = lf.studio("examples/quickstart.toml", browser=False)
        >>> page.close()
    """
    if not isinstance(port, int) or not 0 <= port <= 65535:
        raise InputError(f"port = {port!r}: a whole number from 0 to 65535")
    text, path, folder = _opened(spec)
    from lensforge.live.server import Server
    from lensforge.live.session import Session
    from lensforge.live.spec_text import SpecText

    begun = SpecText.of(text, path)
    begun = begun if text else begun.from_example(_EXAMPLE)
    if folder is None:
        folder = Path("cad_out") / (path.stem if begun.spec is None else begun.spec.name)
    opened = Studio(Server(Session(begun, folder), port))
    opened.shown = browser and webbrowser.open(opened.address)
    return opened


def _opened(spec: Any) -> tuple[str, Path, Path | None]:
    """Text of a spec, the place where it is saved, and the folder of its results, None for that by its name."""
    if isinstance(spec, Spec):
        return spec.to_toml(), Path("cad_out") / spec.name / _TEXT_FILE, None
    if spec is not None and not isinstance(spec, Path | str):
        raise InputError(f"studio: {its_type(spec)} given; give a spec, a TOML file or a result folder")
    path = Path("cad_out/studio") if spec is None else Path(spec)
    if path.suffix == ".toml" and not path.is_dir():
        return toml_text(path, "`lensforge new` writes one, `lensforge examples` lists the shipped ones"), path, None
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: neither a .toml file nor a folder; give a spec or a result folder")
    own = path / _TEXT_FILE
    if own.is_file():
        return toml_text(own, ""), own, path
    from lensforge.live.session import JOB_FILE
    from lensforge.live.spec_text import SpecText

    with suppress(OSError, ValueError, KeyError):  # the text of the last search, where it names no file beside another
        text = json.loads((path / JOB_FILE).read_text(encoding="utf-8"))["text"]
        if SpecText.of(text, own).spec is not None:
            return text, own, path
    if (path / LENS_FILE).is_file():
        return load_lens(path / LENS_FILE).spec.to_toml(), own, path
    return "", own, path
