"""Fill pages from the source: a page's line `<!-- from the source: NAME -->` becomes what NAME below writes.

The line after it, which says to a reader of a clone where to look instead, goes.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.errors import ExtensionError

MARK = re.compile(r"^<!-- from the source: ([\w ]+) -->\n.+$", re.M)

SEVERAL = 4  # estimators with an option make it a shared one

LISTED = re.compile(r"<list\[(\w+)\]>")  # how typer writes an option that may be repeated


def setup(app: Sphinx) -> dict[str, Any]:
    """Fill every page as it is read."""
    app.connect("source-read", fill)
    app.connect("env-get-outdated", outdated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def outdated(app: Sphinx, env: BuildEnvironment, *changes: set[str]) -> list[str]:
    """Name the pages that are filled: they are read again at every build, as the source may have changed."""
    return [page for page in env.found_docs if MARK.search(env.doc2path(page).read_text(encoding="utf-8"))]


def fill(app: Sphinx, page: str, content: list[str]) -> None:
    """Replace a page's marks by what they name."""

    def written(mark: re.Match[str]) -> str:
        if mark[1] not in WRITERS:
            raise ExtensionError(f"{page}: nothing is written from the source for {mark[1]!r}")
        return "\n".join(WRITERS[mark[1]]())

    content[0] = MARK.sub(written, content[0])


def commands() -> Iterator[str]:
    """Write every verb of the command line: what it does, its arguments and its options."""
    from tactsim.bench.cli.app import VERBS, load

    for name in VERBS:
        verb = load(name)
        context = verb.make_context(f"bench {name}", [], resilient_parsing=True)
        usage = " ".join(["bench", name, *verb.collect_usage_pieces(context)])
        yield from (
            "",
            f"## bench {name}",
            "",
            verb.help.replace("\n\n", "\0").replace("\n", " ").replace("\0", "\n\n"),
        )
        yield from ("", "```text", usage, "```", "")
        rows = filter(None, (parameter.get_help_record(context) for parameter in verb.params))
        yield from table(("", ""), [(code(LISTED.sub(r"<\1> ...", left)), right) for left, right in rows])


def estimator_options() -> Iterator[str]:
    """Write the built-in estimators' options: first those that several share, then what each has of its own."""
    from tactsim.estimators.registry import BUILT_IN, options_of

    options = {name: fields(options_of(name)) for name in BUILT_IN}
    shared = [row for row, number in Counter(chain(*options.values())).items() if number >= SEVERAL]
    head = ("option", "default", "what it is")
    yield from (
        "",
        "### Shared",
        "",
        f"At least {SEVERAL} estimators have each of these; below they are named.",
        "",
    )
    yield from table(head, shared)
    for name, rows in options.items():
        summary = BUILT_IN[name][1]
        yield from ("", f"### {name}", "", f"{summary[0].upper()}{summary[1:]}.", "")
        if common := [row[0] for row in rows if row in shared]:
            yield from (f"Shared: {', '.join(common)}.", "")
        if own := [row for row in rows if row not in shared]:
            yield from table(head, own)


def scan_options() -> Iterator[str]:
    """Write every option of a scan, nested ones by their dotted names."""
    from tactsim.press import ScanOptions

    yield from table(("option", "default", "what it is"), fields(ScanOptions))


def solid_options() -> Iterator[str]:
    """Write every option of a scan of solids but those of its pad and sensor, which are a scan's."""
    from tactsim.solids import SpaceOptions

    rows = [row for row in fields(SpaceOptions) if not row[0].startswith(("`pad.", "`sensor."))]
    yield from table(("option", "default", "what it is"), rows)


def metrics() -> Iterator[str]:
    """Write every metric of a run, and what it is."""
    from tactsim.bench.score import figures
    from tactsim.solids.score import METRICS

    rows = [
        (code(name), "solids" if name in METRICS else "all", metric.description)
        for name, metric in figures("solids").items()
    ]
    yield from table(("name", "of which runs", "what it is"), rows)


def device_file_keys() -> Iterator[str]:
    """Write every key of a device file, a table for each of its tables."""
    from key_table import key_tables

    yield from key_tables().splitlines()


WRITERS: dict[str, Callable[[], Iterator[str]]] = {
    "commands": commands,
    "estimator options": estimator_options,
    "scan options": scan_options,
    "solid options": solid_options,
    "metrics": metrics,
    "device file keys": device_file_keys,
}


def fields(model: type[BaseModel], prefix: str = "") -> list[tuple[str, str, str]]:
    """List a configuration's options as rows: name, default, description."""
    rows = []
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True)
        if isinstance(default, BaseModel):
            rows += fields(type(default), f"{prefix}{name}.")
        else:
            rows.append((code(prefix + name), code(str(default)), field.description or ""))
    return rows


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> Iterator[str]:
    """Write a table in Markdown."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |"


def code(text: str) -> str:
    """Set a text as code."""
    return f"`{text}`" if text else ""
