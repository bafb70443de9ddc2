"""`bench scan`: press the letters and write the readings."""

from __future__ import annotations

from pathlib import Path

import typer

from tactsim.bench import kinds
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import Words, dotted, is_typed, refuse_typed, with_options_of
from tactsim.bench.config import ScanWords, scan_options, slip_of_world


@with_options_of(ScanWords)
def command_scan(
    words: Words,
    context: typer.Context,
    out: Path = typer.Option(..., help="The file to write, .npz."),
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    sequence: bool = typer.Option(
        False,
        "--sequence",
        help="Keep the images of every press on its way to rest; press.dynamics must be full.",
    ),
    task: str | None = typer.Option(
        None,
        metavar="solids",
        help="Touch objects in space instead of letters in the plane.",
        rich_help_panel=shared.SOLIDS_PANEL,
    ),
    objects: shared.Objects = None,
) -> None:
    """Press the letters at 192 poses, twice (training and test), and write the readings."""
    from tactsim.bench.console import plain_console
    from tactsim.bench.places import check_new_file
    from tactsim.bench.terminal import progress_bars, work_line
    from tactsim.press import scan_letters

    check_new_file(out, suffix=".npz")
    if task is not None:
        refuse_typed(context, ["sequence"], "is for letters in the plane; leave it out with --task solids")
        typed = {name: value for name, value in words.items() if is_typed(context, name)}
        if objects is not None:
            typed["objects"] = objects
        kind = kinds.load(task)
        with progress_bars() as progress:
            scan, work = kind.scanned(typed, jobs=jobs, cache=cache, progress=progress)
        scan.save(out)
        plain_console().print(
            f"{len(scan):,} {kind.touches} of {' '.join(scan.letters)}, {scan.readings.shape[1]} taxels, in {out}\n"
            f"work  {work_line(work)}"
        )
        return
    refuse_typed(context, ["objects"], shared.OUTSIDE)
    options = scan_options(**words)
    with progress_bars() as progress:
        scan, work = scan_letters(
            options,
            jobs=jobs,
            cache=cache,
            sequence=sequence,
            progress=lambda done, total: progress("press", done, total),
        )
    scan.save(out)
    lines = [
        f"{len(scan):,} readings of {' '.join(scan.letters)}, {scan.readings.shape[1]} taxels, in {out}",
        f"work  {work_line(work)}",
    ]
    if "settle_time" in work:
        median, longest = (1e3 * work["settle_time"][name] for name in ("median", "longest"))
        lines.append(
            f"settled {median:.0f} ms after touch (median; longest {longest:.0f} ms), overshoot at most "
            f"{100 * work['overshoot']:.1f} %"
        )
    slip = slip_of_world(words.get("world", "default"))
    if not slip.still:
        given = " ".join(f"--slip {word}" for word in dotted(slip.model_dump(exclude_defaults=True)))
        lines.append(f"the world's slip is in no reading: `bench run --scan {out} {given}` moves the object")
    if scan.sequence_times is not None:
        lines.append(f"{len(scan.sequence_times):,} images of each press, {scan.sequence_times[-1]:.3f} s")
    plain_console().print("\n".join(lines))
