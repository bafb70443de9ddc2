"""Show a run on the terminal: its progress, then its headline, a table and the places of its files."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from tactsim.bench.console import plain_console, plain_table
from tactsim.bench.results import Run, picture_names, task_name
from tactsim.bench.runs import paper
from tactsim.bench.score import figures
from tactsim.bench.trials import Progress as Report
from tactsim.core.errors import counted
from tactsim.core.provenance import poses_unknown

STAGES = {
    "press": "pressing",
    "map": "mapping",
    "fit": "fitting",
    "trials": "trials",
    "sweep": "trials",
    "replay": "replaying",
    "bound": "bounding",
    "references": "estimators",
}
ROWS = (1, 2, 3, 5, 7, 9, 10, 12, 15, 20, 25, 30, 40, 46, 50, 60, 80, 100, 150, 192)
SHORT = (1, 2, 3, 5, 10, 20)  # and the last
LINE_EVERY = 10.0  # s, between the lines of progress where there is no terminal to draw bars on


@contextmanager
def progress_bars() -> Iterator[Report]:
    """Show how far every stage is on standard error: bars with the time left, or without a terminal plain lines."""
    console = plain_console(stderr=True)
    with _bars(console) if console.is_terminal else _lines(console) as report:
        yield report


@contextmanager
def _bars(console: Console) -> Iterator[Report]:
    bars: dict[str, TaskID] = {}
    columns = (
        TextColumn("{task.description:10}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    display = Progress(*columns, console=console)

    def report(stage: str, done: int, total: int) -> None:
        if not bars:
            display.start()  # not before: a display without bars leaves an empty line
        if stage not in bars:
            bars[stage] = display.add_task(STAGES.get(stage, stage), total=total)
        display.update(bars[stage], completed=done, total=total)

    try:
        yield report
    finally:
        if bars:
            display.stop()


@contextmanager
def _lines(console: Console) -> Iterator[Report]:
    """Write a line at each stage's end and every LINE_EVERY seconds, also while nothing new is reported."""
    start, ended = monotonic(), Event()
    latest: list[tuple[str, int, int]] = []
    began: dict[str, tuple[float, int]] = {}  # when each stage had its first report, and how much was done

    def write() -> None:
        for stage, done, total in latest:
            line, now = f"{STAGES.get(stage, stage)}: {done:,} of {total:,} done", monotonic()
            first, before = began[stage]
            if before < done < total:
                line += f", about {(now - first) * (total - done) / (done - before):.0f} s left"
            console.print(f"{line}, {now - start:.0f} s since the start")

    def report(stage: str, done: int, total: int) -> None:
        began.setdefault(stage, (monotonic(), done))
        if latest != [(stage, done, total)]:
            latest[:] = [(stage, done, total)]
            if done == total:
                write()

    def repeat() -> None:
        while not ended.wait(LINE_EVERY):
            write()

    writer = Thread(target=repeat, daemon=True)
    writer.start()
    try:
        yield report
    finally:
        ended.set()
        writer.join()


def print_run(run: Run, verbose: bool = False) -> None:
    """Print what was asked, the headline and some rows of readings; if `verbose`, all that is known of the run."""
    console = plain_console()
    how = run.about["description"]
    console.print(run.config["estimator"], style="bold", end=" " if how else "\n")
    if how:
        console.print(how)
    task = f"task {run.task}; " if run.task not in (None, run.kind.name) else ""
    asked, done = run.config["trials"], len(run.trials.truth)
    all_alike = asked != "all" and len(run.letters) > 1 and done == len(run.letters) * asked
    trials = counted(done if asked == "all" else asked, "trial") + (" each" if all_alike else "")
    known = run.plan.scan.where("train").letters if run.plan else ()
    among = f" (among {' '.join(known)})" if set(run.letters) < set(known) else ""
    console.print(f"{task}{' '.join(run.letters)}{among}: {trials}, {run.protocol}, seed {run.seed}")
    # What is pressed, and how, where that is not the default's; letters stand above.
    others = [word for word in task_name(run).split(", ") if not word.startswith(("letters ", "seed "))]
    if not task and others != ["defaults"] and others:
        console.print(f"with {', '.join(others)}")
    for line in headline(run):
        console.print(line, style="bold")
    rows = rows_of(run.readings, ROWS) if verbose else rows_of(run.readings)
    console.print(_table(run, rows, verbose))
    said = f"right: share of the trials that name the {run.thing}"
    if "error_mm" in _known_figures(run, verbose):
        said += "; error: how far from its true place they put it, mean over those named rightly"
    console.print(said)
    k = min(5, run.readings)
    for name in (Path(path).stem for path in run.config.get("shapes") or ()):
        right = run.trials.right[run.trials.truth == name, k - 1]
        if len(right):
            console.print(f"{name}: {right.mean():.2f} right after {k}")
    for line in run.about.get("notes", []):
        console.print(f"note     {line}")
    if run.config.get("bound") and run.about.get("no_bound"):
        console.print(f"no bound of the error: {run.about['no_bound']}")
    if not verbose:
        return
    if "pad_fit" in run.about:
        console.print(_pad_fit(run.about["pad_fit"]))
    for line in details(run):
        console.print(line)


def rows_of(readings: int, wanted: Sequence[int] = SHORT) -> list[int]:
    """Choose the rows of a table over so many readings: those wanted that there are, and the last."""
    return sorted({row for row in (*wanted, readings) if row <= readings})


def headline(run: Run) -> list[str]:
    """Say how often the object is named, how exactly it is placed, and what the paper prints beside."""
    summary, word, readings = run.summary, run.kind.touch, run.readings
    k = min(5, readings)
    low, high = summary["accuracy_low"][k - 1], summary["accuracy_high"][k - 1]
    line = f"right after {counted(k, word)}: {summary['accuracy'][k - 1]:.2f} (95 % interval {low:.2f}-{high:.2f})"
    error = summary["error_mm"][-1]
    lines = [line if error is None else f"{line}; error {error:.2f} mm after {readings}"]
    lines.append(f"every trial right{when(f' from {word}', summary['all_right_from'], f'{word} {readings}')}")
    if run.about.get("alone"):  # which is right whatever it feels
        lines = [] if error is None else [f"error {error:.2f} mm after {readings}"]
        return lines + run.cautions
    printed = paper.beside(run)
    if printed is not None:
        poses = "" if paper.at_its_poses(run) else " and in its training's poses"
        lines[-1] += f"; the paper, on a real pad{poses}: {printed.words}"
    if run.config.get("hold_out"):
        lines.append(_refused(run))
    return lines + run.cautions


def _pad_fit(facts: dict[str, Any]) -> str:
    """Say what was chosen for the pad, and why."""
    chosen = ", ".join(f"{name} {value:.4g}" for name, value in facts["chosen"].items())
    said = f"fitted   {chosen or 'nothing'}; a covered taxel reads {facts['typical_reading']:.4g}"
    if facts["response_exponent"] != 1:
        said += f"; readings are straightened by the power {facts['response_exponent']:g}"
    if (usual := facts["information_default"]) is not None:
        said += f"; a left-out taxel is told {facts['information_chosen']:.3f} nats, {usual:.3f} with the defaults"
    return said


def print_places(run: Run, folder: Path) -> None:
    """Print where the results and pictures of a run are, and what to try next."""
    console = plain_console()
    console.print(f"results  {folder}", soft_wrap=True)
    for picture in picture_names(run):
        console.print(f"picture  {folder / picture}", soft_wrap=True)
    report = f"bench report {shlex.quote(str(folder))}  # one page: how sure it is, what it mixes up, a trial"
    for line in (report, *run.kind.nexts(run)):
        console.print(f"next     {line}", soft_wrap=True)


def details(run: Run) -> list[str]:
    """Say in a few lines when the letters were right, how sure the estimator was, how fast and with how much work."""
    summary, word = run.summary, run.kind.touch
    last = f"{word} {run.readings}"
    return [
        f"95 % of the trials right and staying so{when(' by', summary['settled_95'], last)}, half"
        f"{when(' by', summary['settled_50'], last)} "
        f"({counted(len(run.trials.truth), 'trial')})",
        *run.kind.details(run),
        f"work  {work_line(run.work)}",
    ]


def _refused(run: Run) -> str:
    """Say how often letters that it never learned were taken for none of those it knows, and those that it knows."""
    known, unknown = run.summary["refused_known"][-1], run.summary["refused_unknown"][-1]
    of = f"trials of {', '.join(run.config['hold_out'])}, {known or 0:.0%} of the others"
    if known is None:
        of = "trials, in each of which the letter itself is not known"
    # Only maps tell that it is none of them, and maps need poses.
    asks = not run.about["options"].get("unknown") and not poses_unknown(run.about["scan"])
    more = "; `--set unknown=0.5` lets `stacked` say so" if asks else ""
    return f"taken for none of the known letters at reading {run.readings}: {unknown:.0%} of the {of}{more}"


def work_line(work: Mapping[str, Any]) -> str:
    """Write counts of work, and of what was skipped by reason, as one line."""

    def listed(counts: Mapping[str, Any]) -> str:
        return ", ".join(
            f"{'from the cache' if name == 'cached' else name.replace('_', ' ')} {count:,}"
            for name, count in counts.items()
            if count
        )

    done = listed({name: count for name, count in work.items() if isinstance(count, int)})
    skipped = listed(work["skipped"])
    return (done or "nothing new") + (f"; skipped: {skipped}" if skipped else "")


def _table(run: Run, rows: Sequence[int], verbose: bool) -> Table:
    """Lay out some readings or touches: the share that is right, its interval, and what else is known of them."""
    values, shown = {**run.summary, **run.against_bound}, _known_figures(run, verbose)
    known = figures(run.kind.name)
    heads = (run.kind.touches, known["accuracy"].column, "95 % interval")
    table = plain_table(*heads, *(known[name].column for name in shown), words=0)
    for row in rows:
        k = row - 1
        table.add_row(
            str(row),
            f"{values['accuracy'][k]:.3f}",
            f"{values['accuracy_low'][k]:.3f} - {values['accuracy_high'][k]:.3f}",
            *(number(values[name][k], known[name].digits or 0) for name in shown),
        )
    return table


def _known_figures(run: Run, verbose: bool) -> list[str]:
    """List the figures of a run's table; none is of the place where nothing is placed."""
    values = {**run.summary, **run.against_bound}
    return [name for name in run.kind.table(run, verbose) if any(value is not None for value in values[name])]


def number(value: float | None, digits: int) -> str:
    """Write a figure of a table, or that there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def when(word: str, number: int | None, last: str) -> str:
    """Say after a word from which reading or touch on something holds, or that it does not hold by the last."""
    return f"{word} {number}" if number is not None else f": not yet by {last}"
