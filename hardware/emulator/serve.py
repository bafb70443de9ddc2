"""Put an emulated device on a pty or a TCP port."""

from __future__ import annotations

import os
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event

import numpy as np

from tactsim.core.errors import InputError
from tactsim.hardware.emulator.emulated import Emulated, Faults

Ready = Callable[[str], None]

_AWAY = 0.3  # s for which a cut line stays down
_NAP = 0.02  # s: the longest time between looks at the clock


@dataclass
class _Clock:
    """Seconds since the first host connected; the emulation begins then."""

    started: float | None = None

    def start(self) -> None:
        self.started = time.monotonic() if self.started is None else self.started

    def now(self) -> float:
        return 0.0 if self.started is None else time.monotonic() - self.started


def serve_pty(
    device: Emulated,
    faults: Faults,
    rng: np.random.Generator,
    *,
    link: Path | None = None,
    ready: Ready = lambda url: None,
    stop: Event | None = None,
) -> None:
    """Serve on a new pty until `stop`. `ready(name)` is called with the name that a host opens.

    link: a symbolic link to the pty. When a fault cuts the line it is gone until another pty takes over: the system may
    give the old one's name to any other program.
    Raises InputError if `link` exists and is no symbolic link, or cannot be made, and where there are no ptys.
    """
    if link is not None and link.exists() and not link.is_symlink():
        raise InputError(f"{link} exists and is no link; name another place for the pty")
    stop, clock = stop or Event(), _Clock()
    while not stop.is_set():
        master, name = _open_pty()
        try:
            if link is not None:
                _point(link, name)
            ready(str(link or name))
            os.set_blocking(master, False)
            line = _Line(master, partial(os.read, master), partial(os.write, master), gone_for_good=False)
            _talk(line, device, faults, rng, clock, stop)
        finally:
            if link is not None and link.is_symlink() and str(link.readlink()) == name:  # and not another's
                link.unlink()
            os.close(master)
        stop.wait(_AWAY)


def serve_tcp(
    device: Emulated,
    faults: Faults,
    rng: np.random.Generator,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    ready: Ready = lambda url: None,
    stop: Event | None = None,
) -> None:
    """Serve on a TCP port until `stop`, one host after another; port 0 takes any that is free.

    `ready(url)` is called with the URL that a host opens. Raises InputError if the port is taken.
    """
    stop, clock = stop or Event(), _Clock()
    try:
        server = socket.create_server((host, port))
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot serve on {host}:{port}: {error}") from error
    with server:
        ready(f"socket://{host}:{server.getsockname()[1]}")
        while not stop.is_set():
            if not select.select([server], [], [], _NAP)[0]:
                continue
            connection, _ = server.accept()
            with connection:
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                line = _Line(connection.fileno(), connection.recv, connection.send, gone_for_good=True)
                _talk(line, device, faults, rng, clock, stop)


@dataclass(frozen=True)
class _Line:
    """The device's end of a pty, which another host may open again, or of a connection, which is `gone_for_good`.

    receive(most) and send(data): as those of a file or a socket that does not block.
    """

    fileno: int
    receive: Callable[[int], bytes]
    send: Callable[[bytes], int]
    gone_for_good: bool

    def connected(self) -> bool:
        """Tell whether a host has the other end open; a connection has one until it is gone."""
        if self.gone_for_good:
            return True
        poll = select.poll()
        poll.register(self.fileno, select.POLLHUP)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def read(self) -> bytes:
        """Read what the host sent; b"" if it has gone."""
        try:
            return self.receive(4096)
        except OSError:
            return b""


def _talk(
    line: _Line,
    device: Emulated,
    faults: Faults,
    rng: np.random.Generator,
    clock: _Clock,
    stop: Event,
) -> None:
    """Let the device hear and speak until the host is gone, a fault cuts the line, or `stop`."""
    pending = b""  # the rest of a frame that the host was too slow for
    cut_at = clock.now() + faults.disconnect if faults.disconnect else float("inf")
    while not stop.is_set():
        if not line.connected():
            pending = b""
            if clock.started is not None:
                device.unheard(clock.now())
            stop.wait(_NAP)
            continue
        clock.start()
        wait = min(_NAP, 0.5 / device.rate)
        if select.select([line.fileno], [], [], wait)[0]:
            data = line.read()
            if not data and line.gone_for_good:
                return
            device.hear(data, clock.now())
        for message in device.say(clock.now()):
            if not pending:  # a device does not wait: while a frame is pending, later ones are dropped whole
                pending = faults.spoil(message, rng)
                pending = _write(line, pending)
        if pending:
            pending = _write(line, pending)
        if clock.now() >= cut_at:
            return


def _write(line: _Line, data: bytes) -> bytes:
    """Write what fits and return the rest."""
    try:
        while data:
            data = data[line.send(data) :]
    except BlockingIOError:
        pass
    except OSError:  # the host went away meanwhile
        return b""
    return data


def _open_pty() -> tuple[int, str]:
    """Open a pty that passes bytes on as they are. Raises InputError on a system that has none, as Windows."""
    try:
        import tty
    except ImportError:
        raise InputError("this system has no ptys; serve on a TCP port: --port tcp") from None
    master, slave = os.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    os.close(slave)
    return master, name


def _point(link: Path, name: str) -> None:
    """Make `link` point to the pty, at once. Raises InputError if it cannot be made."""
    part = link.with_name(f".{link.name}.{os.getpid()}")
    try:
        part.unlink(missing_ok=True)
        part.symlink_to(name)
        part.replace(link)
    except OSError as error:
        raise InputError(
            f"cannot make the link {link}: {error.strerror}; name another place for the pty"
        ) from error
