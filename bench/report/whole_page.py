"""Put a page together as one file: script and style in line, and no word of the data becomes markup.

The page's own policy allows its script and its style by their hashes; all others are forbidden.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from typing import Any

from tactsim.bench.pages import in_line, policy_of
from tactsim.core.errors import printable


def whole_page(
    template: str,
    scripts: Sequence[str],
    styles: Sequence[str],
    *,
    title: str,
    data: Mapping[str, Any] | None = None,
    policy: str = "",
    **more: str,
) -> str:
    """Fill a template with its parts; files are named from the folder `bench`.

    data: for the script; None for a page that stands without. policy: what the page may do besides drawing itself.
    more: parts that only this template has, by name; they are taken as they are.
    """
    script, style = (in_line(names) for names in (scripts, styles))
    script = f'"use strict";\n(() => {{\n{script}}})();\n'
    stated = (
        {} if data is None else {"data": _inert(json.dumps(data, allow_nan=False, separators=(",", ":")))}
    )
    parts = {
        "title": html.escape(printable(title)),
        "policy": policy_of(script, style, policy),
        "style": style,
        **stated,
        **more,
        "script": script,
    }
    text = in_line([template])
    for name, part in parts.items():
        before, after = text.split(f"<!--{name}-->")
        text = before + part + after
    return text


def _inert(json_text: str) -> str:
    """Write JSON so that no tag or comment can begin or end in it."""
    return json_text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
