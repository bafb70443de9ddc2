"""Single keys of a terminal, read without waiting."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


@contextmanager
def keys() -> Iterator[Callable[[], list[str]]]:
    """Give a function that returns the keys typed since its last call; none if standard input is no terminal."""
    if not sys.stdin.isatty():
        yield lambda: []
        return
    if sys.platform == "win32":
        yield _typed_on_windows
        return
    try:
        import termios
        import tty
    except ImportError:  # a Python without terminals
        yield lambda: []
        return
    settings = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield _typed
    finally:
        with suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)


def _typed() -> list[str]:
    typed: list[str] = []
    while select.select([sys.stdin], [], [], 0)[0]:
        try:
            key = os.read(sys.stdin.fileno(), 1)
        except OSError:
            key = b""
        if not key:  # the terminal is gone
            return [*typed, "q"]
        typed.append(key.decode(errors="replace").lower())
    return typed


def _typed_on_windows() -> list[str]:
    typed: list[str] = []
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            typed.append(msvcrt.getwch().lower())
    return typed
