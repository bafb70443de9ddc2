"""What a run with objects in space prints: a table over the touches, and the headline figures."""

from __future__ import annotations

from rich.table import Table

from tactsim.bench.console import plain_console
from tactsim.bench.space.space_run import SpaceRun
from tactsim.bench.terminal import print_method, when, work_line
from tactsim.core.errors import counted

_ROWS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 30, 40, 60, 100)


def print_space_run(run: SpaceRun) -> None:
    """Print the table over the touches, the headline figures and the times."""
    console, config, summary = plain_console(), run.config, run.summary
    print_method(console, run)
    console.print(
        f"{' '.join(run.about['objects'])}: {counted(len(run.trials.truth), 'trial')}, "
        f"{run.about['protocol']}, seed {config['seed']}"
    )
    table = Table(box=None, pad_edge=False)
    for heading in ("touches", "right", "95 % interval", "mm", "median", "degrees", "median", "90 % held"):
        table.add_column(heading, justify="right", no_wrap=True)
    for touch in sorted({row for row in (*_ROWS, run.touches) if row <= run.touches}):
        at = {name: summary[name][touch - 1] for name in summary if isinstance(summary[name], list)}
        table.add_row(
            str(touch),
            f"{at['accuracy']:.3f}",
            f"{at['accuracy_low']:.3f} - {at['accuracy_high']:.3f}",
            _number(at["error_mm"], 2),
            _number(at["error_median_mm"], 2),
            _number(at["angle_deg"], 1),
            _number(at["angle_median_deg"], 1),
            _number(at["coverage_90"], 2),
        )
    console.print(table)
    for line in headlines(run):
        console.print(line)


def headlines(run: SpaceRun) -> list[str]:
    """Say in a few lines when the objects were right, what was hard, how fast and with how much work."""
    summary, seconds = run.summary, run.times["seconds"]

    last = f"touch {run.touches}"
    hard = sorted(summary["by_object"].items(), key=lambda item: item[1]["accuracy"])[:3]
    return [
        f"every trial right{when(' from touch', summary['all_right_from'], last)}; 95 % settled"
        f"{when(' by', summary['settled_95'], last)}, half{when(' by', summary['settled_50'], last)}",
        f"lowest accuracy at touch {run.touches}: "
        + ", ".join(f"{label} {values['accuracy']:.2f}" for label, values in hard),
        f"{100 * sum(summary['met']) / run.touches:.0f} % of the touches met the object",
        f"time  scan {seconds['scan']:.2f} s, fit {seconds['fit']:.2f} s, trials {seconds['trials']:.2f} s; a "
        f"recognition of {run.touches} touches {seconds['recognition']:.2f} s of one core, at most "
        f"{seconds['recognition_most']:.2f} s",
        f"work  {work_line(run.work)}",
    ]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
