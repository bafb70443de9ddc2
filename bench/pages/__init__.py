"""Pages: a base template that they extend, and how one is rendered: whole, in one file, that opens without a network.

No word of the data becomes markup: templates escape what they are given, and write data for a script by the filter
`tojson`, in whose JSON no tag or comment can begin or end. The page's own policy allows its script and its style by
their hashes; all others are forbidden.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from tactsim.core.errors import printable


def render(
    template: str, *, scripts: Sequence[str] = (), styles: Sequence[str], policy: str = "", **context: Any
) -> str:
    """Render a template that extends `pages/base.html`; files are named from the folder `bench`,
    or with a / in front from the package, as those of a room beside are.

    policy: what the page may do besides drawing itself, as directives of a Content-Security-Policy. context: what the
    template shows; `title` is one of it. Raises ValueError if data for a script hold NaN or an infinity.
    """
    script, style = ("\n".join(map(_source, names)) for names in (scripts, styles))
    script = f'"use strict";\n(() => {{\n{script}}})();\n' if scripts else ""
    allowed = (
        f"default-src 'none'; {policy}img-src data:; style-src {_hash(style)}; script-src {_hash(script)}"
    )
    return _TEMPLATES.get_template(template).render(
        script=Markup(script), style=Markup(style), policy=Markup(allowed), **context
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _source(name: str) -> str:
    room, name = ("tactsim", name[1:]) if name.startswith("/") else ("tactsim.bench", name)
    return (files(room) / name).read_text(encoding="utf-8")


def _shown(value: Any) -> Any:
    """Let no character through that cannot be printed, such as those that turn the direction of a text."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


_TEMPLATES = Environment(
    loader=FunctionLoader(_source),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=_shown,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
# The order of what a script is given is kept: it is shown in it.
_TEMPLATES.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
