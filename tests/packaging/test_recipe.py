"""The conda recipe says what pyproject.toml says; `rattler-build` itself is not needed here."""

import re
import tomllib

import yaml
from building import ROOT
from packaging.requirements import Requirement

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECIPE = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
# What conda-forge calls otherwise: MuJoCo's Python package, and Matplotlib without Qt.
CONDA = {"mujoco": "mujoco-python", "matplotlib": "matplotlib-base"}


def test_the_dependencies_are_the_same():
    wanted = {
        (CONDA.get(one.name, one.name), str(one.specifier))
        for one in map(Requirement, PROJECT["dependencies"])
    }
    run = [line for line in RECIPE["requirements"]["run"] if not line.startswith(("python ", "__"))]
    assert {tuple(line.split(" ", 1)) for line in run} == wanted
    assert len(run) == len(wanted)


def test_version_python_commands_and_licence_are_the_same():
    context = RECIPE["context"]
    assert context["version"] == PROJECT["version"]
    assert f">={context['python_min']}" == PROJECT["requires-python"]
    commands = dict(re.split(r"\s*=\s*", line) for line in RECIPE["build"]["python"]["entry_points"])
    assert commands == PROJECT["scripts"]
    assert RECIPE["about"]["license"] == PROJECT["license"]
    assert [RECIPE["about"]["license_file"]] == PROJECT["license-files"]
    assert RECIPE["about"]["summary"] == PROJECT["description"]
