"""Nothing refuses to start where Python lacks what only POSIX has, as on Windows.

What Python's own library and other packages do there is theirs: they are imported before anything is taken away.
"""

import subprocess
import sys

import pytest

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
