"""The terminal: untrusted text, of which nothing becomes markup or a control code, and how a command ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from tactsim.core.errors import printable

_UNBOUNDED = 10_000  # characters of a line, more than any table needs


class _PlainConsole(Console):
    def render_str(self, text: str, **options: Any) -> Text:
        """Render any str, a table's cells included, with unprintable characters escaped."""
        return super().render_str(printable(text), **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print; where a table's figures and words have no room, its lines run over the edge: none is cut."""
        for table in objects:
            if isinstance(table, Table):
                # Every column has the room that its figures need, or its longest word that is no wider than all.
                for column in table.columns:
                    head, *cells = (str(cell) for cell in (column.header, *column.cells))
                    if column.justify == "right":
                        # An interval stays in one line; a heading may take several.
                        column.min_width = max(map(len, (*head.split(), *cells)), default=0)
                        column.no_wrap = len(head) <= column.min_width
                    else:
                        words = (word for line in (head, *cells) for word in line.split())
                        column.min_width = min(max(map(len, words), default=0), self.width)
                least, most = Measurement.get(self, self.options.update(width=_UNBOUNDED), table)
                if least > self.width:
                    table.width = least
                if most > self.width:  # rich forgets what a column needs at least where it makes one narrower
                    options["crop"] = False
        super().print(*objects, **options)


def plain_table(*headings: str, words: int = 1) -> Table:
    """Make a table without rules: the first columns hold `words`, the others figures, set to the right."""
    table = Table(box=None, pad_edge=False)
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number < words else "right", overflow="fold")
    return table


def plain_grid(rows: Sequence[Sequence[str]], *, names: bool = True) -> Table:
    """Lay out rows of one length without heads. names: whether the first column holds names, which are not broken."""
    table = Table.grid(padding=(0, 2))
    for number, _ in enumerate(rows[0] if rows else ()):
        table.add_column(overflow="fold", no_wrap=names and number == 0)
    for row in rows:
        table.add_row(*row)
    return table


def plain_console(stderr: bool = False) -> Console:
    """Make a console that shows every str as it is written; only `style` and rich's own `Text` format it."""
    return _PlainConsole(stderr=stderr, markup=False, highlight=False, emoji=False)


def rounded(value: float, digits: int, sign: str = "") -> str:
    """Write a number with so many decimals; what rounds to nothing has no minus. sign: "+" writes a plus, too."""
    return f"{value:{sign}z.{digits}f}"


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
