"""What is built and installed here is the real thing, offline, with the dependencies of the running interpreter."""

import site
import sys
import venv

import pytest
from building import ROOMS, build, build_both, copy_checkout, run


@pytest.fixture
def checkout(tmp_path):
    return copy_checkout(tmp_path / "checkout")


@pytest.fixture(scope="session")
def sdist_and_its_wheel(tmp_path_factory):
    return build_both(tmp_path_factory.mktemp("both"))


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    return build("wheel", copy_checkout(folder / "checkout"), folder)


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
