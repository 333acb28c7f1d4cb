"""Connections of the page's server: how many there may be, and how long one may wait before it has shown the secret.

A browser needs a few. A connection that sends half of a request, or nothing, is closed; where there are too many, the
oldest of those that have not shown the secret makes room, so that the page of this machine's user is always answered.
"""

import asyncio
import socket
from contextlib import suppress

from aiohttp import web

MOST = 128
MOST_STRANGERS = 32
STRANGER_S = 10.0  # for the head of a request; after it a connection may be kept, and wait as long
_PAUSE_S = 0.1  # where the system has no more connections


class Connections:
    """The connections that a ``listener`` accepts for a server."""

    def __init__(self, listener: socket.socket, server: web.Server) -> None:
        listener.setblocking(False)
        self._listener = listener
        self._server = server
        self._open = dict[asyncio.BaseProtocol, asyncio.Transport]()  # the oldest first
        self._known = set[asyncio.BaseProtocol]()
        self._accepting = asyncio.get_running_loop().create_task(self._accept())

    def admit(self, protocol: asyncio.BaseProtocol) -> None:
        """Note a connection that has shown the secret."""
        self._known.add(protocol)

    async def close(self) -> None:
        """Accept no more."""
        self._accepting.cancel()
        with suppress(asyncio.CancelledError):
            await self._accepting
        self._listener.close()

    async def _accept(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, _ = await loop.sock_accept(self._listener)
                transport, protocol = await loop.connect_accepted_socket(self._server, accepted)
            except OSError:  # it is gone already, or the system has no more
                await asyncio.sleep(_PAUSE_S)
                continue
            self._forget_closed()
            self._open[protocol] = transport
            self._make_room()
            loop.call_later(STRANGER_S, self._end_stranger, protocol)

    def _forget_closed(self) -> None:
        self._open = {protocol: transport for protocol, transport in self._open.items() if not transport.is_closing()}
        self._known.intersection_update(self._open)

    def _make_room(self) -> None:
        strangers = [protocol for protocol in self._open if protocol not in self._known]
        too_many = len(strangers) > MOST_STRANGERS or len(self._open) > MOST
        if too_many:
            self._end_stranger(strangers[0])

    def _end_stranger(self, protocol: asyncio.BaseProtocol) -> None:
        if protocol not in self._known and protocol in self._open:
            self._open.pop(protocol).abort()
