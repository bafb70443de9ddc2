"""What is built and installed here: the real thing, offline, with the dependencies of the running interpreter."""

import json
import os
import shutil
import site
import subprocess
import sys
import tarfile
import venv
from pathlib import Path

import pytest

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


def copy_checkout(folder):
    """Copy what a distribution is made from, links as links."""
    skip = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in ("tactsim", *ROOMS):
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=skip)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy2(ROOT / name, folder / name)
    return folder


@pytest.fixture
def checkout(tmp_path):
    return copy_checkout(tmp_path / "checkout")


@pytest.fixture(scope="session")
def sdist(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sdist")
    return build("sdist", copy_checkout(folder / "checkout"), folder)


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    return build("wheel", copy_checkout(folder / "checkout"), folder)


@pytest.fixture(scope="session")
def wheel_of_sdist(sdist, tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel-of-sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    return build("wheel", folder / sdist.name.removesuffix(".tar.gz"), folder)


@pytest.fixture
def install(tmp_path):
    """Install something in a fresh virtual environment; gives the environment's folder."""

    def install(*what):
        folder = tmp_path / "venv"
        venv.create(folder, symlinks=True)
        packages = folder / "lib" / "python{}.{}".format(*sys.version_info) / "site-packages"
        # The folders themselves: what is installed there as editable is not taken along.
        packages.joinpath("dependencies.pth").write_text("\n".join(site.getsitepackages()))
        python = folder / "bin" / "python"
        words = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--disable-pip-version-check")
        run(sys.executable, "-m", "pip", "--python", python, "install", *words, *what, cwd=tmp_path)
        return folder

    return install


@pytest.fixture
def own_folder(tmp_path):
    """Make a user's folder in which the names of this repository's folders are taken."""
    folder = tmp_path / "user"
    for name in ROOMS:
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text('whose = "the user\'s"\n')
    return folder
