"""The server of the studio: one page, for this machine alone.

It listens on 127.0.0.1. Before anything else a request is held against the name of the host, the site that it comes
from, and a secret in its address that is new for every start: a page of another site, and a name that is bound to
this machine, get nothing. The page loads nothing from elsewhere, and the browser is told to refuse it. What comes is
bounded in number, size and time.
"""

import asyncio
import errno
import secrets
import socket
from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from aiohttp import web

from lensforge.addons.studio.connections import STRANGER_S, Connections
from lensforge.addons.studio.dropped_files import plain_name, receiving
from lensforge.addons.studio.folder_files import files_to_take, regular_files
from lensforge.addons.studio.page_json import (
    BadRequest,
    Change,
    DroppedUse,
    Example,
    FieldValue,
    Finer,
    Name,
    SearchSettings,
    WholeText,
    change_of,
    json_text,
    request_of,
)
from lensforge.addons.studio.session import Session
from lensforge.addons.studio.spec_text import SpecText
from lensforge.errors import InputError, LensforgeError
from lensforge.spec.light_limits import LineLimit, PointsLimit
from lensforge.spec.shipped_specs import first_sentence, shipped_specs
from lensforge.spec.spec_reference import spec_schema
from lensforge.spec.target_sections import TargetSection

_PAGE = Path(__file__).with_name("page")
_MOST_BYTES = 2**30  # of a file that is dropped in
_MOST_TEXT_BYTES = 2**24  # of any other request
_BODY_S = 20.0  # for the body of a request, and for each part of a file
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
# A report has scripts and styles of its own: it gets an origin of its own, which nothing here answers.
_OF_REPORTS = {"Content-Security-Policy": "sandbox allow-scripts; default-src 'none' data: 'unsafe-inline'"}
_Answer = Callable[[web.Request], Awaitable[web.StreamResponse]]


def _guard(secret: str, admit: Callable[[asyncio.BaseProtocol], None]) -> Any:
    @web.middleware
    async def guarded(request: web.Request, handler: _Answer) -> web.StreamResponse:
        asked = request.headers
        port = None if request.transport is None else request.transport.get_extra_info("sockname")[1]
        opened = request.method == "GET" and asked.get("Sec-Fetch-Mode") == "navigate"
        ours = (
            asked.getall("Host", []) in ([f"127.0.0.1:{port}"], [f"localhost:{port}"])
            and asked.get("Origin") in (None, f"http://{request.host}")
            and (opened or asked.get("Sec-Fetch-Site") in (None, "none", "same-origin"))
            and secrets.compare_digest(request.match_info.get("secret", "").encode(), secret.encode())
        )
        if not ours:
            raise web.HTTPForbidden(text="refused: not from this page")
        admit(request.protocol)
        try:
            return await handler(request)
        except BadRequest as error:
            return _refusal(400, str(error))
        except LensforgeError as error:
            return _refusal(422, *str(error).splitlines())
        except (web.HTTPException, ConnectionError):
            raise
        except Exception as error:  # a bug: the page says so, and goes on
            return _refusal(500, f"internal error: {type(error).__name__}: {error}")

    return guarded


def _refusal(status: int, *lines: str) -> web.Response:
    return web.Response(text=json_text({"lines": lines}), status=status, content_type="application/json")


async def _with_headers(_request: web.Request, response: web.StreamResponse) -> None:
    for name, value in _HEADERS.items():
        response.headers.setdefault(name, value)


@cache
def _schema_text() -> str:
    examples = {name: first_sentence(path) for name, path in shipped_specs().items()}
    limits = {section.model_fields["kind"].default: section for section in (PointsLimit, LineLimit)}
    needs = {kind: section.needs for kind, section in (TargetSection.kinds | limits).items()}
    return json_text({"schema": spec_schema(), "examples": examples, "needs": needs})


def _json(value: object) -> web.Response:
    return web.Response(text=json_text(value), content_type="application/json")


def _file(folder: Path, name: str, known: list[str], headers: dict[str, str] | None = None) -> web.StreamResponse:
    """A file by its name in a folder, of those that are ``known`` there."""
    if name not in known:
        raise web.HTTPNotFound
    return web.FileResponse(folder / name, headers=headers)


class Server:
    """The server of a session on ``port``, 0 for any that is free; ``address`` once it has started."""

    def __init__(self, session: Session, port: int) -> None:
        self.session = session
        self.port = port
        self.address = ""
        self._secret = secrets.token_urlsafe(24)
        self._ending = False

    async def start(self) -> None:
        """Listen. Raises :class:`InputError` for a port that another program has."""
        listener = _listening(self.port)
        guard = _guard(self._secret, lambda protocol: self._connections.admit(protocol))
        application = web.Application(middlewares=[guard], client_max_size=_MOST_TEXT_BYTES)
        application.on_response_prepare.append(_with_headers)
        paths = ("", "events", "{place:page|frame|file|dropped}/{name}", "{what:schema|spec|others}")
        for path, answer in zip(paths, (self._page, self._events, self._named, self._content), strict=True):
            application.router.add_get(f"/{{secret}}/{path}", answer)
        for path, answer in {"spec": self._change, "do/{what}": self._do, "dropped/{name}": self._drop}.items():
            application.router.add_post(f"/{{secret}}/{path}", answer)
        self._runner = web.AppRunner(application, access_log=None, shutdown_timeout=1.0, keepalive_timeout=STRANGER_S)
        await self._runner.setup()
        assert self._runner.server is not None, "it has been set up"
        self._connections = Connections(listener, self._runner.server)
        self.address = f"http://127.0.0.1:{listener.getsockname()[1]}/{self._secret}/"

    async def stop(self) -> None:
        """Listen no more; pages are told."""
        self._ending = True
        self.session.tell()
        await asyncio.sleep(0.05)  # for their last event
        await self._connections.close()
        await self._runner.cleanup()

    async def _page(self, _request: web.Request) -> web.StreamResponse:
        return web.FileResponse(_PAGE / "index.html")

    async def _events(self, request: web.Request) -> web.StreamResponse:
        """The state of the session, now and after every change, as server-sent events."""
        response = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
        queue = asyncio.Queue[None]()
        await response.prepare(request)
        self.session.listeners.add(queue)
        try:
            while not self._ending:
                await response.write(f"data: {json_text(self.session.state)}\n\n".encode())
                await queue.get()
            await response.write(b"event: end\ndata: {}\n\n")
        except ConnectionResetError:
            pass  # the page is closed
        finally:
            self.session.listeners.discard(queue)
        return response

    async def _named(self, request: web.Request) -> web.StreamResponse:
        """A part of the page, a picture of the session, or a file of the folder."""
        place = request.match_info["place"]
        name = request.match_info["name"]
        session = self.session
        if place == "frame":
            frame = session.frames.get(name, b"")
            return web.Response(body=frame, content_type="application/octet-stream", status=200 if frame else 404)
        if place == "file":
            return _file(session.folder, name, files_to_take(session.folder), _OF_REPORTS)
        if place == "dropped":
            plot = session.dropped_plot(name)
            return _file(plot.parent, name, regular_files(plot.parent)) if plot else web.Response(status=404)
        return _file(_PAGE, name, regular_files(_PAGE))

    async def _content(self, request: web.Request) -> web.StreamResponse:
        match request.match_info["what"]:
            case "schema":
                return web.Response(text=_schema_text(), content_type="application/json")
            case "spec":
                return _json(self.session.spec_shown())
        return _json(self.session.others())

    async def _change(self, request: web.Request) -> web.StreamResponse:
        """A change of the text: a whole ``text``, a ``value`` at a ``place``, an ``example``, or a file to ``use``."""
        change = self._changed(change_of(await _body(request)))
        return _json(await self.session.change(change))

    def _changed(self, asked: Change) -> Callable[[SpecText], SpecText]:
        match asked:
            case FieldValue(place=place, value=value):
                return lambda text: text.edited(tuple(place), value)
            case Example(example=name):
                return lambda text: text.from_example(name)
            case DroppedUse(use=name, place=use):
                return self.session.use(name, use)
            case WholeText(text=whole):
                return lambda text: text.with_text(whole)

    async def _do(self, request: web.Request) -> web.StreamResponse:
        session = self.session
        content = await _body(request) or b"{}"
        match request.match_info["what"]:
            case "search":
                session.search(**request_of(content, SearchSettings).model_dump())
            case "pause" | "stop" | "enough" as what:
                session.ask(what)
            case "part":
                session.make_part()
            case "finer":
                session.make_part(request_of(content, Finer).rings)
            case "go_on":
                session.go_on()
            case "figure":
                session.colour_by(request_of(content, Name).name)
            case "beside":
                session.beside(request_of(content, Name).name)
            case "save":
                session.save()
            case _:
                raise web.HTTPNotFound
        return _json({})

    async def _drop(self, request: web.Request) -> web.StreamResponse:
        """A file that is dropped in goes to a folder of its own within the result folder, once it has been read."""
        name = plain_name(request.match_info["name"])
        with receiving(self.session.dropped_folder, name) as path:
            with path.open("wb") as file:
                await _receive(request, file)
            return _json(await self.session.keep_dropped(path))


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server(("127.0.0.1", port))
    except OSError as error:
        if error.errno not in (errno.EADDRINUSE, errno.EACCES):
            raise
        reason = "in use by another program" if error.errno == errno.EADDRINUSE else "not for a user's program"
        raise InputError(f"port {port}: {reason}; give another, or none for any that is free") from None


async def _body(request: web.Request) -> bytes:
    """The content of a request."""
    return await _in_time(request.read())


async def _in_time(content: Awaitable[bytes]) -> bytes:
    """Content that comes in time; where it does not, that is the answer."""
    try:
        return await asyncio.wait_for(content, _BODY_S)
    except TimeoutError:
        line = f"request: its rest has not come within {_BODY_S:g} s"
        text = json_text({"lines": [line]})
        raise web.HTTPRequestTimeout(text=text, content_type="application/json") from None


async def _receive(request: web.Request, file: BinaryIO) -> None:
    """Write the content of a request into a ``file``, part by part."""
    size = 0
    while part := await _in_time(request.content.readany()):
        size += len(part)
        if size > _MOST_BYTES:
            raise InputError(f"{Path(file.name).name}: more than 1 GiB; name it in the spec by its path")
        file.write(part)
