"""The one exception for a user's mistake, as against a bug."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Say in one line what is wrong, where, and what would be right.

    The command line prints the message without a traceback and exits with status 2; any other
    exception is a bug and keeps its traceback.
    """


def unknown(what: str, name: str, known: Iterable[str]) -> InputError:
    """Build the error for a name that is not among the known ones, with the nearest one if any."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return InputError(f"unknown {what} {name!r}: {hint}known are {', '.join(names)}")
