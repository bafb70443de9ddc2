"""Blocks of a page that a command makes anew, each between two comments.

The first says what is asked for:

    <!-- table: SWEEP; accuracy@5 -->
    <!-- end of table -->
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tactsim.core import InputError
from tactsim.core.documents import read_text
from tactsim.core.files import write_text

_LARGEST_PAGE = 10_000_000  # bytes


def blocks(kind: str) -> re.Pattern[str]:
    """Find whole blocks of a kind; the group `asked` is what one asks for."""
    return re.compile(rf"(<!-- {kind}: (?P<asked>[^>]*?) -->\n).*?(<!-- end of {kind} -->)", re.DOTALL)


def asked_for(text: str, kind: str) -> list[str]:
    """List what the blocks of a kind ask for. Raises InputError if one has no end."""
    found = [match["asked"] for match in blocks(kind).finditer(text)]
    if text.count(f"<!-- {kind}:") != len(found):
        raise InputError(f"`<!-- {kind}: ... -->` has no `<!-- end of {kind} -->`")
    return found


def fill_blocks(text: str, kind: str, made: Callable[[str], str]) -> str:
    """Replace the content of every block of a kind by what is made of what it asks for, whole lines.

    Raises InputError if a block has no end.
    """
    asked_for(text, kind)
    return blocks(kind).sub(lambda block: f"{block[1]}{made(block['asked'])}{block[3]}", text)


def read_page(page: Path) -> str:
    """Read the text of a page. Raises InputError if it cannot be read."""
    return read_text(page, "page", _LARGEST_PAGE)


def fill_page(page: Path, fill: Callable[[str], str]) -> None:
    """Write a page anew with its text filled. Raises InputError if it cannot be read, filled or written."""
    text = read_page(page)
    try:
        filled = fill(text)
    except InputError as error:
        raise InputError(f"{page}: {error}") from error
    write_text(page, filled)


def exit_status(command: str, work: Callable[[], None]) -> int:
    """Do the work of a tool; a user's mistake is one line on standard error and 2."""
    try:
        work()
    except InputError as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 2
    return 0


def fill_one(command: str, words: Sequence[str], fill: Callable[[str], str]) -> int:
    """Fill the one page that a command is given; returns its exit status, see `exit_status`."""

    def work() -> None:
        if len(words) != 1:
            raise InputError("give one page")
        fill_page(Path(words[0]), fill)

    return exit_status(command, work)
