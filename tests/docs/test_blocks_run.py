"""Every block that a reader may type in runs, a page's blocks one after the other in a folder of its own.

Commands are given less work: few letters, a third of a scan's angles, one trial of three readings, one run for each
method of a sweep, no pictures of a run. What is then the same as on a page before, and leaves no file behind, is not
run again. Only what a page shows with its output (```console) is run as it stands, and must print what is shown.
"""

import re
import signal
import subprocess
import sys
import tomllib
from collections import Counter
from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import pytest
from pages import BLOCKS, SHELL, bench, commands
from small_runs import draw_nothing

from tactsim.bench.cli.app import app

BENCH = Path(sys.executable).parent / "bench"
RUN_PAGES = list(dict.fromkeys(b.page for b in BLOCKS if b.language in ("python", *SHELL) or b.file))
# Whole sweeps, each of which starts processes, many fits, recordings of a pad: half a minute each. README.md,
# docs/first-run.md and docs/hardware.md have one or another of them.
SLOW = {"docs/results.md", "docs/estimators.md", "docs/recordings.md"}
# A second of processor time and more.
LONG = {
    "README.md", "docs/attach.md", "docs/bound.md", "docs/data.md", "docs/first-run.md", "docs/hardware.md",
    "docs/objects-in-space.md", "docs/press-by-hand.md", "docs/reference/sweeps.md", "docs/sensor.md",
    "docs/shapes.md", "docs/tasks.md", "docs/your-own.md",
}  # fmt: skip
MARKS = {page: [pytest.mark.slow] for page in SLOW} | {page: [pytest.mark.long] for page in LONG}

# Files that pages name without showing them: a drawing of the reader's own, and those that come as examples.
_EXAMPLES = Path(__file__).parents[2] / "examples"
_PART = (_EXAMPLES / "my-part.svg").read_text(encoding="utf-8")
_HAND = (_EXAMPLES / "hand" / "hand.xml").read_text(encoding="utf-8")
OWN = {"my-part.svg": _PART, "examples/my-part.svg": _PART, "examples/hand/hand.xml": _HAND}

# What is not run, and why; each has the same reason in a comment on its page.
NOT_RUN = {
    ("docs/environment.md", "it needs the folder of the examples"),
    ("docs/attach.md", "your robot is not here"),
    ("docs/your-pad.md", "it asks for a pad"),
    ("docs/data.md", "it downloads"),
    (
        "docs/from-simulation-to-a-pad.md",
        "the recording is another laboratory's, and fitting takes a minute",
    ),
    ("docs/other-tools.md", "zarr is no dependency"),
    ("docs/other-tools.md", "rerun is no dependency"),
    ("results/README.md", "RUN stands for a folder; tests/bench/test_results.py runs these lines on one"),
    (
        "docs/submit.md",
        "a whole task takes minutes; tests/bench/leaderboard/test_submit.py does both with a small one",
    ),
}


def test_what_is_not_run_is_known():
    assert {(block.page, block.not_run) for block in BLOCKS if block.not_run} == NOT_RUN


@pytest.fixture(scope="module")
def done():
    """Remember the commands that were run for a page before."""
    return set()


@pytest.mark.parametrize("page", [pytest.param(page, marks=MARKS.get(page, [])) for page in RUN_PAGES])
def test_a_pages_blocks_run(page, done, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setattr("tactsim.press.scan_poses.ANGLES", 4)
    draw_nothing(monkeypatch)
    for name, text in OWN.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    names = {"__name__": "page"}
    behind = []
    try:
        for block in BLOCKS:
            if block.page == page and not block.not_run:
                run(block, names, behind, done)
    finally:
        for process in behind:
            process.send_signal(signal.SIGINT)
            process.wait(30)


def run(block, names, behind, done):
    """Run one block in the folder that is current; what a block leaves behind, running, is put on a list."""
    if block.file:
        Path(block.file).write_text(block.text, encoding="utf-8")
    elif block.language == "python":
        exec(compile(block.text, f"{block.page}:{block.line}", "exec"), names)
    elif block.language == "toml":
        tomllib.loads(block.text)
    elif block.language == "console":
        compare(block)
    elif block.language == "sh":
        for words in commands(block):
            arguments = bench(words)  # test_commands.py says which other programs there may be
            if arguments is None:
                continue
            less = smaller(arguments)
            if less[0] == "emulate" and "--plan" not in less:
                behind.append(subprocess.Popen([BENCH, *less], stdout=subprocess.PIPE))
                behind[-1].stdout.readline()  # it names the port that it has opened
            elif tuple(less) not in done:
                status = app(less, standalone_mode=False, prog_name="bench")
                assert not isinstance(status, int) or status == 0, f"{block.page}:{block.line}: {arguments}"
                if less[0] in ("run", "bound", "list") and not names_a_file(less):
                    done.add(tuple(less))


def names_a_file(words):
    """Tell whether a command reads a file of its page, or writes one under a name of the page's own."""
    return "--out" in words or any(Path(word.rpartition("=")[2]).exists() for word in words)


def compare(block):
    """Run a block's commands as they stand: what is shown below each of them is printed."""
    for shown in re.split(r"^\$ ", block.text, flags=re.M)[1:]:
        command, _, output = shown.partition("\n")
        words = command.split()
        result = subprocess.run(
            [BENCH, *bench(words)], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
        )
        assert output in result.stdout, f"{block.page}:{block.line}: {command}\n{result.stdout}"


PRESSES = 6  # of each label of a plan
SMALL_SOLIDS = ["--objects", "nut,egg", "--scan-set", "points=12"]


def smaller(arguments):
    """Ask for the same with less work: few letters, trials and readings, the first value of every list."""
    arguments = ["IL0" if word == "A-Z0-9" else word for word in arguments]
    verb, *rest = arguments
    if dict(pairwise(rest)).get("--trials") == "all":  # of a few presses, each once
        return arguments
    if verb in ("run", "bound"):
        if "solids" in rest:
            few = ["--trials", "1", "--touches", "3", *SMALL_SOLIDS]
            return [verb, *without(rest, "--trials", "--touches", "--jobs", "--objects"), *few]
        few = ["--trials", "1", "--readings", "3"]
        if not {"--letters", "--scan", "--task"} & set(rest):
            held_out = dict(pairwise(rest)).get("--hold-out", "")
            few += ["--letters", "I" if verb == "bound" else "IL" + held_out]
        return [verb, *without(rest, "--trials", "--readings", "--jobs"), *few]
    if verb == "scan" and "solids" in rest:
        return [verb, *without(rest, "--objects"), *SMALL_SOLIDS]
    if verb == "scan" and "press.dynamics=full" in rest:  # a press takes a hundred times as long
        return [verb, *without(rest, "--letters"), "--letters", "I"]
    world_of_a_file = dict(pairwise(rest)).get("--world", "").endswith(".toml")  # it says what is pressed
    if verb == "scan" and "--letters" not in rest and not world_of_a_file:
        return [*arguments, "--letters", "IL"]
    if verb == "sweep":
        path = smaller_sweep(rest[0])
        return [verb, str(path), *without(rest[1:], "--jobs"), "--jobs", "1"]
    if verb == "validate":
        return [*arguments, "--trials", "1", "--estimator", "histogram"]
    if verb == "record":
        return [*arguments, "--poses", "random:3"]
    if verb == "emulate" and "--plan" in rest:
        return [
            smaller_plan(word) if before == "--plan" else word for before, word in pairwise(["", *arguments])
        ]
    if verb == "emulate":  # it does not wait
        return [*arguments, "--rate", "200"]
    if verb in ("watch", "live"):
        few = ["--seconds", "0.5"] if verb == "watch" else ["--readings", "1"]
        return [*arguments, *few, *(["--web-port", "0"] if "--web" in rest else [])]
    if (
        verb == "tasks" and "--hash" in rest and not rest[0].endswith(".toml")
    ):  # tests/bench/tasks hashes whole scans
        return [word for word in arguments if word != "--hash"]
    if verb == "stress":
        return [verb, *without(rest, "--tag"), "--case", "frames.wrap"]
    return arguments


def smaller_plan(source):
    """Write a plan with the first presses of each label."""
    heading, *lines = Path(source).read_text(encoding="utf-8").splitlines(keepends=True)
    seen = Counter()
    kept = []
    for line in lines:
        label = line.partition(",")[0]
        seen[label] += 1
        if seen[label] <= PRESSES:
            kept.append(line)
    path = Path("smaller", source)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join([heading, *kept]), encoding="utf-8")
    return str(path)


def smaller_sweep(source):
    """Write a sweep with one small run for each of its tables, under the same name."""
    given = Path(source) if source.endswith(".toml") else files("tactsim.bench") / "suites" / f"{source}.toml"
    table = tomllib.loads(given.read_text(encoding="utf-8"))
    few = {"trials": 1, "readings": 3}
    defaults = table.get("defaults", {})
    few |= {"train_presses": 12} if "train_presses" in defaults else {}  # scans are of four angles here
    of_tasks = any("task" in one for one in (defaults, *table["run"]))
    # A task has letters of its own, and several seeds; a scan of the page's own has labels of its own.
    fewest = {"seed": 0} if of_tasks else {} if "scan" in defaults else {"letters": "IL"}
    lines = ["[defaults]", *map(first, (fewest | defaults | few).items())]
    for one in table["run"]:
        small = (few if "trials" in one else {}) | ({"letters": "IL"} if "letters" in one else {})
        lines += ["[[run]]", *map(first, (one | small).items())]
    path = Path("smaller", Path(str(given)).name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def first(item):
    """Write a key of a sweep with the first of its values."""
    name, value = item
    return f"{name} = {as_toml(value[0] if isinstance(value, list) else value)}"


def as_toml(value):
    if isinstance(value, dict):
        inner = {k: v[0] if isinstance(v, list) else v for k, v in value.items()}
        return "{ " + ", ".join(f"{k} = {as_toml(v)}" for k, v in inner.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(as_toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def without(words, *options):
    """Leave options with one value out."""
    kept, skip = [], False
    for word in words:
        if skip:
            skip = False
        elif word in options:
            skip = True
        elif word.partition("=")[0] not in options:
            kept.append(word)
    return kept
