"""The view in a browser: pictures for pages of this machine, nothing for those of others."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from gpusim.scene.toml_text import toml_text
from tests.support.small_scene import DOCUMENT

pytest.importorskip("rendercanvas")
client = pytest.importorskip("websockets.sync.client")
InvalidStatus = pytest.importorskip("websockets.exceptions").InvalidStatus

SECONDS = 90.0
"""Of patience: machines are busy."""


def heard() -> None:
    """Ctrl-C isn't ignored, as it is by what a shell runs in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Server:
    """A view that is served, its process and its address."""

    def __init__(self, folder: Path) -> None:
        (folder / "bar.toml").write_text(toml_text(DOCUMENT), encoding="utf-8")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "gpusim", "view", "bar.toml", "--serve", "--port", "0"],
            cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            preexec_fn=heard,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        assert self.process.stdout
        self.address = self.process.stdout.readline().split()[0]
        self.host = self.address.split("/")[2]

    def page(self, origin: str | None = None) -> Any:
        """A page that has opened a websocket."""
        return client.connect(self.address.replace("http", "ws"), origin=origin, max_size=None)

    def status(self, host: str, **headers: str) -> int:
        """What a request under a name is answered."""
        connection = http.client.HTTPConnection(self.host, timeout=SECONDS)
        connection.putrequest("GET", "/", skip_host=True)
        for name, value in {"Host": host, **headers}.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        try:
            return connection.getresponse().status
        finally:
            connection.close()


@contextmanager
def served(folder: Path) -> Iterator[Server]:
    server = Server(folder)
    with server.process:
        try:
            yield server
        finally:
            server.process.kill()


def resized(page: Any) -> None:
    """The page says how large it is."""
    size = {"width": 320, "height": 200, "pwidth": 320, "pheight": 200, "ratio": 1}
    page.send(json.dumps({"type": "resize", "timestamp": 0, **size}))


def picture(page: Any) -> bytes:
    """The next one that comes, confirmed as pages do."""
    while True:
        message = page.recv(SECONDS)
        if isinstance(message, bytes):
            return message
        said = json.loads(message)
        if "index" in said:
            page.send(json.dumps({"type": "_framefeedback", "index": said["index"],
                                  "timestamp": said["timestamp"], "localtime": 0.0}))  # fmt: skip


def test_the_server(tmp_path: Path) -> None:
    """A browser gets pictures; Ctrl-C ends it while one is connected."""
    with served(tmp_path) as server, server.page() as page:
        resized(page)
        for _ in range(4):  # more than are sent before one is confirmed
            seen = picture(page)
        assert seen[:3] == b"\xff\xd8\xff" or seen[1:4] == b"PNG"
        server.process.send_signal(signal.SIGINT)
        assert server.process.wait(SECONDS) == 130
        assert server.process.stderr
        said = server.process.stderr.read()  # besides, how pictures are packed
        assert said.startswith("reading bar.toml …\n") and "Traceback" not in said


def test_pages_of_others_get_nothing(tmp_path: Path) -> None:
    """Neither under their own name, nor under one of this machine's that leads here, nor by
    messages that are the server's own."""
    with served(tmp_path) as server:
        port = server.host.split(":")[1]
        for host in (f"127.0.0.1:{port}", "localhost:8080", "LOCALHOST", "[::1]:9"):
            assert server.status(host) == 200, host
        for host in ("evil.example", f"evil.example:{port}", "localhost.evil.example", "127.0.0.2",
                     "localhost@evil.example", "localhost:80.evil.example", ""):  # fmt: skip
            assert server.status(host) == 403, host
        assert server.status(server.host, Origin=f"http://{server.host}") == 200
        strangers = ("http://evil.example", "null", "https://" + server.host,
                     f"http://localhost:{port}", f"http://{server.host}.evil.example")  # fmt: skip
        for origin in strangers:
            assert server.status(server.host, Origin=origin) == 403, origin
            with pytest.raises(InvalidStatus) as refused, server.page(origin):
                pass
            assert refused.value.response.status_code == 403, origin
        with server.page(f"http://{server.host}") as first, server.page() as second:
            resized(first)
            picture(first)
            for message in ({"type": "_clients_change", "ids": [2, 1]}, {"type": "_other"},
                            {"type": "_framefeedback", "index": "1"}, ["_clients_change"], "x", 3,
                            {"type": 5}, {}):  # fmt: skip
                second.send(json.dumps(message))
            second.send("[" * 100_000)
            second.send(json.dumps({"type": "key_down", "key": "s", "modifiers": []}))
            assert not says_it_steers(second)
            first.send(json.dumps({"type": "key_down", "key": "h", "modifiers": [],
                                   "timestamp": 0}))  # fmt: skip
            picture(first)
        assert server.process.poll() is None and not list(tmp_path.glob("*.png"))


def says_it_steers(page: Any) -> bool:
    """Whether a page was told that it steers, in all that comes for a while."""
    steers = False
    try:
        while True:
            message = page.recv(2.0)
            if not isinstance(message, bytes):
                said = json.loads(message)
                steers |= said.get("type") == "active" and said["value"]
    except TimeoutError:
        return steers


def test_a_port_in_use(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        done = subprocess.run(
            [sys.executable, "-m", "gpusim", "view", "none.toml", "--serve", "--port", port],
            cwd=tmp_path, text=True, capture_output=True, check=False,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
    assert done.returncode == 2 and port in done.stderr and "--port" in done.stderr
