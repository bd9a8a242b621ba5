"""The window's picture in a browser, from a server that pages of this machine alone reach."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Awaitable, Callable, Iterable
from html import escape
from typing import Any

from gpusim.errors import InputError
from gpusim.interrupts import DelayedSignals
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.view.viewer import Viewer
from gpusim.view.window import FRAMES_PER_SECOND, INSTALL, TITLE, WindowView

LOCAL = "127.0.0.1"
"""Nobody else than this machine is served: there is no password."""

HOST = re.compile(rb"(localhost|127\.0\.0\.1|\[::1\])(:\d+)?", re.IGNORECASE)
"""What this machine is called at either end of a tunnel, whose port may be any."""

Receive = Callable[[], Awaitable[dict[str, Any]]]
Send = Callable[[dict[str, Any]], Awaitable[None]]


class LocalPages:
    """An ASGI application that is used by its own pages alone, under a name of this machine.

    Browsers let any web page open connections to this machine, and say whose page it is
    (``Origin``) and by which name it came (``Host``): a name of its own may lead here, too.
    """

    def __init__(self, application: Any) -> None:
        self.application = application

    async def __call__(self, scope: dict[str, Any], receive: Receive, send: Send) -> None:
        """Answer 403, or let the application answer; it gets no messages but those of its page."""
        if scope["type"] != "lifespan" and not is_local(scope["headers"]):
            if scope["type"] == "websocket":
                return await send({"type": "websocket.close"})  # before it is accepted: 403
            await send({"type": "http.response.start", "status": 403, "headers": []})
            return await send({"type": "http.response.body", "body": b"this machine only"})

        async def receive_event() -> dict[str, Any]:
            while True:
                message = await receive()
                if message["type"] != "websocket.receive" or is_event(message.get("text")):
                    return message

        return await self.application(scope, receive_event, send)  # type: ignore[no-any-return]


def is_local(headers: Iterable[tuple[bytes, bytes]]) -> bool:
    """Whether a request is for a name of this machine, and of no page but its own.

    Examples
    --------
    >>> from gpusim.view.server import is_local
    >>> is_local([(b"host", b"localhost:60649"), (b"origin", b"http://localhost:60649")])
    True
    >>> is_local([(b"host", b"localhost:60649"), (b"origin", b"http://evil.example")])
    False
    """
    sent = list(headers)
    hosts, origins = (
        [value for name, value in sent if name == key] for key in (b"host", b"origin")
    )
    return (
        len(hosts) == 1
        and HOST.fullmatch(hosts[0]) is not None
        and all(origin.lower() == b"http://" + hosts[0].lower() for origin in origins)
    )


def is_event(text: str | None) -> bool:
    """Whether a page may send this: rendercanvas takes "_clients_change" and the like of anybody,
    though they are its own; "_framefeedback" alone comes from pages."""
    try:
        event = json.loads(text or "")
        kind = event["type"]
        internal = kind.startswith("_") and not (
            kind == "_framefeedback" and isinstance(event["index"], int)
        )
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return False
    return not internal


def local_socket(port: int) -> socket.socket:
    """Where a browser on this machine can ask.

    Raises
    ------
    InputError
        Another program listens at this port, or there is none of that number.
    """
    result = socket.socket()
    try:
        result.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        result.bind((LOCAL, port))
        result.listen()
    except (OSError, OverflowError) as error:
        result.close()
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"view --port; got {port}: {reason}; expected one that no other program has"
        ) from None
    return result


def serve_view(viewer: Viewer, where: socket.socket) -> None:
    """Show it to a browser on this machine (or at the other end of an SSH tunnel) until Ctrl-C.

    ``where``: as of `local_socket`.

    Raises
    ------
    InputError
        The extra ``[view]`` isn't installed.
    """
    try:
        import uvicorn
        import websockets  # which uvicorn looks for when a browser asks
        from rendercanvas.http import RenderCanvas, asgi, loop, resources
    except ImportError as error:
        raise InputError(f"view: {error.name} is missing; {INSTALL}") from None
    del websockets
    width, height = viewer.size
    kind, page = resources["index.html"]
    title = escape(f"{viewer.path.name}, {TITLE}").encode("ascii", "xmlcharrefreplace").decode()
    page = page.replace("RenderCanvas over http", title)
    page = page.replace("width:640px; height:480px", f"width:{width}px; height:{height}px")
    resources["index.html"] = kind, page
    canvas = RenderCanvas(size=viewer.size, title=TITLE, max_fps=FRAMES_PER_SECOND)
    server = uvicorn.Server(uvicorn.Config(
        LocalPages(asgi), log_level="warning", ws="websockets-sansio", timeout_graceful_shutdown=1
    ))  # fmt: skip
    canvas.add_event_handler(lambda _: setattr(server, "should_exit", True), "close")
    with DelayedSignals() as signals, one_blas_thread():
        WindowView(viewer, canvas, loop, types=False, signals=signals)
        server.run(sockets=[where])
        viewer.close()
