"""Keep what belongs together on one line: an interval, such as (0.93-0.99), and a number with its unit."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

# Browsers break lines behind a hyphen or a dash. A word joiner, which is not seen, forbids it there.
_HYPHEN = re.compile(r"(?<=\d[-–])(?=\d|later\b)")
_UNIT = re.compile(r"(?<=\d) (?=(?:%|mm|kPa|N|rad|deg|degrees|ms|s)(?!\w))|(?<=<) (?=\d)")
_VERBATIM = nodes.literal | nodes.literal_block | nodes.raw | nodes.math | nodes.math_block


def join(app: Sphinx, page: nodes.document, name: str) -> None:
    """Put no-break spaces before the units of a page, and word joiners into the intervals of its tables."""
    in_tables = {id(text) for entry in page.findall(nodes.entry) for text in entry.findall(nodes.Text)}
    for text in list(page.findall(nodes.Text)):
        if not isinstance(text.parent, _VERBATIM):
            joined = _HYPHEN.sub("\u2060", text) if id(text) in in_tables else str(text)
            text.parent.replace(text, nodes.Text(_UNIT.sub("\u00a0", joined)))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("doctree-resolved", join)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
