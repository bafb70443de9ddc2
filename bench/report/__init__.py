"""The report: one HTML file that shows runs to a person, and the same curves as CSV and pictures.

Lives here: which runs belong together, the points that are plotted, the trial that is stepped
through, and the page (`assets/`: plain HTML, CSS and JavaScript, no library). Does not live here:
metrics of a run, which are `tactsim.bench.score`'s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tactsim.core import InputError
from tactsim.core.files import opened

if TYPE_CHECKING:
    from tactsim.bench.results import Run
    from tactsim.bench.trials import Progress

REPORT_TITLE = "tactsim: "  # the title of every report begins so, by which one is known that may be made anew
_HEAD = 2000  # bytes of a page, within which its title is


@dataclass(frozen=True)
class Sheet:
    """How pictures for a paper are drawn: inches wide, one panel (accuracy or error) or both, and with a caption."""

    width: float = 7.16  # both columns of a page of the IEEE
    panel: Literal["accuracy", "error"] | None = None
    caption: bool = True


@dataclass(frozen=True)
class Pages:
    """A report that is wanted: its runs, each with the folder that it is known by, its file, and remarks to begin with.

    sheet: of the pictures beside it.
    """

    runs: Sequence[tuple[Path, Run]]
    out: Path
    remarks: Sequence[str]
    progress: Progress
    sheet: Sheet = Sheet()


def check_page(path: Path) -> None:
    """Raise InputError unless `path` is called like a page, and nothing or an older report stands there."""
    if path.suffix != ".html" and not path.is_dir():
        raise InputError(f"{path}: the report is a page; give a name that ends in .html")
    if path.is_file() and not is_report(path):
        raise InputError(f"{path}: what stands there is no report and is not replaced; name another file")


def is_report(path: Path) -> bool:
    """Tell whether a report stands at `path`: a page that `bench report` made."""
    if not path.is_file():
        return False
    with opened(path) as stream:
        return f"<title>{REPORT_TITLE}".encode() in stream.read(_HEAD)
