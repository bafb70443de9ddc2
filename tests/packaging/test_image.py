"""The container image: what can be said of it without a builder, and, where one answers, that it runs the main job."""

import fnmatch
import json
import re
import shlex
import shutil
import subprocess
import tomllib

import pytest
from building import ROOMS, ROOT
from packaging.specifiers import SpecifierSet

from tactsim.bench.cli.app import load

TEXT = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
STEPS = [
    (words[0], words[1])
    for line in TEXT.splitlines()
    if line.strip() and not line.startswith("#")
    for words in [line.split(None, 1)]
]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def last(instruction):
    return [rest for name, rest in STEPS if name == instruction][-1]


def stages():
    """Split the steps at each FROM."""
    found = []
    for name, rest in STEPS:
        if name == "FROM":
            found.append([])
        if found:
            found[-1].append((name, rest))
    return found


def is_sent(path):
    """Tell whether .dockerignore lets a file of the repository through: the last line that fits decides."""
    sent = True
    for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            pattern = line.removeprefix("!")
            tops = ["/".join(path.split("/")[:n]) for n in range(1, path.count("/") + 2)]
            if any(
                fnmatch.fnmatch(top, pattern)
                or (pattern.startswith("**/") and fnmatch.fnmatch(top.rpartition("/")[2], pattern[3:]))
                for top in tops
            ):
                sent = line.startswith("!")
    return sent


def test_the_builder_gets_what_the_package_is_made_from_and_nothing_else():
    words = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    tracked = subprocess.run(words, cwd=ROOT, text=True, capture_output=True, check=False)
    if tracked.returncode:
        pytest.skip("no git repository: a source archive holds nothing else anyway")
    sent = {path for path in tracked.stdout.splitlines() if is_sent(path)}
    single = {"pyproject.toml", "setup.py", "README.md", "LICENSE", "requirements.lock"}
    assert {path for path in sent if "/" not in path} == single
    assert {path.split("/")[0] for path in sent if "/" in path} == {"tactsim", *ROOMS}


def test_what_is_copied_from_the_repository_is_there_and_sent():
    for name, rest in STEPS:
        if name in ("COPY", "ADD") and "--from=" not in rest:
            *sources, _ = shlex.split(rest)
            for source in sources:
                assert (ROOT / source).exists(), source
                assert source == "." or is_sent(source), source


def test_both_stages_have_one_python_that_the_project_knows():
    """A kernel that was compiled by another version would be compiled again in every container."""
    (version,) = [rest.removeprefix("PYTHON=") for name, rest in STEPS if name == "ARG"]
    assert SpecifierSet(PROJECT["requires-python"]).contains(version)
    assert f"Programming Language :: Python :: {version}" in PROJECT["classifiers"]
    bases = [stage[0][1].split()[0] for stage in stages()]
    assert bases == ["python:${PYTHON}-slim"] * 2


def test_dependencies_are_the_pinned_ones_and_the_last_stage_installs_nothing():
    build, final = stages()
    installs = [rest for name, rest in build if name == "RUN" and "pip --python" in rest]
    assert "--requirement requirements.lock" in installs[0]
    assert "--no-deps --no-build-isolation" in installs[1]
    # In the folder of the source, `python -m` alone would compile what is there.
    assert "-I -m tactsim.bench.compile_kernels" in installs[1]
    assert all("--no-cache-dir" in rest for rest in installs)
    assert not any("pip" in rest or "apt" in rest for name, rest in final if name == "RUN")
    assert [rest for name, rest in final if name == "COPY"] == ["--from=build /opt/tactsim /opt/tactsim"]


def test_it_is_not_root_that_runs_it():
    final = stages()[-1]
    names = [name for name, _ in final]
    assert last("USER") not in ("root", "0")
    assert names.index("USER") > max(k for k, name in enumerate(names) if name in ("RUN", "COPY"))
    assert re.search(rf"useradd .*--uid \d+ {last('USER')}\b", TEXT)


def test_it_does_the_main_job():
    program, *words = json.loads(last("ENTRYPOINT")) + json.loads(last("CMD"))
    assert program in PROJECT["scripts"]
    assert words == ["run", "--estimator", "histogram", "--bins", "10000"]
    load("run").make_context("bench run", words[1:])


@pytest.mark.slow
def test_it_is_built_and_runs(tmp_path):
    docker = shutil.which("docker")
    if docker is None or subprocess.run([docker, "info"], capture_output=True, check=False).returncode:
        pytest.skip("no docker daemon answers")
    subprocess.run([docker, "build", "--tag", "tactsim-test", "."], cwd=ROOT, check=True, timeout=1800)
    tmp_path.chmod(0o777)
    words = ["--rm", "--network", "none", "--volume", f"{tmp_path}:/work", "tactsim-test"]
    done = subprocess.run(
        [docker, "run", *words, "run", "--letters", "IO", "--trials", "2", "--readings", "3"],
        text=True, capture_output=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "compiling" not in done.stderr
    (summary,) = tmp_path.glob("results/runs/*/summary.json")
    assert summary.stat().st_uid != 0
