"""`bench align`: find how presses lie of which nobody noted the poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.words import refuse_typed
from tactsim.bench.config import whole_number
from tactsim.core.errors import InputError


def command(
    context: typer.Context,
    scan: Annotated[Path, typer.Argument(help="A scan of presses that each hold most of an object.")],
    out: Annotated[Path, typer.Option(help="The scan to write, .npz, for `bench run --scan`.")],
    poses: Annotated[
        Literal["unknown"] | None,
        typer.Option(help="Withhold the poses that the scan states, to see what is found without them."),
    ] = None,
    cut: Annotated[str | None, typer.Option(help="Then cut presses into small touches, like 6x6.")] = None,
    stride: Annotated[int, typer.Option(min=1, help="Taxels from one cut to the next.")] = 1,
    touching: Annotated[
        str | None, typer.Option(help="Keep cuts of which so many taxels at least read more than that: 3:24.")
    ] = None,
    as_json: shared.AsJson = False,
) -> None:
    """Find how presses lie of which nobody noted the poses, by laying those of each object over each other."""
    import json

    from tactsim.bench.console import kept_clear, plain_console
    from tactsim.bench.pad.alignment import align
    from tactsim.bench.places import check_new_file
    from tactsim.bench.terminal import progress_bars
    from tactsim.core import Scan
    from tactsim.hardware.cutting import cut as cut_scan

    check_new_file(out, scan, suffix=".npz")
    if cut is None:
        refuse_typed(context, ("stride", "touching"), "is of cuts; say how large they are with --cut")
    window = None if cut is None else shared.window(cut)
    least = None if touching is None else _touching(touching)
    read = Scan.load(scan)
    with kept_clear(as_json), progress_bars() as progress:
        made, _ = align(
            read, withheld=poses is not None, progress=lambda done, total: progress("align", done, total)
        )
    if window is not None:
        made = cut_scan(made, *window, stride, least)
    made.save(out)
    said = made.meta["aligned"]
    if as_json:
        typer.echo(json.dumps({"scan": str(out), "readings": len(made), "objects": said}))
        return
    lines = []
    for label, of in said.items():
        counts = " and ".join(map(str, of["presses"]))
        several = f" in {len(of['presses'])} views" if len(of["presses"]) > 1 else ""
        lines.append(
            f"{label}: {counts} presses{several}, which resemble their picture by {of['resemblance']:.2f}"
        )
    if any(len(of["presses"]) > 1 for of in said.values()):
        lines.append(
            "an object of several views lies on one side or on another; two under one label look so, too"
        )
    lines.append(f"{len(made):,} readings, {made.readings.shape[1]} taxels, in {out}")
    plain_console().print("\n".join(lines), soft_wrap=True)


def _touching(text: str) -> tuple[int, float]:
    """Read a count and a reading, COUNT:READING. Raises InputError for another text."""
    count, _, level = text.partition(":")
    taxels, reading = whole_number(count), shared.finite_number(level)
    if not taxels or reading is None:
        raise InputError(f"--touching {text!r}: write it as COUNT:READING, like 3:24")
    return taxels, reading
