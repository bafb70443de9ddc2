"""Tasks: what their files may say, the runs that they ask for, and that what contradicts one is refused."""

import hashlib
import json

import pytest

import tactsim
from tactsim.bench import sweep
from tactsim.bench.config import run_config
from tactsim.bench.tasks import names, task
from tactsim.core import InputError
from tactsim.estimators import create

NAMES = names()
# What is asked, by a hash of all but the sentence that says it. A task that somebody may have results on does not
# change: a change needs a new version, a file letters-v2.toml beside letters-v1.toml.
PUBLISHED = {
    "active-v1": "cb1529a062a6bfdf", "glyphs36-by-hand-v1": "070803dccef9a71e",
    "glyphs36-v1": "857573752c9640b8", "letters-offgrid-v1": "f51d4de240647949",
    "letters10-faulty-v1": "eed9faf452ce52b9", "letters-v1": "c2771a4320b5ab84",
    "open-set-v1": "8723ed3ba09495d8", "slip-v1": "1f942f788ccc36c9", "smoke-v1": "89f40454a287cf1a",
    "tilted-v1": "8752e003b9b8e24e", "dtmf7-light-v1": "c7006071d039fdf2", "dtmf7-v1": "d79b154c8fbf5620",
    "icub10-v1": "f949966693697ba5", "kiechle36-v1": "edbbd80a50eb4df6", "schunk5-v1": "2bbce9a4d3ae24f2",
    "tekscan22-v2": "8b0222140835e368", "worn-pad-v1": "2bd7417c70b28b31",
}  # fmt: skip
OWN = """
line = "Two letters."
seeds = [3, 1, 4, 5, 9]
trials = 2
readings = 4
scored = ["accuracy@4"]

[words]
letters = "IO"
"""


@pytest.fixture
def own(tmp_path):
    """Write a task of one's own, changed as asked; gives its path."""

    def write(old="", new=""):
        path = tmp_path / "two-v1.toml"
        path.write_text(OWN.replace(old, new, 1))
        return str(path)

    return write


@pytest.mark.parametrize("name", NAMES)
def test_a_task_resolves_to_a_run_for_each_of_five_seeds(name):
    one = task(name)
    configs = one.configs("refined")
    assert len(configs) >= 5
    assert tuple(config.seed for config in configs) == one.seeds
    for config in configs:
        assert (config.task, config.trials, config.readings) == (name, one.trials, one.readings)
        assert (config.scan_options.letters if config.pressed else config.letters) == one.letters
        assert run_config(**config.model_dump(mode="json")) == config, "what a run says does it again"
    assert len({config.digest for config in configs}) == len(configs)


@pytest.mark.parametrize("name", NAMES)
def test_a_published_task_asks_for_what_it_asked_for(name):
    content = json.dumps(task(name).model_dump(mode="json", exclude={"line"}), sort_keys=True)
    assert hashlib.sha256(content.encode()).hexdigest()[:16] == PUBLISHED[name], (
        f"{name} has changed; leave it as it was and write a new version, a file of its own"
    )


def test_every_task_states_its_data():
    assert set(PUBLISHED) == set(NAMES)
    assert len({one for name in NAMES for one in task(name).hashes}) == sum(
        len(task(name).seeds) for name in NAMES
    ), "each seed of each task has data of its own"
    assert len({task(name).data for name in NAMES}) == len(NAMES)


def test_the_name_of_a_task_changes_no_digest():
    named = run_config(task="letters-offgrid-v1", seed=2)
    same = run_config(trials=20, readings=20, seed=2)
    assert named.task != same.task
    assert (named.digest, named.source) == (same.digest, same.source)


def test_a_sweep_of_a_task_has_its_seeds_unless_it_names_some():
    runs = {"estimator": "nearest", "task": ["slip-v1", "tilted-v1"]}
    assert [(c.task, c.seed) for c in sweep.expand({"run": [runs]}, "sweep")] == [
        (name, seed) for name in ("slip-v1", "tilted-v1") for seed in range(5)
    ]
    assert [c.seed for c in sweep.expand({"run": [runs | {"seed": 3}]}, "sweep")] == [3, 3]
    with pytest.raises(InputError, match="seed 5: task slip-v1 has the seeds 0, 1, 2, 3, 4"):
        sweep.expand({"run": [runs | {"seed": [0, 5]}]}, "sweep")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"letters": "AEIO"}, r"letters A,E,I,O: task slip-v1 says A,E,I,O,U; leave out letters"),
        ({"seed": 5}, "seed 5: task slip-v1 has the seeds 0, 1, 2, 3, 4"),
        ({"slip": {"jump_mm": 1}}, "slip .*jump_mm"),
        ({"scan": "mine.npz"}, "scan: task slip-v1 has readings of its own"),
        ({"estimator": "refined", "bins": 3, "set": {"bins": 3}}, "bins is given by itself and in set"),
    ],
)
def test_what_contradicts_a_task_is_refused_in_one_line(words, message):
    with pytest.raises(InputError, match=message) as caught:
        run_config(task="slip-v1", **words)
    assert "\n" not in str(caught.value)


def test_a_seed_for_development_is_a_look_at_a_task_and_no_run_of_it(own):
    path = own("trials = 2", "development = [7, 8]\ntrials = 2")
    assert [config.seed for config in task(path).configs("nearest")] == [3, 1, 4, 5, 9]
    look = run_config(task=path, seed=7)
    assert (look.seed, look.task, look.trials) == (7, None, 2)
    with pytest.raises(
        InputError, match=r"seed 0: task .* has the seeds 3, 1, 4, 5, 9 and, for development, 7, 8"
    ):
        run_config(task=path, seed=0)
    with pytest.raises(InputError, match="seed 4 is among seeds and development"):
        task(own("trials = 2", "development = [7, 4]\ntrials = 2"))


def test_touches_that_may_be_chosen_may_be_taken_blindly():
    one = task("active-v1")
    assert {config.explore for config in one.configs("refined")} == {"information"}
    assert {config.explore for config in one.configs("nearest")} == {"blind"}
    assert run_config(task="active-v1", explore="blind").task == "active-v1"
    with pytest.raises(InputError, match="explore 'random': task active-v1 says 'information'"):
        run_config(task="active-v1", explore="random")


@pytest.mark.parametrize("name", ["letters-v9", "../tasks/letters-v1"])
def test_an_unknown_task_is_refused_with_those_there_are(name):
    with pytest.raises(InputError, match=r"unknown task .*known are .*letters-v1.* and \d+ more$"):
        task(name)
    with pytest.raises(
        InputError, match=r"^task 'solids' is of objects in space.*: bench run --task solids$"
    ):
        task("solids")
    with pytest.raises(InputError, match="unknown task"):
        run_config(task=name)


def test_a_file_of_ones_own_is_a_task(own):
    path = own()
    one = task(path)
    assert (one.letters, one.data, one.seeds) == (("I", "O"), None, (3, 1, 4, 5, 9))
    configs = one.configs("histogram", {"bins": 100})
    assert [config.seed for config in configs] == [3, 1, 4, 5, 9]
    assert {config.task for config in configs} == {path}
    assert {config.options["bins"] for config in configs} == {100}


def test_the_paths_of_a_task_are_beside_its_file(own, tmp_path, monkeypatch):
    path = own('letters = "IO"', 'scan = "data/mine.npz"\ntrain_scan = "/abs/train.npz"')
    assert task(path).configs("nearest")[0].scan == tmp_path / "data" / "mine.npz"
    assert str(task(path).configs("nearest")[0].train_scan) == "/abs/train.npz"
    (tmp_path / "poor.toml").write_text("[sensor]\nnoise = 7.0\n")
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path / "sub")
    worlds = own('letters = "IO"', 'world = "poor.toml"')
    assert task(worlds).configs("nearest")[0].scan_options.sensor.noise == 7.0
    assert run_config(task="../two-v1.toml").scan_options.sensor.noise == 7.0
    assert task(own('letters = "IO"', 'world = "rough"')).configs("nearest")[0].world == "rough"
    recording = own('letters = "IO"', 'scan = "recording:tekscan22-v1"')
    assert str(task(recording).configs("nearest")[0].scan) == "recording:tekscan22-v1"
    shapes = task(own('letters = "IO"', 'shapes = ["a.stl", "b.svg"]'))
    assert shapes.configs("nearest")[0].shapes == (tmp_path / "a.stl", tmp_path / "b.svg")
    assert shapes.letters == (*"AEIOU", "a", "b")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[3, 1, 4, 5, 9]", "[3, 1]", "seeds: .*at least 5"),
        ('line = "Two letters."', "", "missing is line .what is asked, in one sentence."),
        ('["accuracy@4"]', '["acuracy@4"]', "unknown figure in scored of task .*did you mean 'accuracy'"),
        ('["accuracy@4"]', '["accuracy@5"]', "'accuracy@5' says no reading from 1 to 4; write accuracy@4"),
        ('["accuracy@4"]', '["settled_95", "accuracy@4"]', "settled_95 cannot rank"),
        ('["accuracy@4"]', f'["accuracy@4"]\nhashes = ["{"0" * 64}"]', "1 hashes for 5 seeds; give one a seed"),
        ('letters = "IO"', 'lettres = "IO"', "unknown option in .words. .*did you mean 'letters'"),
        ("[words]", "[words", "not TOML"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_in_one_line(own, old, new, message):
    with pytest.raises(InputError, match=message) as caught:
        task(own(old, new))
    assert "\n" not in str(caught.value)
    assert "two-v1" in str(caught.value)


@pytest.mark.long
def test_python_runs_a_task_by_name_and_with_an_estimator_of_ones_own(own):
    named = tactsim.run(task=own(), estimator="nearest", seed=4)
    given = tactsim.run(task=own(), estimator=create("nearest"), seed=4)
    again = tactsim.run(**named.config)
    assert named.task == given.task == again.task == own()
    assert (named.seed, len(named.trials.truth), named.readings) == (4, 4, 4)
    for other in (given, again):
        assert (other.trials.pose == named.trials.pose).all()
    choosing = own("[words]", '[words]\nexplore = "information"')
    for kind in ("nearest", create("nearest")):
        run = tactsim.run(task=choosing, estimator=kind, trials=1)
        assert (run.config["explore"], run.task) == ("blind", None)
    with pytest.raises(InputError, match=r"given: task .* has readings of its own"):
        tactsim.run(tactsim.scan("IO"), task=own(), estimator="nearest")
