"""Do runs in a process of its own, with limits: a method that crashes, hangs or eats memory becomes a status.

`limited_runs` starts this module as the other process. It reads which runs and trials are wanted (request.json in a
folder of its own), leaves the folder of each run there, and says on its standard output, a JSON object a line, how far
it is. It is no fence: a method may do there what the user may.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from threading import Thread
from typing import IO, Any

from tactsim.bench import experiment, results
from tactsim.bench.config import run_config
from tactsim.bench.results import Run
from tactsim.bench.trials import OneTrial, Progress
from tactsim.core import InputError
from tactsim.core.errors import printable

_KEPT = 4000  # characters of what a method prints, the last
_LONGEST = 500  # characters of a status


@dataclass(frozen=True)
class Limits:
    """What a method may take: seconds by the clock for what comes before its first trial, and for a trial; memory.

    With several jobs trials end in batches, and a batch may take `fit_s`. memory_mb: MB beside Python and the
    libraries, where the system keeps such a limit; macOS and Windows do not.
    """

    fit_s: float = 1800.0
    trial_s: float = 300.0
    memory_mb: int = 4000


@dataclass(frozen=True)
class Wanted:
    """A run that is wanted: the words of its configuration, and which trials (letter, number); None for all."""

    words: Mapping[str, Any]
    trials: Sequence[tuple[str, int]] | None = None


class NoScore(Exception):
    """A method that failed: its status, in one line, and the last that it printed."""

    def __init__(self, status: str, output: str = "") -> None:
        super().__init__(status)
        self.status, self.output = printable(" ".join(status.split()))[:_LONGEST], output


def limited_runs(
    wanted: Sequence[Wanted],
    *,
    jobs: int = 1,
    cache: bool = True,
    limits: Limits | None = None,
    progress: Progress = experiment.silent,
) -> list[Run]:
    """Do runs in another process. progress("sweep", done, total) counts the trials of all runs.

    Raises InputError for what is wrong before a run's trials begin, and NoScore if the method fails.
    """
    limits = limits or Limits()
    with TemporaryDirectory(prefix="tactsim-") as name:
        folder = Path(name)
        request: dict[str, Any] = {"jobs": jobs, "cache": cache, "memory_mb": limits.memory_mb}
        request["runs"] = [asdict(one) for one in wanted]
        (folder / "request.json").write_text(json.dumps(request), encoding="utf-8")
        # What this process can import, a plug-in for one, the other can too.
        importable = os.pathsep.join(str(Path(place).absolute()) for place in sys.path)
        with (folder / "printed").open("w+b") as printed:
            process = subprocess.Popen(
                [sys.executable, "-m", __name__, name],
                stdin=subprocess.PIPE,  # closed when this process ends, however it does; the other one then ends too
                stdout=subprocess.PIPE,
                stderr=printed,
                start_new_session=True,
                env=os.environ | {"PYTHONPATH": importable},
            )
            try:
                ended = _followed(process, wanted, jobs, limits, progress)
            finally:
                _kill(process)
            printed.seek(max(0, printed.seek(0, os.SEEK_END) - _KEPT))
            output = printed.read().decode(errors="replace")
        if "refused" in ended:
            raise InputError(ended["refused"])
        if "status" in ended:
            raise NoScore(ended["status"], output)
        return [Run.load(folder / str(number)) for number in range(len(wanted))]


def _followed(
    process: subprocess.Popen[bytes], wanted: Sequence[Wanted], jobs: int, limits: Limits, progress: Progress
) -> dict[str, Any]:
    """Follow what the process says until it ends or is too late; returns the last that it said."""
    assert process.stdout is not None
    lines: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_read, args=(process.stdout, lines), daemon=True).start()
    said: dict[str, Any] = {"run": 0, "stage": "fit", "done": 0, "total": 0}
    while True:
        on_trial = said["stage"] == "trials" and said["done"] < said["total"]
        seconds = limits.trial_s if on_trial and jobs == 1 else limits.fit_s
        try:
            line = lines.get(timeout=seconds)
        except Empty:
            what = ("a trial" if jobs == 1 else "a batch of trials") if on_trial else "fit"
            return {"status": f"timed out: {what} took more than {seconds:g} s{_place(said)}"}
        if not line:
            return {"status": f"crashed: {_how_it_ended(process)}{_place(said)}"}
        try:
            answer = json.loads(line)
        except ValueError:
            return {"status": f"crashed: its process answered what it should not{_place(said)}"}
        if "status" in answer:
            return {"status": answer["status"] + _place(said)}
        if "stage" not in answer:
            return answer
        said = answer
        if said["stage"] == "trials":
            # Where all trials of a run are wanted, there are as many as in this one.
            counts = [said["total"] if one.trials is None else len(one.trials) for one in wanted]
            progress("sweep", sum(counts[: said["run"]]) + said["done"], sum(counts))


def _place(said: Mapping[str, Any]) -> str:
    return f"; run {said['run']}, after {said['done']} of {said['total']} trials" if said["total"] else ""


def _read(stream: IO[bytes], lines: SimpleQueue[bytes]) -> None:
    for line in stream:
        lines.put(line)
    lines.put(b"")


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End the process and those that it started, whatever they do; it is waited for."""
    with suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()
    assert process.stdin is not None
    process.stdin.close()


def _how_it_ended(process: subprocess.Popen[bytes]) -> str:
    try:
        ended = process.wait(5)
    except subprocess.TimeoutExpired:
        return "it closed what it was to answer through"
    if ended >= 0:
        return f"its process ended by itself, with status {ended}"
    name = signal.Signals(-ended).name
    more = "; the system may have run out of memory" if name == "SIGKILL" else ""
    return f"its process was ended by {name}{more}"


# ---- in the other process


def _do(folder: Path, tell: IO[str]) -> None:
    request = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    stage = "fit"

    def say(**words: Any) -> None:
        tell.write(json.dumps(words) + "\n")
        tell.flush()

    def report(at: str, done: int, total: int) -> None:
        nonlocal stage
        stage = at
        # A run's progress; where this one is not at its trials there is nothing to count.
        say(run=number, stage=at, done=done if at == "trials" else 0, total=total if at == "trials" else 0)

    _limit_memory(request["memory_mb"])
    try:
        for number, wanted in enumerate(request["runs"]):
            stage = "fit"
            trials = wanted["trials"] and [OneTrial(letter, count) for letter, count in wanted["trials"]]
            asked, how = run_config(**wanted["words"]), {name: request[name] for name in ("jobs", "cache")}
            run = experiment.perform(asked, trials=trials, progress=report, **how)
            (folder / str(number)).mkdir()
            results.save(run, folder / str(number))
    except MemoryError:
        say(status=f"out of memory: it takes more than {request['memory_mb']:,} MB")
    except InputError as error:
        if stage in ("map", "trials"):
            say(status=f"crashed: {_in_one_line(error)}")
        else:
            say(refused=str(error))
    except BaseException as error:
        traceback.print_exc()
        say(status=f"crashed: {_in_one_line(error)}")
    else:
        say(finished=True)


def _limit_memory(megabytes: int) -> None:
    """Let this process and those that it starts take so much memory more than it takes now, where the system can."""
    pages = Path("/proc/self/statm")
    if not pages.exists():
        return
    import resource

    taken = int(pages.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    most = taken + megabytes * 1_000_000
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _in_one_line(error: BaseException) -> str:
    said = " ".join(str(error).split())[:300]
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename != __file__]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}{': ' * bool(said)}{said}{place}"


def _end_with_parent(stream: IO[bytes]) -> None:
    stream.read()
    os._exit(1)


def main() -> None:
    """Do what the folder asks that is named on the command line."""
    # What a method prints goes where its errors go; standard input and output are between the two processes.
    tell = os.fdopen(os.dup(1), "w", encoding="utf-8")
    parent = os.fdopen(os.dup(0), "rb")
    os.dup2(2, 1)
    with open(os.devnull, "rb") as nothing:  # noqa: PTH123
        os.dup2(nothing.fileno(), 0)
    Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    _do(Path(sys.argv[1]), tell)
    tell.close()
    os._exit(0)  # freeing every object first takes half a second


if __name__ == "__main__":
    main()
