"""Plug-ins that are broken in every way, installed as a user's are: a status in a list, or one sentence."""

import json
import os
import subprocess
import sys
import traceback
from pathlib import Path

import pytest
from command_line import refused

MODULES = {
    "raising": "raise RuntimeError('first line\\nsecond line')",
    "exiting": "import sys; sys.exit(3)",
    "printing": "raise ValueError('\\x1b[31m[bold]red')",
    "lacking": "import a_package_that_nobody_has",
    "wrong": "Thing = 3\nBare = object\ndef function(): ...",
    "halves": """
from tactsim.estimators import Estimator
class Unfinished(Estimator):
    def fit(self, scan): ...
class Whole(Estimator):
    __doc__ = 5
    options_type = dict
    def fit(self, scan): ...
    def reset(self, rng): ...
    def update(self, reading, sensor_in_robot): ...
    def estimate(self): ...
""",
    "guessing": """
import numpy as np
from tactsim.estimators import Estimate, Estimator
class Guessing(Estimator):
    '''Guess; a subclass says how.'''
    maps = ["no map"]
    def fit(self, scan): self.letters = scan.letters
    def reset(self, rng): ...
    def update(self, reading, sensor_in_robot): ...
    def estimate(self):
        even = dict.fromkeys(self.letters, 1 / len(self.letters))
        return Estimate(self.letters[0], even, np.zeros(3))
class Nan(Guessing):
    def estimate(self): return Estimate("I", {"I": float("nan")}, np.zeros(3))
class Faulty(Guessing):
    def update(self, reading, sensor_in_robot): raise KeyError("a bug of the plug-in's")
class Starved(Guessing):
    def fit(self, scan): raise EOFError("weights are empty")
class Ending(Guessing):
    def update(self, reading, sensor_in_robot): raise SystemExit
class Unmade(Guessing):
    def __init__(self, options): raise SystemExit("no licence")
class Talking(Guessing):
    def estimate(self):
        print("hello")
        return super().estimate()
""",
    "described": """
from tactsim.hardware.codecs.codec import CodecFormat
class Unfinished(CodecFormat):
    taxels: int
""",
    "sources": """
from tactsim.core.counters import Counters
from tactsim.core.source import Source
class Bad(Source):
    def __init__(self, device, value):
        self.pad, self.taxel_xy, self.counters, self.value = device.pad, device.pad.taxel_xy, Counters(), value
    def read(self, timeout=None): return self.value
    def close(self): ...
def nothing(places, device, log): return None
def bare(places, device, log):
    source = Bad(device, None)
    del source.counters
    return source
def silent(places, device, log): return Bad(device, None)
def short(places, device, log):
    from tactsim.core.reading import Reading
    return Bad(device, Reading([1.0, 2.0], 0.0))
""",
}
BROKEN = [
    "raising:X", "exiting:X", "printing:X", "lacking:X", "nowhere:X", "wrong:Missing",
    "wrong:Thing",
]  # fmt: skip
ESTIMATORS = [*BROKEN, "wrong:Bare", "wrong:function", "halves:Unfinished", "halves:Whole"]
WORKING = ["guessing:Guessing", "guessing:Nan", "guessing:Faulty"]
WORKING += ["guessing:Ending", "guessing:Unmade", "guessing:Talking", "guessing:Starved"]
CODECS = [*BROKEN, "wrong:Bare", "wrong:function", "described:Unfinished"]
SOURCES = ["sources:nothing", "sources:bare", "sources:silent", "sources:short"]


@pytest.fixture
def plugged(bench):
    """Install a package with all of them; its entry points are called bad0, bad1 ... and as their functions."""
    site = bench.folder / "site"
    metadata = site / "plugged-1.0.dist-info"
    metadata.mkdir(parents=True)
    for name, code in MODULES.items():
        (site / f"{name}.py").write_text(code)
    lines = ["[tactsim.estimators]"]
    lines += [f"bad{number} = {point}" for number, point in enumerate(ESTIMATORS)]
    lines += [f"{point.partition(':')[2].lower()} = {point}" for point in WORKING]
    lines += ["[tactsim.sources]"]
    lines += [f"bad{number} = {point}" for number, point in enumerate(BROKEN)]
    lines += [f"{point.partition(':')[2]} = {point}" for point in SOURCES]
    lines += ["[tactsim.codecs]"]
    lines += [f"bad{number} = {point}" for number, point in enumerate(CODECS)]
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    before = os.environ.get("PYTHONPATH", "")
    bench.environment |= {"PYTHONPATH": f"{site}{os.pathsep}{before}", "COLUMNS": "400"}
    return bench


@pytest.mark.long
def test_every_broken_plug_in_is_a_status(plugged):
    result = plugged("list", "estimators")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert "\x1b" not in result.stdout
    for number in range(len(ESTIMATORS)):
        assert f"bad{number} " in result.stdout
    for said in ("is broken: SystemExit", "does not define", "options_type", "histogram"):
        assert said in result.stdout, said
    result = plugged("devices", "--json")
    assert result.returncode == 0, result.stderr
    status = {row["name"]: row["status"] for row in json.loads(result.stdout)["sources"]}
    for number in range(len(BROKEN)):
        assert f"plug-in 'bad{number}'" in status[f"bad{number}"]
    assert status["simulated"] == "from tactsim"
    status = {row["name"]: row["status"] for row in json.loads(result.stdout)["codecs"]}
    for number in range(len(CODECS)):
        assert f"plug-in 'bad{number}'" in status[f"bad{number}"]
    assert "does not define build" in status[f"bad{len(CODECS) - 1}"]
    assert status["fields"] == "built in"


RUN = ["run", "--trials", "1", "--readings", "2", "--out", "out"]


@pytest.fixture
def called_here(plugged, here, monkeypatch):
    """Call the command line in this process, where the package is installed too."""
    monkeypatch.setenv("COLUMNS", "400")
    monkeypatch.syspath_prepend(plugged.folder / "site")
    yield here
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.mark.long
def test_a_plug_in_that_answers_nonsense_is_named_in_one_line(plugged, called_here, scan_file):
    for name, said in {
        "nan": "guessing.Nan is broken",
        "bad1": "plug-in 'bad1'",
    }.items():
        refused(called_here(*RUN, "--scan", scan_file, "--estimator", name), said)
        assert not Path("out").exists()
    result = plugged(*RUN, "--scan", scan_file, "--estimator", "faulty")
    assert result.returncode == 1
    assert "guessing.py" in result.stderr, "an exception of its own keeps its traceback, for its author"
    assert not Path("out").exists()
    assert called_here(*RUN, "--scan", scan_file, "--estimator", "guessing").returncode == 0


@pytest.mark.parametrize(
    ("name", "jobs", "said"),
    [("ending", 1, "None"), pytest.param("ending", 2, "None", marks=pytest.mark.long),
     ("unmade", 1, "no licence")],
)  # fmt: skip
def test_a_plug_in_that_would_end_the_program_is_a_failure_with_its_place(
    called_here, scan_file, name, jobs, said
):
    words = [*RUN, "--scan", scan_file, "--estimator", name, "--jobs", jobs]
    with pytest.raises(
        RuntimeError, match=f"estimator {name} ended the program .SystemExit: {said}"
    ) as error:
        called_here(*words)
    shown = "".join(traceback.format_exception(error.value))
    assert "guessing.py" in shown, "its author sees where"
    assert not Path("out").exists()


def test_an_error_that_looks_like_a_closed_terminal_is_the_plug_ins_own(called_here, scan_file):
    with pytest.raises(EOFError, match="weights are empty"):
        called_here(*RUN, "--scan", scan_file, "--estimator", "starved")
    assert not Path("out").exists()


@pytest.mark.long
def test_what_a_plug_in_prints_is_not_among_the_json(plugged, scan_file):
    words = [*RUN, "--scan", scan_file, "--estimator", "talking", "--json", "--jobs", "2"]
    result = plugged(*words)
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["estimator"] == "talking"
    assert "hello" in result.stderr


@pytest.mark.parametrize(
    ("name", "said"),
    [("nothing", "no tactsim.core.source.Source"), ("bare", "without `counters`"),
     ("silent", "no Reading of 36"), ("short", "no Reading of 36"), ("bad1", "SystemExit")],
)  # fmt: skip
def test_a_source_that_is_none_is_named_in_one_line(called_here, name, said):
    refused(called_here("probe", "--port", f"{name}:x", "--seconds", "0.1"), f"plug-in '{name}'", said)


EVERY_MODULE = """
import pkgutil, sys
from importlib import import_module

import tactsim

names = [module.name for module in pkgutil.walk_packages(tactsim.__path__, "tactsim.")]
for name in names:
    import_module(name)
for name in [name for name in sys.modules if name.partition(".")[0] == "tactsim"]:
    del sys.modules[name]
sys.modules |= dict.fromkeys(("fcntl", "resource", "termios", "tty", "pty", "grp", "pwd"))  # cannot be imported
for name in names:
    import_module(name)
"""
START = """
import sys
import tactsim.bench.cli.app
from tactsim.bench.cli import main

sys.platform, sys.argv = "win32", ["bench", "--version"]
main()
"""


@pytest.mark.long
def test_every_module_is_imported_without_those_of_posix():
    result = subprocess.run([sys.executable, "-c", EVERY_MODULE], text=True, capture_output=True)
    assert result.returncode == 0, result.stderr


def test_the_command_starts_on_windows():
    result = subprocess.run([sys.executable, "-c", START], text=True, capture_output=True)
    assert (result.returncode, result.stderr) == (0, "")
