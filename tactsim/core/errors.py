"""`InputError`, the one exception for a user's mistake, and functions that word its message."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable
from typing import Any

_LONGEST_LINE = 2000  # characters


class InputError(ValueError):
    """A user's mistake; the message says in one line what is wrong, where, and what would be right.

    The command line prints the message without a traceback and exits with status 2. Any other
    exception is a bug and keeps its traceback.
    """

    def __str__(self) -> str:
        """Return the message, cut to 2,000 characters: text from a file can make it too long to read."""
        message = super().__str__()
        return message if len(message) <= _LONGEST_LINE else f"{message[:_LONGEST_LINE]} ..."


_CANDIDATES = 8  # at most, that an error names
_LONGEST = 100  # characters of an unknown name that are compared with the known names
_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2
_SHORT.maxtuple = _SHORT.maxlist = _SHORT.maxdict = 4
_SHORT.maxstring = _SHORT.maxother = 80


def counted(number: int, what: str) -> str:
    """Write a number and what it counts, in the plural unless it is one: 1 trial, 20 trials, 3 touches."""
    return f"{number} {what}{'' if number == 1 else 'es' if what.endswith(('ch', 'ss')) else 's'}"


def short(value: Any) -> str:
    """Write an untrusted value so that it fits into a line; long values are cut."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # Python writes no integer of more than 4,300 digits
        return "a number of thousands of digits"


def printable(text: str) -> str:
    """Escape all unprintable characters but newlines, so that untrusted text cannot control a terminal."""
    return "".join(
        sign if sign.isprintable() or sign == "\n" else sign.encode("unicode_escape").decode()
        for sign in text
    )


def unknown(what: str, name: Any, known: Iterable[str]) -> InputError:
    """Build the error for an unknown name; it suggests the closest known name, if one is close.

    name: whatever was given; it may be no text at all. known: each is named once, however often it is given; of more
    than eight the nearest by spelling.
    """
    names = sorted(set(known))
    close: list[str] = []
    if isinstance(name, str):
        close = [one for one in names if one.lower() == name.lower()]
        parts = {one.rpartition(".")[2]: one for one in names}  # `noise` stands for `sensor.noise`
        close = close or difflib.get_close_matches(name[:_LONGEST], names, n=1)
        close = close or [parts[part] for part in difflib.get_close_matches(name[:_LONGEST], parts, n=1)]
    hint = f"did you mean {close[0]!r}? " if close else ""
    text = name[:_LONGEST] if isinstance(name, str) else ""
    nearest = difflib.get_close_matches(text, names, n=len(names) or 1, cutoff=0)
    return InputError(
        f"unknown {what} {short(name)}: {hint}known are "
        + some([*sorted(nearest[:_CANDIDATES]), *nearest[_CANDIDATES:]])
    )


def some(names: Iterable[str]) -> str:
    """List names for an error: eight at most, and how many more there are."""
    listed = list(names)
    more = f" and {len(listed) - _CANDIDATES} more" if len(listed) > _CANDIDATES else ""
    return f"{', '.join(listed[:_CANDIDATES]) or 'none'}{more}"


def was_interrupt(error: SystemError) -> bool:
    """Tell whether an error is an interrupt (Ctrl-C) that came while a compiled function made its result.

    Python finds a result beside an exception then, and raises SystemError from it, once for each call that it ends.
    """
    cause: BaseException | None = error
    while isinstance(cause, SystemError):
        cause = cause.__cause__
    return isinstance(cause, KeyboardInterrupt)
