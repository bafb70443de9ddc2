"""A page on localhost that shows a pad while it is read: one file, and a stream of server-sent events.

Each browser has a thread, which sends the latest view as soon as the browser has taken the one before. So a slow
browser misses views; it delays neither the reading nor the other browsers. The page asks for nothing from a network,
and only a page of this server may send commands: another site's page cannot set the header that they need.
"""

from __future__ import annotations

import json
import secrets
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from types import TracebackType
from typing import Any, Self

import numpy as np

from tactsim.bench.pages import render
from tactsim.bench.watching import BIN_S, HISTORY_S, PadReader, PadView
from tactsim.core.counters import Counters, counter_words
from tactsim.core.errors import InputError, printable
from tactsim.hardware.terminal_pictures import SEEN

HOST = "127.0.0.1"
# The page looks like a report, and is made by the same small functions.
_SCRIPTS = ("report/assets/base.js", "watching/assets/pad.js")
_STYLES = ("report/assets/page.css", "watching/assets/watch.css")
_COMMAND_HEADER = "X-Tactsim"
_FASTEST_S = 1 / 60  # between two events, and more for a pad so large that they would fill the connection
_BYTES_PER_S = 4e6
_STILL_S = 0.25  # without anything new, an event is sent all the same: the age of what is shown grows
_SEND_BUFFER = 1 << 15  # bytes: what a slow browser has not taken yet is old, so little of it is kept

# What a viewer besides the pad adds to an event: called with the numbers that the browser was sent before.
More = Callable[[dict[str, int]], dict[str, Any]]


class WebPage:
    """Serve the page until the `with` ends. url: where it is."""

    def __init__(
        self,
        reader: PadReader,
        port: int,
        *,
        from_behind: bool,
        about: Mapping[str, Any] | None = None,
        commands: Mapping[str, Callable[[], None]] | None = None,
        more: More | None = None,
    ) -> None:
        """Begin to listen on `port` of localhost; 0 takes any that is free.

        about: what the page is told once besides the pad. commands: by name, what its buttons do besides "tare".
        more: adds to every event. Raises InputError if the port is taken.
        """
        token = secrets.token_hex(8)
        handler = type("Handler", (_Handler,), {
            "reader": reader, "page": _page(reader, from_behind, {**(about or {}), "page": token}),
            "more": staticmethod(more or (lambda sent: {})), "token": token,
            "commands": {"tare": reader.tare, **(commands or {})},
        })  # fmt: skip
        try:
            self._server = _Server((HOST, port), handler)
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise InputError(
                f"cannot serve the page on {HOST}:{port}: {reason}; take another --web-port, or 0 for any that is free"
            ) from error
        self.url = f"http://{HOST}:{self._server.server_port}/"
        self._thread = Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, name="page", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()


def event_of(reader: PadReader, view: PadView) -> dict[str, Any]:
    """Describe a view, and the force of the last seconds, for the page as JSON."""
    as_they_are = ("number", "state", "trouble", "readings", "scale", "counters", "tared", "message")
    return {
        **{name: getattr(view, name) for name in as_they_are},
        "sent": round(time.monotonic(), 3),
        "rate": round(view.rate, 1),
        "force": round(view.force, 3) + 0.0,
        "pressures": None if view.pressures is None else numbers(view.pressures, 1),
        "leftOut": view.left_out,
        "history": [None if force is None else round(force, 3) for force in reader.history()],
    }


def numbers(values: Any, digits: int) -> list[float | None]:
    """Round numbers for JSON; NaN becomes null, and nothing is minus zero."""
    return [None if np.isnan(value) else round(value, digits) + 0.0 for value in np.asarray(values).tolist()]


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True
    block_on_close = False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that went away."""


class _Handler(BaseHTTPRequestHandler):
    reader: PadReader
    page: bytes
    token: str  # tells a page of this server from one of a server that was here before
    commands: Mapping[str, Callable[[], None]]
    more: More

    server_version, sys_version = "tactsim", ""
    timeout = 10  # s for which a browser may say or take nothing

    def setup(self) -> None:
        """Keep little of what a browser has not taken yet."""
        self.request.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().setup()

    def do_GET(self) -> None:
        """Give the page, or the stream of events."""
        if not self._asked_here():
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST)
        elif self.path == "/":
            self._give(self.page, "text/html; charset=utf-8")
        elif self.path == "/events":
            with suppress(OSError):  # the browser went away
                self._stream()
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Do what a button asks for."""
        command = self.commands.get(self.path.removeprefix("/do/"))
        if not self._asked_here() or self.headers.get(_COMMAND_HEADER) is None:
            self._refuse(HTTPStatus.FORBIDDEN)
        elif command is None:
            self._refuse(HTTPStatus.NOT_FOUND)
        else:
            command()
            self._give(b"", "text/plain")

    def log_message(self, format: str, *arguments: Any) -> None:
        """Write no log: the terminal shows the pad."""

    def _asked_here(self) -> bool:
        """Tell whether the browser means this server: a foreign name that leads here (DNS rebinding) is refused."""
        assert isinstance(self.server, _Server)
        port = self.server.server_port
        return self.headers.get("Host") in (f"{HOST}:{port}", f"localhost:{port}")

    def _begin(self, status: HTTPStatus, kind: str, length: int | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.end_headers()

    def _give(self, content: bytes, kind: str) -> None:
        self._begin(HTTPStatus.OK, kind, len(content))
        self.wfile.write(content)

    def _refuse(self, status: HTTPStatus) -> None:
        self._begin(status, "text/plain", 0)

    def _stream(self) -> None:
        self._begin(HTTPStatus.OK, "text/event-stream")
        sent: dict[str, int] = {}
        number, pause = -1, _FASTEST_S
        while True:
            view = self.reader.wait(number, _STILL_S)
            number = view.number
            event = {"page": self.token} | event_of(self.reader, view) | self.more(sent)
            content = f"data: {json.dumps(event, allow_nan=False, separators=(',', ':'))}\n\n".encode()
            self.wfile.write(content)
            if self.reader.closed:
                return
            pause = max(_FASTEST_S, len(content) / _BYTES_PER_S)
            time.sleep(pause)


def _page(reader: PadReader, from_behind: bool, about: Mapping[str, Any]) -> bytes:
    pad = reader.pad
    told = {
        "device": reader.device.name,
        "port": printable(reader.name),
        "rows": pad.rows,
        "columns": pad.columns,
        "columnEdges": np.round(pad.column_edges, 4).tolist(),
        "rowEdges": np.round(pad.row_edges, 4).tolist(),
        "fromBehind": from_behind,
        "seen": [SEEN[False], SEEN[True]],
        "taxels": reader.device.taxel_names(),
        "binSeconds": BIN_S,
        "historySeconds": HISTORY_S,
        "counterWords": {name: counter_words(name) for name in Counters().as_dict()},
        **about,
    }
    look: dict[str, Any] = {"scripts": _SCRIPTS, "styles": _STYLES, "policy": "connect-src 'self'; "}
    title = f"{reader.device.name}: {reader.name}"
    return render("watching/assets/watch.html", title=title, data=told, **look).encode()
