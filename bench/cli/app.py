"""The command `bench`: its verbs, and how a mistake, an interrupt or a closed pipe ends it."""

from __future__ import annotations

import errno
import re
import select
import sys
import traceback
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import Abort, TyperException

from tactsim.bench.cli import INTERRUPTED, end_interrupted
from tactsim.core.errors import InputError, printable, short, unknown, was_interrupt

FAILED, WRONG_INPUT = 1, 2

# Each verb with what `bench --help` says of it, the first line of its docstring: importing all verbs would take
# longer than saying it.
VERBS = {
    "run": "Press the letters, learn their maps, recognise them in random places and score every reading.",
    "scan": "Press the letters at 192 poses, twice (training and test), and write the readings.",
    "sweep": "Do many runs; a sweep that was stopped goes on where it was when it is started again.",
    "report": "Write one HTML page that opens without a network; beside it curves as CSV, and figures as PDF and SVG.",
    "table": "Print the figures of runs with their intervals, as Markdown, LaTeX or CSV; seeds are pooled.",
    "export": "Write a scan, or the trials of a run, in a format of others: Parquet, MCAP or HDF5.",
    "import": "Make a scan of what `bench export` wrote, bit for bit, of arrays (.npz, .mat) or of presses in a CSV.",
    "data": "List public recordings of real pads, or `get` one: download, check and import it as a scan.",
    "align": "Find how presses lie of which nobody noted the poses, by laying those of each object over each other.",
    "fit": "Choose what depends on a pad's unit, pitch and response from training readings alone, and say why.",
    "bound": "Say how good an estimator can be: exact Bayes, and the Cramer-Rao bound of the error, by reading.",
    "compare": "Compare two runs on the same trials; exit status 1 if NEW is worse beyond the interval.",
    "submit": "Do all runs of a task with a method, and write one file that others can check; exit status 1 without a "
    "score.",
    "verify": "Do some trials of a bundle again and compare them; exit status 1 if it cannot be confirmed.",
    "leaderboard": "Rank the methods of a folder of bundles, task by task, and write a site of static pages.",
    "list": "List estimators, letters, solids, worlds, metrics, suites and formats, or options of one or of a scan.",
    "tasks": "List the frozen tasks with sizes and the best known results, or show one whole; --hash presses its data.",
    "stress": "Vary inputs over many decades and measure the worst deviation; exit status 1 if a case fails.",
    "devices": "List ports, sources of readings, codecs and device files, each with its status.",
    "probe": "Listen to a pad: show its rate, counters and mean reading, or the bytes that came if no reading did.",
    "watch": "Watch a pad: pressures, force, rate and what goes wrong; f freezes the picture, t takes a tare.",
    "live": "Recognise what is pressed, touch by touch; says which letter, where, and where to press next.",
    "tare": "Calibrate a pad: nothing may touch it, or, with --load, an even load must lie on it.",
    "template": "Print the pad's sheet and one for each letter, 1:1, with the positions and angles of the scan.",
    "record": "Record a pad: with --letter a guided session that makes a scan, else all it says.",
    "replay": "Read recordings again, bit for bit: show what they hold, make a scan or a table of them.",
    "emulate": "Present a simulated pad as a device that speaks its codec's bytes, or record one with --plan.",
    "new": "Make a repository of your own for an estimator, a task or a source, with its tests and its workflow.",
    "validate": "Compare a simulated with a recorded scan: readings, sensor parameters, classes, recognition.",
}


# The same verbs, as `bench --help` groups them.
GROUPS = {
    "Recognise": ("run", "scan", "sweep", "report", "table", "compare", "bound", "fit"),
    "Data": ("export", "import", "data", "align"),
    "Tasks and the leaderboard": ("tasks", "submit", "verify", "leaderboard"),
    "A pad": (
        "devices", "probe", "tare", "template", "record", "replay", "emulate", "watch", "live", "validate",
    ),
    "Look up and extend": ("list", "new", "stress"),
}  # fmt: skip


class _Carried(Exception):
    """Carries an error past Typer."""

    def __init__(self, error: Exception) -> None:
        self.error = error


class _Verbs(TyperGroup):
    """All verbs; the file of one, `cmd_*`, is imported when it is called."""

    def __init__(self, **words: Any) -> None:
        super().__init__(**words)
        self.commands = {
            name: TyperCommand(name, help=VERBS[name], rich_help_panel=group)
            for group, names in GROUPS.items()
            for name in names
        }

    def invoke(self, ctx: Any) -> Any:
        """Call a verb. Typer would take some errors for a closed terminal: they pass it as `_Carried`."""
        try:
            return super().invoke(ctx)
        except (EOFError, BrokenPipeError) as error:
            raise _Carried(error) from error

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the verb that is called, and import it."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, command and load(str(name)), rest


def load(name: str) -> TyperCommand:
    """Import one of `VERBS`, with its options."""
    alone = typer.Typer(add_completion=False)
    alone.command(name)(import_module(f"tactsim.bench.cli.cmd_{name}").command)
    made = typer.main.get_command(alone)
    assert isinstance(made, TyperCommand)
    return made


app = typer.Typer(
    name="bench",
    cls=_Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _say_version(asked: bool) -> None:
    """Print the versions that a result depends on, a line each, and end."""
    if asked:
        from tactsim.bench.machine import versions

        found = versions()
        for name in sorted(found, key=lambda name: name != "tactsim"):
            typer.echo(f"{name} {found[name]}")
        raise typer.Exit


@app.callback()
def _bench(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_say_version,
            is_eager=True,
            help="Print the versions of tactsim and its libraries.",
        ),
    ] = False,
) -> None:
    """Compare ways to recognise an object by touch: press, map, recognise, score."""


def run_app() -> NoReturn:
    """Run the command line; a user's mistake is one line on standard error and exit status 2."""
    try:
        status = app(standalone_mode=False, prog_name="bench")
    except InputError as error:
        fail(str(error))
    except MemoryError as error:
        fail(f"not enough memory: {error}; ask for fewer bins, particles, letters or taxels")
    except BrokenExecutor:
        fail(
            "a worker process died; it was killed or ran out of memory; nothing half-written was kept; "
            "start again, perhaps with fewer --jobs",
            FAILED,
        )
    except TyperException as error:
        fail(_in_plain_words(error) + _settings(error))
    except (KeyboardInterrupt, Abort):
        end_interrupted()
    except SystemError as error:
        if not was_interrupt(error):
            raise
        end_interrupted()
    except _Carried as carried:
        if not (isinstance(carried.error, BrokenPipeError) and _nobody_reads()):
            raise carried.error from None
        sys.stderr.close()  # as in `bench list | head`, which stops reading
        sys.exit(FAILED)
    except OSError as error:
        if error.errno != errno.ENOSPC or not _of_printing(error):
            raise
        fail("cannot write to standard output: the disk is full")
    if status == INTERRUPTED:
        end_interrupted()
    sys.exit(status if isinstance(status, int) else 0)


def _nobody_reads() -> bool:
    """Tell whether standard output or standard error is a pipe that nobody reads any more.

    Windows does not say; an error of a broken pipe is taken for theirs there.
    """
    if not hasattr(select, "poll"):
        return True
    watched = select.poll()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # it is no file, or closed
            watched.register(stream.fileno(), 0)
    return any(found & (select.POLLERR | select.POLLHUP) for _, found in watched.poll(0))


def _of_printing(error: BaseException) -> bool:
    """Tell whether an error was raised where words are printed."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    name = str(frame.f_globals.get("__name__"))
    return name.partition(".")[0] in ("rich", "typer") or name.startswith("tactsim.bench.")


def _in_plain_words(error: TyperException) -> str:
    """Say which option is wrong, and in our words what would be right where the model of its type says it."""
    from pydantic import ValidationError

    from tactsim.core.checking import plain

    if isinstance(error.__cause__, ValidationError):
        fault = error.__cause__.errors()[0]
        given = "" if fault["type"] == "number" else f", got {short(fault['input'])}"  # which `number` says
        error.message = f"{plain(fault)}{given}"
        if choices := fault["msg"].partition(" is not one of ")[2]:  # as Typer says of a choice
            error.message = str(unknown("word", fault["input"], re.findall("'(.*?)'", choices)))
    return error.format_message()


def _settings(error: TyperException) -> str:
    """Say how an estimator's options are given, where a verb that takes them does not know an option."""
    context = getattr(error, "ctx", None)
    if context is None or not hasattr(error, "option_name"):
        return ""
    takes = any("--set" in one.opts for one in context.command.params)
    return ". An estimator's own options: --set NAME=VALUE" if takes else ""


def fail(message: str, status: int = WRONG_INPUT) -> NoReturn:
    """Say in one line what went wrong and what would be right, and exit."""
    print(f"bench: {printable(' '.join(message.split()))}", file=sys.stderr)
    sys.exit(status)
