"""What is built and installed here: the real thing, offline, with the dependencies of the running interpreter."""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("bench", "estimators", "hardware", "models")
BUILD = """
import json, sys
from setuptools import build_meta
print()
print(json.dumps(getattr(build_meta, f"build_{sys.argv[1]}")(sys.argv[2])))
"""


def run(*words, cwd, **environment):
    """Run a command; what it prints, if it succeeds."""
    done = subprocess.run(
        list(map(str, words)), cwd=cwd, env=os.environ | environment, text=True, capture_output=True,
        timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def build(kind, source, folder):
    """Build a `wheel` or an `sdist` as pip does; where it is."""
    out = run(sys.executable, "-c", BUILD, kind, folder, cwd=source)
    return folder / json.loads(out.splitlines()[-1])


def build_both(folder):
    """Build a source archive, and a wheel of what is in it, from a copy of the checkout."""
    with tempfile.TemporaryDirectory() as place:
        sdist = build("sdist", copy_checkout(Path(place, "checkout")), folder)
        with tarfile.open(sdist) as archive:
            unpack(archive, place)
        return sdist, build("wheel", Path(place, sdist.name.removesuffix(".tar.gz")), folder)


def copy_checkout(folder):
    """Copy what a distribution is made from, links as links."""
    skip = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in ("tactsim", *ROOMS):
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=skip)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy2(ROOT / name, folder / name)
    return folder


if __name__ == "__main__":  # `python -m building dist`
    for made in build_both(Path(sys.argv[1]).resolve()):
        print(made)


def unpack(archive, folder):
    """Unpack a tar file as `filter="data"` says, where Python knows that: from 3.11.4 on."""
    archive.extraction_filter = getattr(tarfile, "data_filter", None)
    archive.extractall(folder)
