"""The command `bench`: its verbs, and how a mistake, an interrupt or a closed pipe ends it."""

from __future__ import annotations

import sys
from concurrent.futures import BrokenExecutor
from typing import NoReturn

import typer
from typer.exceptions import Abort, TyperException

from tactsim.bench.cli import INTERRUPTED, end_interrupted
from tactsim.bench.cli import cmd_bound as bound
from tactsim.bench.cli import cmd_compare as compare
from tactsim.bench.cli import cmd_devices as devices
from tactsim.bench.cli import cmd_emulate as emulate
from tactsim.bench.cli import cmd_list as list_verb
from tactsim.bench.cli import cmd_live as live
from tactsim.bench.cli import cmd_probe as probe
from tactsim.bench.cli import cmd_record as record
from tactsim.bench.cli import cmd_replay as replay
from tactsim.bench.cli import cmd_report as report
from tactsim.bench.cli import cmd_run as run
from tactsim.bench.cli import cmd_scan as scan
from tactsim.bench.cli import cmd_stress as stress
from tactsim.bench.cli import cmd_sweep as sweep
from tactsim.bench.cli import cmd_tare as tare
from tactsim.bench.cli import cmd_template as template
from tactsim.bench.cli import cmd_validate as validate
from tactsim.bench.cli import cmd_watch as watch
from tactsim.core.errors import InputError, printable

FAILED, WRONG_INPUT = 1, 2

app = typer.Typer(
    name="bench",
    help="Compare ways to recognise an object by touch: press, map, recognise, score.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
verbs = {
    "run": run,
    "scan": scan,
    "sweep": sweep,
    "report": report,
    "bound": bound,
    "compare": compare,
    "list": list_verb,
    "stress": stress,
    "devices": devices,
    "probe": probe,
    "watch": watch,
    "live": live,
    "tare": tare,
    "template": template,
    "record": record,
    "replay": replay,
    "emulate": emulate,
    "validate": validate,
}
for name, verb in verbs.items():
    app.command(name=name)(verb.command)


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
        fail(error.format_message())
    except (KeyboardInterrupt, Abort):
        end_interrupted()
    except BrokenPipeError:  # as in `bench list | head`, which stops reading
        sys.stderr.close()
        sys.exit(FAILED)
    if status == INTERRUPTED:
        end_interrupted()
    sys.exit(status if isinstance(status, int) else 0)


def fail(message: str, status: int = WRONG_INPUT) -> NoReturn:
    """Say in one line what went wrong and what would be right, and exit."""
    print(f"bench: {printable(' '.join(message.split()))}", file=sys.stderr)
    sys.exit(status)
