"""Nothing refuses to start where Python lacks what only POSIX has, as on Windows.

The verbs run in processes in which these modules cannot be imported by this package. What Python's own library and
other packages do with them on this system is theirs, and they do without on Windows.
"""

import json
import os
import subprocess
import sys

import pytest

HIDDEN = """
import builtins, os, select, signal, sys

MODULES = {"fcntl", "resource", "termios", "tty", "pty", "grp", "pwd"}
plain = builtins.__import__


def hiding(name, globals=None, locals=None, fromlist=(), level=0):
    asking = (globals or {}).get("__name__", "")
    if name in MODULES and (asking.partition(".")[0] == "tactsim" or asking == "__main__"):
        raise ImportError(f"no module named {name} on this system")
    return plain(name, globals, locals, fromlist, level)


builtins.__import__ = hiding
"""
# Where other packages are loaded already: attributes that Windows lacks.
WITHOUT = """
import os, select, signal, sys

from tactsim.bench.cli import main

for module, names in ((select, ["poll"]), (os, ["getuid", "sched_getaffinity", "O_NONBLOCK", "openpty"])):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
sys.argv[0] = "bench"
main()
"""


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """Give what calls `bench` in a folder, as on a system without POSIX."""
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "hidden").mkdir()
    (folder / "hidden" / "sitecustomize.py").write_text(HIDDEN)
    paths = [str(folder / "hidden"), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "120", "NO_COLOR": "1"}

    def call(*words):
        result = subprocess.run(
            [sys.executable, "-c", WITHOUT, *map(str, words)],
            cwd=folder,
            env=environment,
            text=True,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=240,
            check=False,
        )
        assert "Traceback" not in result.stderr, result.stderr
        return result

    call.folder = folder
    return call


@pytest.fixture(scope="module")
def scan(elsewhere):
    made = elsewhere("scan", "--letters", "IO", "--out", "scan.npz")
    assert made.returncode == 0, made.stderr
    return "scan.npz"


SMALL = ("--estimator", "histogram", "--bins", "100", "--trials", "2", "--readings", "3")


def test_the_modules_are_hidden(elsewhere):
    result = elsewhere("emulate", "--port", "pty")
    assert result.returncode == 2
    assert "no ptys" in result.stderr
    assert "--port tcp" in result.stderr


@pytest.mark.long
def test_a_run_and_its_report(elsewhere, scan):
    result = elsewhere("run", "--scan", scan, *SMALL, "--out", "run", "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["letters"] == ["I", "O"]
    for words in (("report", "run", "--out", "page.html"), ("compare", "run", "run")):
        result = elsewhere(*words)
        assert result.returncode == 0, result.stderr
    assert (elsewhere.folder / "page.html").is_file()


def test_the_command_starts_on_windows():
    """What other packages do there is theirs: they are imported before the platform is called so."""
    code = (
        "import sys, tactsim.bench.cli.app\nfrom tactsim.bench.cli import main\n"
        "sys.platform, sys.argv = 'win32', ['bench', '--version']\nmain()"
    )
    result = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
    assert (result.returncode, result.stderr) == (0, "")
