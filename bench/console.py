"""Print untrusted text on the terminal: nothing in it becomes markup or a control code."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from tactsim.core.errors import printable


class _PlainConsole(Console):
    def render_str(self, text: str, **options: Any) -> Text:
        """Render any str, a table's cells included, with unprintable characters escaped."""
        return super().render_str(printable(text), **options)


def plain_console(stderr: bool = False) -> Console:
    """Make a console that shows every str as it is written; only `style` and rich's own `Text` format it."""
    return _PlainConsole(stderr=stderr, markup=False, highlight=False, emoji=False)
