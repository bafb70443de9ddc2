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
from pathlib import Path
from typing import Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import Abort, TyperException

from tactsim.bench.cli import INTERRUPTED, NOBODY_READS, end_interrupted
from tactsim.core.errors import InputError, printable, short, unknown, was_interrupt

FAILED, WRONG_INPUT = 1, 2

# All verbs, as `bench --help` groups them, and of each its file `cmd_*`.
GROUPS = {
    "Recognise": {
        "run": "run", "scan": "data", "sweep": "results", "report": "results", "table": "results", "runs": "results",
        "compare": "results", "bound": "limits", "fit": "limits",
    },
    "Data": {"export": "data", "import": "data", "data": "data", "align": "data"},
    "Tasks and the leaderboard": {
        "tasks": "tasks", "submit": "tasks", "verify": "tasks", "leaderboard": "tasks",
    },
    "A pad": {
        "devices": "devices", "probe": "devices", "tare": "devices", "template": "record", "record": "record",
        "replay": "replay", "emulate": "emulate", "watch": "live", "live": "live", "validate": "validate",
    },
    "Look up and extend": {"list": "list", "new": "list", "stress": "limits"},
}  # fmt: skip
VERBS = {verb: f"cmd_{place}" for group in GROUPS.values() for verb, place in group.items()}


def said_of(verb: str) -> str:
    """Read from a verb's file the first line of its docstring: importing all verbs would take longer."""
    text = Path(__file__).with_name(f"{VERBS[verb]}.py").read_text(encoding="utf-8")
    of_verb = text.partition(f"\ndef command_{verb}(")[2].partition('\n    """')[2]
    return of_verb.partition("\n")[0].removesuffix('"""')


class _Carried(Exception):
    """Carries an error past Typer."""

    def __init__(self, error: Exception) -> None:
        self.error = error


class _Verbs(TyperGroup):
    """All verbs; the file of one, `cmd_*`, is imported when it is called."""

    def __init__(self, **words: Any) -> None:
        super().__init__(**words)
        pairs = ((name, group) for group, names in GROUPS.items() for name in names)
        self.commands = {name: TyperCommand(name, rich_help_panel=group) for name, group in pairs}

    def list_commands(self, ctx: Any) -> list[str]:
        """Name all verbs, for the help and for completion, which then say what each does."""
        for name, command in self.commands.items():
            command.help = said_of(name)
        return super().list_commands(ctx)

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


_MANY = 30  # options, of a verb whose help shows the first group alone


class _Verb(TyperCommand):
    """A verb, of whose options only lists may be given more than once."""

    whole = False  # whether its help shows every group

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Show the options; of a verb that has many, the first group in a sentence each, the others by name."""
        groups: dict[str, list[str]] = {}
        if len(self.params) > _MANY and not self.whole:
            for one in self.params:
                if panel := getattr(one, "rich_help_panel", None):
                    groups.setdefault(panel, []).append(one.opts[0])
                    one.hidden = True  # type: ignore[attr-defined]
                one.help = (one.help or "").partition(". ")[0].partition("; ")[0]  # type: ignore[attr-defined]
        super().format_help(ctx, formatter)
        for panel, names in groups.items():
            typer.echo(f" {panel}:\n   {' '.join(names)}")
        if groups:
            typer.echo(f" All of them: {ctx.command_path} --help-all")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words after the verb. Raises InputError for an option whose last value would replace another."""
        if "--help-all" in args:
            self.whole, args = True, ["--help"]
        from tactsim.core.checking import another_type  # brings pydantic, which the verb brings, too

        words, _, given = self.make_parser(ctx).parse_args(args=list(args))
        for one in given:
            if given.count(one) > 1 and not getattr(one, "multiple", True):
                raise InputError(f"{one.opts[0]} is given twice; give it once")
        rest = super().parse_args(ctx, args)
        for one in given:  # 10.000 would be ten, of whoever writes ten thousand so
            if (fault := another_type(words[one.name], ctx.params.get(one.name), one.opts[0])) is not None:
                raise InputError(fault)
        return rest


def load(name: str) -> TyperCommand:
    """Import one of `VERBS`, with its options."""
    alone = typer.Typer(add_completion=False)
    file = import_module(f"tactsim.bench.cli.{VERBS[name]}")
    alone.command(name, cls=_Verb)(getattr(file, f"command_{name}"))
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
    version: bool = typer.Option(
        False,
        "--version",
        callback=_say_version,
        is_eager=True,
        help="Print the versions of tactsim and its libraries.",
    ),
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
        died = "a worker process died; it was killed or ran out of memory; nothing half-written was kept"
        fail(f"{died}; start again, perhaps with fewer --jobs", FAILED)
    except TyperException as error:
        said = _in_plain_words(error)
        if not said:  # without a word it has shown what there is
            sys.exit(WRONG_INPUT)
        fail(said + _settings(error).removeprefix("." if said.endswith("?") else ""))
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
        sys.exit(NOBODY_READS)
    except OSError as error:
        if error.errno != errno.ENOSPC or not (error.filename or _of_printing(error)):
            raise
        fail(f"cannot write {error.filename or 'to standard output'}: the disk is full")
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
    return error.format_message().rstrip(".")


def _settings(error: TyperException) -> str:
    """Say how an estimator's options, or those of a scan, are given, where a verb does not know or misses a word."""
    context = getattr(error, "ctx", None)
    if context is None or type(error).__name__ == "BadParameter":
        return ""
    if context.command.name == "bound":
        return ". Of other pads, shapes, noise and seeds: `bench scan`, and its file with --scan"
    takes = any("--set" in one.opts for one in context.command.params)
    own = ". An estimator's own options: --set NAME=VALUE" if takes and hasattr(error, "option_name") else ""
    return f"{own}. `{context.command_path} --help` says what it takes"


def fail(message: str, status: int = WRONG_INPUT) -> NoReturn:
    """Say in one line what went wrong and what would be right, and exit."""
    print(f"bench: {printable(' '.join(message.split()))}", file=sys.stderr)
    sys.exit(status)
