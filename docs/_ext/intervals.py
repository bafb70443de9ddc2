"""Keep an interval of a table, such as (0.93-0.99), on one line.

Browsers break lines behind a hyphen. A word joiner, which is not seen, forbids it there.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

_HYPHEN = re.compile(r"(?<=\d)-(?=\d|later\b)")


def join(app: Sphinx, page: nodes.document, name: str) -> None:
    """Put a word joiner behind the hyphens between two numbers in the tables of a page."""
    for entry in page.findall(nodes.entry):
        for text in list(entry.findall(nodes.Text)):
            if not isinstance(text.parent, nodes.literal):
                text.parent.replace(text, nodes.Text(_HYPHEN.sub("-\u2060", text)))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("doctree-resolved", join)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
