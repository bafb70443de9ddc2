"""The container image: what can be said of it without a builder."""

import json
import shlex
import tomllib

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
