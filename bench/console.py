"""The terminal: untrusted text, of which nothing becomes markup or a control code, and how a command ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.text import Text

from tactsim.core.errors import InputError, printable


class _PlainConsole(Console):
    def render_str(self, text: str, **options: Any) -> Text:
        """Render any str, a table's cells included, with unprintable characters escaped."""
        return super().render_str(printable(text), **options)


def plain_console(stderr: bool = False) -> Console:
    """Make a console that shows every str as it is written; only `style` and rich's own `Text` format it."""
    return _PlainConsole(stderr=stderr, markup=False, highlight=False, emoji=False)


@contextmanager
def kept_clear(wanted: bool) -> Iterator[None]:
    """Lead what is written to standard output within the block to standard error, that of worker processes too.

    So an estimator that prints does not spoil the JSON object that follows. wanted: whether to do so.
    """
    if not wanted or sys.stdout is None:
        yield
        return
    sys.stdout.flush()
    output = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(output, 1)
        os.close(output)


def exit_status(command: str, work: Callable[[], None]) -> int:
    """Do the work of a command that has no verb in `bench`; a user's mistake is one line on standard error and 2."""
    try:
        work()
    except InputError as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 2
    return 0
