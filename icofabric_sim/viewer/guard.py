# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Access control of the page: any web page in the browser can reach a local socket.

The Host header of a request must name this machine; otherwise another name resolves to it, as in
DNS rebinding. Any port is accepted, because tunnels have their own ports. The Origin header, which
all scripts of web pages send, must be the page itself, port included. A server bound to another
address than the loopback also requires a token: first in the address, then in a cookie of the
browser.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.cookies import CookieError, SimpleCookie
from importlib import import_module
import re
import secrets
import threading
from typing import Any
from urllib.parse import parse_qs, urlsplit

from icofabric_sim.libraries import install_command

_LOOPBACK = re.compile(r'(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?', re.IGNORECASE)
_COOKIE = 'icofabric_viewer'
_install_lock = threading.Lock()


class Guard:
    """Filter of requests by their headers."""

    def __init__(self, host: str, token: str = '') -> None:
        """Guard a server that is bound to `host`; `token` is that of an earlier page, if any."""
        self.is_local = host in ('127.0.0.1', 'localhost', '::1')
        self.token = '' if self.is_local else token or secrets.token_urlsafe(24)
        self._serving: Any = None

    def judge(self, path: str, headers: Mapping[str, str]) -> str:
        """Return why a request is rejected, or '' if it is accepted."""
        host, origin = headers.get('Host', ''), headers.get('Origin')
        if self.is_local and not _LOOPBACK.fullmatch(host):
            return f'the Host header {host[:80]!r} is not this machine'
        if origin is not None and origin != f'http://{host}':
            return f'the Origin {origin[:80]!r} is another page'
        if self.token and not (self._has_token(path) or self._has_cookie(headers)):
            return 'the token is missing: open the address printed by the viewer'
        return ''

    def cookie_for(self, path: str) -> str:
        """Return the Set-Cookie header for a request that contains the token, otherwise ''."""
        if not self._has_token(path):
            return ''
        return f'{_COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/'

    def _has_token(self, path: str) -> bool:
        given = parse_qs(urlsplit(path).query).get('token', [''])[0]
        return bool(self.token) and secrets.compare_digest(given.encode(), self.token.encode())

    def _has_cookie(self, headers: Mapping[str, str]) -> bool:
        try:
            cookie = SimpleCookie(headers.get('Cookie', '')).get(_COOKIE)
        except CookieError:
            return False
        return cookie is not None and secrets.compare_digest(
            cookie.value.encode(), self.token.encode())

    @contextmanager
    def installed(self) -> Iterator[None]:
        """
        Guard the websocket server that is started within the block.

        viser offers no check to pass to websockets, so its call of `serve` is intercepted. Raises
        RuntimeError if there was no such call: then nothing is guarded, and nothing must be
        served.
        """
        server: Any = import_module('websockets.asyncio.server')
        real = server.serve

        def serve(*positions: Any, process_request: Any = None, **words: Any) -> Any:
            self._serving = real(
                *positions, process_request=lambda connection, request: self._process(
                    connection, request, process_request), **words)
            return self._serving

        with _install_lock:
            server.serve = serve
            try:
                yield
            finally:
                server.serve = real
        if self._serving is None:
            raise RuntimeError(
                'this release of viser starts its server differently from 1.1: the page would '
                f'be open to every web page and is not served; {install_command("viser")}')

    def abort_connections(self) -> None:
        """Close the remaining connections without waiting; call in their event loop."""
        for connection, task in list(self._serving.server.handlers.items()):
            task.cancel()
            connection.transport.abort()

    def _process(self, connection: Any, request: Any, process_request: Any) -> Any:
        reason = self.judge(request.path, request.headers)
        if reason:
            return connection.respond(403, f'refused: {reason}\n')
        response = None if process_request is None else process_request(connection, request)
        cookie = self.cookie_for(request.path)
        if response is not None and cookie:
            response.headers['Set-Cookie'] = cookie
        return response
