"""The server of the studio: one page, for this machine alone.

It listens on 127.0.0.1. Before anything else a request is held against the name of the host, the site that it comes
from, and a secret in its address that is new for every start: a page of another site, and a name that is bound to
this machine, get nothing. The page loads nothing from elsewhere, and the browser is told to refuse it.
"""

import asyncio
import errno
import json
import secrets
from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path
from typing import Any

from aiohttp import web

from lensforge.errors import InputError, LensforgeError
from lensforge.live.session import DROPPED, Session
from lensforge.results.files import replacing
from lensforge.spec.shipped_specs import first_sentence, shipped_specs
from lensforge.spec.spec_reference import spec_schema

_PAGE = Path(__file__).with_name("page")
_MOST_BYTES = 2**30  # of a file that is dropped in
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


def _guard(secret: str) -> Any:
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
        try:
            return await handler(request)
        except LensforgeError as error:
            return web.json_response({"lines": str(error).splitlines()}, status=422)

    return guarded


async def _with_headers(_request: web.Request, response: web.StreamResponse) -> None:
    for name, value in _HEADERS.items():
        response.headers.setdefault(name, value)


@cache
def _schema_text() -> str:
    examples = {name: first_sentence(path) for name, path in shipped_specs().items()}
    return json.dumps({"schema": spec_schema(), "examples": examples}, ensure_ascii=False)


def _json(value: object) -> web.Response:
    return web.Response(text=json.dumps(value, default=str), content_type="application/json")


def _file(folder: Path, name: str, known: list[str], headers: dict[str, str] | None = None) -> web.StreamResponse:
    """A file by its name in a folder, of those that are ``known`` there."""
    if name not in known:
        raise web.HTTPNotFound
    return web.FileResponse(folder / name, headers=headers)


class Server:
    """The server of a session on ``port``, 0 for any that is free; ``address`` once it has started."""

    def __init__(self, session: Session, port: int) -> None:
        self.session, self.port, self.address, self._secret = session, port, "", secrets.token_urlsafe(24)
        self._ending = False

    async def start(self) -> None:
        """Listen. Raises :class:`InputError` for a port that another program has."""
        application = web.Application(middlewares=[_guard(self._secret)], client_max_size=2**24)
        application.on_response_prepare.append(_with_headers)
        paths = ("", "events", "{place:page|frame|file|dropped}/{name}", "{what:schema|spec|others}")
        for path, answer in zip(paths, (self._page, self._events, self._named, self._content), strict=True):
            application.router.add_get(f"/{{secret}}/{path}", answer)
        for path, answer in {"spec": self._change, "do/{what}": self._do, "dropped/{name}": self._drop}.items():
            application.router.add_post(f"/{{secret}}/{path}", answer)
        self._runner = web.AppRunner(application, access_log=None, shutdown_timeout=1.0)
        await self._runner.setup()
        try:
            await web.TCPSite(self._runner, "127.0.0.1", self.port).start()
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
            words = "in use by another program" if error.errno == errno.EADDRINUSE else "not for a user's program"
            raise InputError(f"port {self.port}: {words}; give another, or none for any that is free") from None
        self.address = f"http://127.0.0.1:{self._runner.addresses[0][1]}/{self._secret}/"

    async def stop(self) -> None:
        """Listen no more; pages are told."""
        self._ending = True
        self.session.tell()
        await asyncio.sleep(0.05)  # for their last event
        await self._runner.cleanup()

    async def _page(self, _request: web.Request) -> web.StreamResponse:
        return web.FileResponse(_PAGE / "index.html")

    async def _events(self, request: web.Request) -> web.StreamResponse:
        """The state of the session, now and after every change, as server-sent events."""
        response, queue = web.StreamResponse(headers={"Content-Type": "text/event-stream"}), asyncio.Queue[None]()
        await response.prepare(request)
        self.session.listeners.add(queue)
        try:
            while not self._ending:
                await response.write(f"data: {json.dumps(self.session.state, default=str)}\n\n".encode())
                await queue.get()
            await response.write(b"event: end\ndata: {}\n\n")
        except ConnectionResetError:
            pass  # the page is closed
        finally:
            self.session.listeners.discard(queue)
        return response

    async def _named(self, request: web.Request) -> web.StreamResponse:
        """A part of the page, a picture of the session, or a file of the folder."""
        place, name, session = request.match_info["place"], request.match_info["name"], self.session
        if place == "frame":
            frame = session.frames.get(name, b"")
            return web.Response(body=frame, content_type="application/octet-stream", status=200 if frame else 404)
        if place == "file":
            return _file(session.folder, name, session.files(), _OF_REPORTS)
        folder = _PAGE if place == "page" else session.folder / DROPPED
        return _file(folder, name, [each.name for each in folder.glob("*")])

    async def _content(self, request: web.Request) -> web.StreamResponse:
        match request.match_info["what"]:
            case "schema":
                return web.Response(text=_schema_text(), content_type="application/json")
            case "spec":
                return _json(self.session.spec_shown())
        return _json(self.session.others())

    async def _change(self, request: web.Request) -> web.StreamResponse:
        """A change of the text: a whole ``text``, a ``value`` at a ``place``, an ``example``, or a file to ``use``."""
        asked, text = await request.json(), self.session.text
        if "place" in asked:
            text = text.edited(tuple(asked["place"]), asked["value"])
        elif "example" in asked:
            text = text.from_example(str(asked["example"]))
        elif "use" in asked:
            text = self.session.use(str(asked["use"]), str(asked["as"]))
        else:
            text = text.with_text(str(asked["text"]))
        return _json(self.session.change(text))

    async def _do(self, request: web.Request) -> web.StreamResponse:
        session, asked = self.session, await request.json()
        match request.match_info["what"]:
            case "search":
                session.search(**{name: asked[name] for name in ("anew", "accuracy", "seed", "force") if name in asked})
            case "pause" | "stop" | "enough" | "part" as what:
                session.ask(what)
            case "go_on":
                session.go_on()
            case "figure":
                session.colour_by(str(asked["name"]))
            case "beside":
                session.beside(str(asked["name"]))
            case "save":
                session.save()
        return _json({})

    async def _drop(self, request: web.Request) -> web.StreamResponse:
        """A file that is dropped in goes to a folder of its own within the result folder."""
        path, size = self.session.place_of(request.match_info["name"]), 0
        with replacing(path) as temporary, temporary.open("wb") as file:
            async for part in request.content.iter_chunked(2**20):
                size += len(part)
                if size > _MOST_BYTES:
                    raise InputError(f"{path.name}: more than 1 GiB; name it in the spec by its path")
                file.write(part)
        return _json(await self.session.dropped(path))
