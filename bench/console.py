"""The terminal: untrusted text, of which nothing becomes markup or a control code, and how a command ends."""

from __future__ import annotations

import sys
from collections.abc import Callable
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


def exit_status(command: str, work: Callable[[], None]) -> int:
    """Do the work of a command that has no verb in `bench`; a user's mistake is one line on standard error and 2."""
    try:
        work()
    except InputError as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 2
    return 0
