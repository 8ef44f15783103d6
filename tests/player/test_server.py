"""The player's server, asked by whom it is not for."""

from __future__ import annotations

import http.client
import socket
import threading
from collections.abc import Iterator

import pytest

from robolamp.player.server import HOST, PageServer

PAGE = b"<p>the run</p>"
EVIL = "evil.example"


@pytest.fixture
def server() -> Iterator[PageServer]:
    with PageServer(PAGE, 0) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.01,))
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def asked(server: PageServer, method: str = "GET", path: str = "/", **headers: str) -> tuple[int, bytes]:
    """Status and body; headers as a page that tries to get at this one would send them."""
    connection = http.client.HTTPConnection(HOST, server.server_port, timeout=10)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            if value:
                connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_a_browser_here_gets_the_page(server: PageServer) -> None:
    port = server.server_port
    assert asked(server) == (200, PAGE)
    assert asked(server, Host=f"localhost:{port}", Origin=f"http://localhost:{port}") == (200, PAGE)
    assert asked(server, Host=f"LOCALHOST:{port}") == (200, PAGE)
    assert asked(server, "HEAD") == (200, b"")


@pytest.mark.parametrize("method", ["GET", "HEAD"])
@pytest.mark.parametrize(
    "host", [EVIL, f"{EVIL}:PORT", f"127.0.0.1.{EVIL}:PORT", "127.0.0.1", "127.0.0.1:1", "0.0.0.0:PORT", "", "[::1]:1"]
)
def test_a_foreign_host_gets_nothing(server: PageServer, method: str, host: str) -> None:
    status, body = asked(server, method, Host=host.replace("PORT", str(server.server_port)))
    assert status == 403
    assert PAGE not in body


@pytest.mark.parametrize("origin", [f"http://{EVIL}", "null", "https://127.0.0.1:PORT", "http://127.0.0.1:1"])
def test_a_foreign_origin_gets_nothing(server: PageServer, origin: str) -> None:
    status, body = asked(server, Origin=origin.replace("PORT", str(server.server_port)))
    assert status == 403
    assert PAGE not in body


def test_two_hosts_are_none(server: PageServer) -> None:
    with socket.create_connection((HOST, server.server_port), timeout=10) as client:
        lines = ["GET / HTTP/1.1", f"Host: {HOST}:{server.server_port}", f"Host: {EVIL}", "", ""]
        client.sendall("\r\n".join(lines).encode())
        assert b" 403 " in client.recv(1000)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT"])
def test_it_is_only_looked_at(server: PageServer, method: str) -> None:
    assert asked(server, method)[0] == 405


@pytest.mark.parametrize("path", ["/etc/passwd", "/../../etc/passwd", "/%2e%2e/etc/passwd", "/.", "/?x"])
def test_there_is_one_page_only(server: PageServer, path: str) -> None:
    assert asked(server, path=path)[0] == 404


def test_it_is_at_this_computer_alone(server: PageServer) -> None:
    assert server.server_address[0] == "127.0.0.1"


def test_a_client_that_goes_away_is_not_talked_of(capfd: pytest.CaptureFixture[str]) -> None:
    with PageServer(b"x" * 30_000_000, 0) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.01,))
        thread.start()
        for _ in range(3):
            with socket.create_connection((HOST, running.server_port), timeout=10) as client:
                client.sendall(f"GET / HTTP/1.1\r\nHost: {HOST}:{running.server_port}\r\n\r\n".encode())
                client.recv(10)
        running.shutdown()
        thread.join()
    assert capfd.readouterr() == ("", "")
