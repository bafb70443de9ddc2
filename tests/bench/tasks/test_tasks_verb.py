"""`bench tasks` and `--task`: what a user types, good and bad."""

import json

import pytest
from command_line import refused

from tactsim.bench.runs.saved import load
from tactsim.bench.tasks import names, task

OWN = """
line = "Two letters."
seeds = [0, 1, 2, 3, 4]
trials = 2
readings = 3
scored = ["accuracy@3"]

[words]
letters = "IO"
"""


@pytest.fixture
def own(tmp_path):
    (tmp_path / "two-v1.toml").write_text(OWN)
    return tmp_path / "two-v1.toml"


def test_json_has_every_task_whole(here):
    content = json.loads(here("tasks", "--json").stdout)["tasks"]
    assert [one["name"] for one in content] == list(names())
    for one in content:
        read = task(one["name"])
        assert (tuple(one["letters"]), one["data"]) == (read.letters, read.data)
        said = read.model_dump(mode="json", exclude={"name"})
        assert {name: one[name] for name in said} == said
    assert json.loads(here("tasks", "slip-v1", "--json").stdout) == next(
        one for one in content if one["name"] == "slip-v1"
    )


@pytest.mark.long
def test_hashes_are_printed_for_a_file_and_compared_once_it_states_them(here, own):
    shown = here("tasks", own.name, "--hash", "--jobs", "2")
    assert shown.returncode == 0, shown.stderr
    printed = shown.stdout[shown.stdout.index("hashes = [") :]
    own.write_text(OWN.replace("[words]", f"{printed}\n[words]"))
    assert "as the task states" in here("tasks", own.name, "--hash").stdout
    first = task(str(own)).hashes[0]
    own.write_text(own.read_text().replace(first, "0" * 64))
    other = here("tasks", own.name, "--hash")
    assert other.returncode == 1
    assert f'"{first}",  # the task states {"0" * 64}' in other.stdout
    assert "1 of 5 differ from what the task states" in other.stdout


def test_a_run_of_a_task_says_so(here, own, tmp_path):
    ran = here("run", "--task", own.name, "--estimator", "nearest", "--seed", "3", "--out", "run")
    assert ran.returncode == 0, ran.stderr
    assert f"task {own.name}; I O: 2 trials each" in ran.stdout
    run = load(tmp_path / "run")
    assert (run.task, run.seed, run.readings, run.config["trials"]) == (own.name, 3, 3, 2)
    answer = json.loads(here("run", "--task", own.name, "--estimator", "nearest", "--json").stdout)
    assert (answer["task"], answer["seed"], answer["letters"]) == (own.name, 0, ["I", "O"])


def test_a_shorter_look_says_that_it_is_no_result(here, own, tmp_path):
    ran = here(
        "run", "--task", own.name, "--estimator", "nearest", "--readings", "2", "--out", "run", "--json"
    )
    assert ran.returncode == 0, ran.stderr
    assert "a look at task two-v1.toml" in ran.stderr
    assert json.loads(ran.stdout)["task"] is None
    assert load(tmp_path / "run").task is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("tasks", "letters-v2"), "unknown task 'letters-v2': did you mean 'letters-v1'?"),
        (("tasks", "--hash"), "--hash: name the task"),
        (("run", "--task", "slip-v1", "--port", "simulated:hand"), "--port: a task has readings of its own"),
    ],
)
def test_wrong_input_is_one_line(here, words, message):
    refused(here(*words), message)
