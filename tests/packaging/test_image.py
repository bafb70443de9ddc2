"""The container image: what can be said of it without a builder, and, where one answers, that it runs the main job."""

import json
import shlex
import shutil
import subprocess
import tomllib

import pytest
from building import ROOT

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


def test_what_is_copied_from_the_repository_is_there():
    for name, rest in STEPS:
        if name in ("COPY", "ADD") and "--from=" not in rest:
            *sources, _ = shlex.split(rest)
            for source in sources:
                assert (ROOT / source).exists(), source


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
