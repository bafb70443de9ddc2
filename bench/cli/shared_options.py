"""Options that several verbs share, and how a verb takes a number."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactsim.core.errors import InputError, short

if TYPE_CHECKING:
    from tactsim.core.source import Source


def finite_number(text: str) -> float | None:
    """Read a finite number; None if `text` is not one."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def share(option: str, text: str) -> float:
    """Read a share such as 75%, or .75. Raises InputError for one that is not above 0, at most 1."""
    number = finite_number(text.removesuffix("%"))
    found = 0.0 if number is None else number / (100 if text.endswith("%") else 1)
    if not 0 < found <= 1:
        raise InputError(f"{option} {text!r}: give a share above 0 %, at most 100 %, such as 75%")
    return found


def number(help: str, *, least: float | None = None, most: float | None = None, **words: Any) -> Any:
    """Describe an option that takes a finite number, from `least` to `most` where they are given.

    words: what else `typer.Option` takes. Its own bounds alone would let infinity pass, and say of NaN that it is
    too small or too large.
    """
    among = (
        "" if least is None else f" of at least {least:g}" if most is None else f" from {least:g} to {most:g}"
    )

    def read(typed: Any) -> float:
        from pydantic_core import PydanticCustomError

        value = finite_number(str(typed))
        if value is None or (least is not None and value < least) or (most is not None and value > most):
            raise PydanticCustomError(
                "number", "give a finite number{among}, not {given}", {"among": among, "given": short(typed)}
            )
        return value

    return typer.Option(parser=read, min=least, max=most, help=help, **words)


ScanSet = Annotated[
    list[str] | None,
    typer.Option(
        "--scan-set", help="Any option of the scan, e.g. press.force=5; `bench list scan-options` names them."
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all randomness.")]
Jobs = Annotated[int, typer.Option(min=1, help="Processes; the results do not depend on their number.")]
Cache = Annotated[
    bool,
    typer.Option("--cache/--no-cache", help="Take pressed readings from the cache, and keep them there."),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else there.")
]
Zero = Annotated[
    str,
    typer.Option(
        help="What taxels read at rest: a number, auto to find the level and the sign of each taxel in the "
        "readings, or off."
    ),
]
IdleFile = Annotated[
    Path | None,
    typer.Option(
        "--idle",
        help="Readings of the untouched pad instead: a recording, a table with a column a taxel, or a .npy file.",
    ),
]
Shapes = Annotated[
    list[Path] | None,
    typer.Option(
        "--shape",
        help="The shape of the object that is called like the file: its centre, inertia and symmetry count in "
        "placement errors; repeat for several.",
    ),
]
Licence = Annotated[
    str | None,
    typer.Option(help="The scan's licence by its SPDX name, like CC-BY-4.0, if it does not state its own."),
]
# Of objects in space, which `bench run` and `bench scan` have with --task solids.
SOLIDS_PANEL = "Objects in space (--task solids)"
OUTSIDE = (
    "is for objects in space; add --task solids, or leave it out"  # of an option, where the task is another
)
Objects = Annotated[
    str | None,
    typer.Option(
        help="Which objects: bolt,nut,key, or 30 for the first thirty (of 50), or none beside shapes. Default: 12.",
        rich_help_panel=SOLIDS_PANEL,
    ),
]
Touches = Annotated[int | None, typer.Option(help="Touches a trial (20).", rich_help_panel=SOLIDS_PANEL)]
Hand = Annotated[
    Path | None,
    typer.Option(
        help="Several pads that touch at once: gripper, or a hand file (.toml).", rich_help_panel=SOLIDS_PANEL
    ),
]


def idle_frames(path: Path | None, opened: Callable[[Path], Source] | None = None) -> Any:
    """Read idle readings (n, taxels) from a table of text, also a recording with times, or a .npy file.

    opened: opens recordings of the pad, read in its order and unit, of which the first 10,000 readings are taken.
    Raises InputError if it is neither.
    """
    if path is None:
        return None
    import numpy as np

    from tactsim.core.documents import LARGE, read_text
    from tactsim.core.source import SourceError
    from tactsim.hardware.codecs.codec import CodecError, Frame
    from tactsim.hardware.codecs.pps_csv import read_table
    from tactsim.hardware.text_tables import numbers_of

    try:
        if path.suffix.lower() == ".npy":
            frames = np.load(path, allow_pickle=False).astype(float)
            return frames.reshape(len(frames), -1) if frames.ndim > 2 else frames
        if opened is not None:
            with suppress(SourceError), opened(path) as source:
                if read := [reading.pressures for reading in islice(source, 10_000)]:
                    return np.array(read)
        text = read_text(path, "idle readings", LARGE)
        with suppress(CodecError):
            _, recorded, _ = read_table(text.splitlines())
            return np.array([frame.values for frame in recorded if isinstance(frame, Frame)])
        return numbers_of(text)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"--idle {path}: no table of numbers with a column a taxel ({error})") from error


def window(text: str) -> tuple[int, int]:
    """Read a window written as ROWSxCOLUMNS. Raises InputError for another text."""
    from tactsim.bench.config import whole_number

    rows, columns = (whole_number(word) for word in text.partition("x")[::2])
    if rows is None or columns is None:
        raise InputError(f"--cut {text!r}: write it as ROWSxCOLUMNS, like 5x5")
    return rows, columns
