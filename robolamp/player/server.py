"""Serves one page to browsers on this computer, and to no page of another origin in them."""

from __future__ import annotations

import http.server

HOST = "127.0.0.1"
"""This computer alone."""

_IDLE = 10.0  # s: how long a client may keep a connection and say nothing
_HEADERS = {
    "Cache-Control": "no-store",  # another run may have this address next
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PageServer(http.server.ThreadingHTTPServer):
    """A server of one page.

    A page elsewhere whose name is made to mean this computer (DNS rebinding) has that name in Host, and its own origin
    in Origin: both must be this server's.

    Args:
        page: HTML.
        port: Of this computer; 0: any that is free.

    Attributes:
        page: As given.
        url: Where the page is.

    Raises:
        OSError: The port cannot be used.
    """

    daemon_threads = True

    def __init__(self, page: bytes, port: int) -> None:
        super().__init__((HOST, port), _Handler)
        self.page = page
        self.url = f"http://{HOST}:{self.server_port}/"
        names = [HOST, "localhost"]
        self.hosts = {f"{name}:{self.server_port}" for name in names} | ({*names} if self.server_port == 80 else set())

    def handle_error(self, request: object, client_address: object) -> None:
        """Print nothing about a client that went away: it would disturb the terminal."""


class _Handler(http.server.BaseHTTPRequestHandler):
    server: PageServer  # pyright: ignore[reportIncompatibleVariableOverride] (no other starts it)
    server_version, sys_version = "robolamp", ""
    timeout = _IDLE

    def do_GET(self) -> None:
        """Answer with the page if the request comes from this computer's own page."""
        hosts, origins = self.headers.get_all("Host", []), self.headers.get_all("Origin", [])
        if len(hosts) != 1 or hosts[0].strip().lower() not in self.server.hosts:
            self._answer(403, f"This page is at {self.server.url} alone.\n")
        elif any(origin.strip().lower().removeprefix("http://") not in self.server.hosts for origin in origins):
            self._answer(403, "This page is for no other page.\n")
        elif self.path != "/":
            self._answer(404, "There is one page only: /\n")
        else:
            self._answer(200, self.server.page)

    do_HEAD = do_GET

    def refuse(self) -> None:
        """Answer that this page takes no such request."""
        self._answer(405, "This page is only to be looked at.\n")

    do_POST = do_PUT = do_DELETE = do_PATCH = do_OPTIONS = do_TRACE = do_CONNECT = refuse

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing: it would disturb the terminal."""

    def _answer(self, code: int, body: bytes | str) -> None:
        data = body.encode() if isinstance(body, str) else body
        self.send_response(code)
        self.send_header("Content-Type", f"text/{'plain' if isinstance(body, str) else 'html'}; charset=utf-8")
        self.send_header("Content-Length", str(len(data)))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        if code == 405:
            self.send_header("Allow", "GET, HEAD")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(data)
