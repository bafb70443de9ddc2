"""What is built holds one package and all of it, and what is installed runs in anybody's folder."""

import sys
import venv
import zipfile
from pathlib import Path

import pytest
from building import ROOMS, ROOT, build, copy_checkout, run

SCRIPT = """
import bench, estimators, hardware, models
import tactsim, tactsim.bench, tactsim.estimators, tactsim.hardware, tactsim.models
assert {m.whose for m in (bench, estimators, hardware, models)} == {"the user's"}
for room in (tactsim, tactsim.bench, tactsim.estimators, tactsim.hardware, tactsim.models):
    assert room.__file__.startswith(sys.prefix), room.__file__
print(tactsim.models.letter("A").name, type(tactsim.create("histogram", bins=100)).__name__)
"""


def files_of(wheel):
    """Give the content of every file of a wheel, what describes it left out."""
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if ".dist-info/" not in name]
        return {name: archive.read(name) for name in names}


def files_of_checkout():
    found = {}
    for folder in (ROOT / "tactsim", *(ROOT / room for room in ROOMS)):
        for path in folder.rglob("*"):
            inside = path.relative_to(ROOT)
            if inside.parts[:2] in {("tactsim", room) for room in ROOMS} or not path.is_file():
                continue
            if path.suffix != ".md" and "__pycache__" not in path.parts:
                name = inside if inside.parts[0] == "tactsim" else Path("tactsim", inside)
                found[str(name)] = path.read_bytes()
    return found


def smoke(environment, folder):
    """Use an installed tactsim in a folder where `models`, `bench` ... are the user's own."""
    commands = environment / "bin"
    own_cache = {"TACTSIM_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": ""}
    (folder / "script.py").write_text("import sys\n" + SCRIPT)
    assert run(commands / "python", "script.py", cwd=folder, **own_cache).split() == ["A", "HistogramFilter"]
    assert "histogram" in run(commands / "bench", "list", cwd=folder, **own_cache)
    words = ["--letters", "IO", "--trials", "2", "--readings", "3", "--bins", "100", "--out", "out"]
    assert "right after" in run(commands / "tactsim-bench", "run", *words, cwd=folder, **own_cache)
    assert (folder / "out" / "summary.json").is_file()
    run(commands / "bench", "report", "out", "--out", "out.html", cwd=folder, **own_cache)


@pytest.mark.long
def test_a_wheel_holds_the_whole_package_and_nothing_else(wheel):
    assert files_of(wheel) == files_of_checkout()


@pytest.mark.long
def test_the_wheel_of_the_source_archive_is_the_same(wheel, sdist_and_its_wheel):
    assert files_of(sdist_and_its_wheel[1]) == files_of(wheel)


@pytest.mark.long
def test_an_installed_wheel_runs_beside_folders_of_the_same_names(wheel, install, own_folder):
    environment = install(wheel)
    smoke(environment, own_folder)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["lenient", "strict"])
def test_an_editable_install_shows_one_name_too(checkout, mode, install, own_folder):
    environment = install("--config-settings", f"editable_mode={mode}", "-e", checkout)
    seen = "import tactsim.models as m; print(m.__file__)"
    assert str(checkout) in run(environment / "bin" / "python", "-c", seen, cwd=own_folder)
    for room in ROOMS:
        absent = f"import importlib.util as u; assert u.find_spec({room!r}) is None"
        run(environment / "bin" / "python", "-I", "-c", absent, cwd=own_folder)


@pytest.mark.slow
def test_a_clone_is_imported_from_the_folder_that_it_lies_in(tmp_path, install):
    environment = install("-e", copy_checkout(tmp_path / "tactsim"))
    run(environment / "bin" / "python", "-c", "import tactsim; tactsim.scan", cwd=tmp_path, PYTHONPATH="")


@pytest.mark.long
def test_links_that_an_archive_lost_are_made_again(checkout, wheel, tmp_path):
    for room in ROOMS:
        link = checkout / "tactsim" / room
        link.unlink()
        link.write_text(f"../{room}")
    assert files_of(build("wheel", checkout, tmp_path)) == files_of(wheel)


def test_a_checkout_without_a_folder_is_not_built(checkout, tmp_path):
    (checkout / "tactsim" / "models").unlink()
    with pytest.raises(AssertionError, match="tactsim/models should be a link"):
        build("wheel", checkout, tmp_path)


@pytest.mark.slow
def test_the_description_is_one_that_an_index_accepts(wheel, sdist_and_its_wheel, tmp_path):
    pytest.importorskip("twine", reason="`make test-slow` installs it")
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, sdist_and_its_wheel[0], cwd=tmp_path)


@pytest.mark.slow
def test_it_shares_an_environment_with_an_older_mujoco(wheel, tmp_path):
    """Both work after it: only one package owns the folder `mujoco/`."""
    environment = tmp_path / "venv"
    venv.create(environment, with_pip=True, symlinks=True)
    python = environment / "bin" / "python"
    for package in ("mujoco==3.3.7", wheel):
        words = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", package)
        run(python, *words, cwd=tmp_path, PYTHONPATH="")
    run(python, "-m", "pip", "check", cwd=tmp_path, PYTHONPATH="")
    seen = run(python, "-c", "import mujoco; print(mujoco.MjModel and mujoco.__version__)", cwd=tmp_path)
    assert seen.split() == ["3.3.7"]
