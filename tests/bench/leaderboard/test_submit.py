"""`bench submit` and `bench verify` as a user calls them: a task's runs in one file, and what it takes to trust it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import refused
from entered import changed

from tactsim.bench import experiment
from tactsim.bench.config import run_config
from tactsim.bench.leaderboard.bundle import DONE, read_bundle, read_record, rounded, write_bundle
from tactsim.bench.leaderboard.limited import Limits, NoScore, Wanted, limited_runs
from tactsim.bench.leaderboard.verify import compared
from tactsim.bench.tasks import task
from tactsim.bench.tasks.data import hash_data
from tactsim.core import InputError

TASK = """
line = "Two letters, a few readings."
seeds = [0, 1, 2, 3, 4]
trials = 4
readings = 3
scored = ["accuracy@3", "error_mm@3"]
hashes = [{}]

[words]
letters = "IO"
test_poses = "random"
"""


@pytest.fixture(scope="module", autouse=True)
def few_angles(tmp_path_factory):
    """Press at four angles, also in other processes: scans a third as large are as good for all that is tested here."""
    folder = tmp_path_factory.mktemp("angles")
    (folder / "sitecustomize.py").write_text("import tactsim.press.scan_poses as poses\n\nposes.ANGLES = 4\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactsim.press.scan_poses.ANGLES", 4)
        patch.syspath_prepend(folder)
        yield


@pytest.fixture(scope="module")
def small_task(tmp_path_factory, shared_cache, few_angles):
    """Write a task of one's own, as an author of one would: first without hashes, which are then filled in."""
    path = tmp_path_factory.mktemp("task") / "small-v1.toml"
    path.write_text(TASK.format(""))
    asked = task(str(path))
    return TASK.format(", ".join(f'"{hash_data(asked, seed)}"' for seed in asked.seeds))


@pytest.fixture
def folder(tmp_path, small_task):
    (tmp_path / "small-v1.toml").write_text(small_task)
    return tmp_path


@pytest.fixture(scope="module")
def submitted():
    return {}


@pytest.fixture
def bundle_of(here, folder, plugged, submitted):
    """Submit a method to the small task, once in all tests; gives the path of its bundle, in this test's folder."""

    def submit(name, *words, status=0):
        key = (name, *words)
        path = folder / "bundle.tar.xz"
        if key not in submitted:
            path.unlink(missing_ok=True)
            result = here("submit", "small-v1.toml", "--estimator", name, *words, "--out", path)
            assert result.returncode == status, result.stderr
            submitted[key] = path.read_bytes()
        path.write_bytes(submitted[key])
        return path

    return submit


def verified(result):
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def unverified(result, said):
    assert result.returncode == 1, result.stdout + result.stderr
    lines = [line for line in " ".join(result.stdout.split()).split("NOT VERIFIED ")[1:] if line]
    assert said in lines[0], lines
    return result.stdout


@pytest.mark.long
def test_a_plug_in_is_submitted_and_verified(bundle_of, here, folder):
    path = bundle_of("guess", "--set", "spread=2", "--title", "Guesses")
    bundle = read_bundle(path)
    assert (bundle.task, bundle.method, bundle.status, bundle.package) == (
        "small-v1.toml", "Guesses", DONE, "plugged 1.0",
    )  # fmt: skip
    assert bundle.options == {"spread": 2.0}
    assert bundle.task_data == task("small-v1.toml").data
    assert [run.seed for run in bundle.runs] == [0, 1, 2, 3, 4]
    assert len(bundle.pooled.ids) == len(set(bundle.pooled.ids)) == 40
    said = verified(here("verify", path, "--record"))
    assert "20 of 40 trials, chosen with --seed" in said
    assert "all 20 trials that were done again are the same in all that a bundle keeps" in " ".join(
        said.split()
    )
    record = read_record(path)
    assert record is not None
    assert (record.verified, record.again, record.trials) == (True, 20, 40)
    path.write_bytes(path.read_bytes() + b" ")
    with pytest.raises(InputError, match="is of another file than"):
        read_record(path)


@pytest.mark.long
def test_a_built_in_estimator_is_submitted_as_bench_run_does_it(bundle_of, here):
    path = bundle_of("nearest")
    bundle = read_bundle(path)
    run = experiment.perform(run_config(estimator="nearest", task="small-v1.toml", seed=3))
    assert np.array_equal(rounded(run.trials).pose, bundle.runs[3].trials.pose)
    assert "all 40 trials" in verified(here("verify", path, "--full"))


def test_a_plug_in_that_fails_has_a_status_and_no_score(here, folder, plugged):
    result = here("submit", "small-v1.toml", "--estimator", "crash", "--out", "a.tar.xz")
    assert result.returncode == 1
    assert "status  crashed: KeyError" in result.stdout
    assert "Traceback" in result.stderr, "for its author"
    bundle = read_bundle("a.tar.xz")
    assert bundle.status.startswith("crashed: KeyError")
    assert bundle.runs == ()
    unverified(here("verify", "a.tar.xz"), "it has no score that could be checked: crashed: KeyError")


@pytest.mark.long
def test_what_is_not_reproducible_must_say_so(bundle_of, here, folder):
    path = bundle_of("randomguess")
    unverified(here("verify", path, "--seed", "1"), "seed 0, letter ")  # the first trial that differs
    open_about_it = changed(read_bundle(path), reproducible=False)
    write_bundle(open_about_it, path)
    said = " ".join(verified(here("verify", path, "--seed", "1", "--record")).split())
    assert "within what chance allows" in said
    assert "its author says that the method is not reproducible" in said
    assert read_record(path).verified


def rewritten(path, change):
    """Change the trials of each run, as somebody does who knows how."""
    bundle = read_bundle(path)
    runs = [replace(run, trials=replace(run.trials, **change(run.trials))) for run in bundle.runs]
    write_bundle(changed(bundle, runs=tuple(runs)), path)


def all_right(trials):
    return {
        "label": np.broadcast_to(trials.answer[:, None], trials.label.shape),
        "p_truth": np.ones(trials.label.shape),
    }


@pytest.mark.long
def test_results_that_were_made_better_are_found_out(bundle_of, here):
    path = bundle_of("guess", "--set", "spread=2", "--title", "Guesses")
    rewritten(path, all_right)
    unverified(here("verify", path, "--seed", "0"), "is not what it is in the bundle when it is done again")
    write_bundle(changed(read_bundle(path), reproducible=False), path)
    unverified(here("verify", path, "--seed", "0"), "beyond chance")


@pytest.mark.long
def test_who_has_prepared_for_the_task_is_found_out_on_a_fresh_seed(bundle_of, here):
    path = bundle_of("prepared")
    assert read_bundle(path).pooled.trials.right.all()
    assert "are the same in all" in " ".join(verified(here("verify", path)).split()), "so far all is well"
    unverified(
        here("verify", path, "--fresh", "--seed", "1"),
        "better than the method is where nobody could have prepared for it",
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: {"true_pose": t.true_pose + 0.1}, "an object lies elsewhere than the task puts it"),
        (lambda t: {"trial": t.trial[::-1]}, "its trials are not those of the task"),
    ],
)
def test_what_the_task_says_cannot_be_changed(change, said, bundle_of, here):
    path = bundle_of("guess", "--set", "spread=2", "--title", "Guesses")
    rewritten(path, change)
    unverified(here("verify", path), said)


@pytest.mark.long
def test_what_a_run_says_of_itself_cannot_be_changed(bundle_of, here, monkeypatch):
    path = bundle_of("guess", "--set", "spread=2", "--title", "Guesses")
    good = read_bundle(path)

    def verified_with(**changes):
        runs = [replace(run, **{name: change(run) for name, change in changes.items()}) for run in good.runs]
        write_bundle(changed(good, runs=tuple(runs)), path)
        return here("verify", path)

    def light(run):
        return {letter: replace(of, inertia_over_mass=1e-6) for letter, of in run.objects.items()}

    unverified(verified_with(objects=light), "what it says of the objects")
    unverified(
        verified_with(config=lambda run: run.config | {"test_poses": "same"}),
        "the task says test_poses 'random'",
    )
    write_bundle(changed(good, runs=good.runs[:-1]), path)
    unverified(here("verify", path), "asks for the seeds 0, 1, 2, 3, 4")


@pytest.mark.long
def test_a_bundle_of_another_version_is_refused_in_one_line(bundle_of, here, folder):
    path = bundle_of("guess", "--set", "spread=2", "--title", "Guesses")
    good = read_bundle(path)
    write_bundle(changed(good, task="letters-v99"), path)
    refused(here("verify", path), "'letters-v99', which this version of tactsim does not have")
    write_bundle(changed(good, task_data="0" * 64), path)
    refused(here("verify", path), "it is of another version of the task small-v1.toml", "000000000000")
    write_bundle(changed(good, versions=good.versions | {"tactsim": "9.9"}, source_hash="0" * 64), path)
    said = " ".join(verified(here("verify", path)).split())
    assert "it was made with tactsim 9.9, and here is" in said
    assert "the code here is not that of the bundle" in said
    path.write_bytes(path.read_bytes()[:-100])
    refused(here("verify", path), "it is cut short")


def test_a_mistake_is_said_before_the_work(here, folder, plugged):
    submit = ("submit", "small-v1.toml", "--out", "a.tar.xz")
    refused(
        here("submit", "letters-v9", "--estimator", "guess", "--out", "a.tar.xz"),
        "unknown task",
        "letters-v1",
    )
    refused(here(*submit, "--estimator", "gues"), "unknown estimator", "did you mean 'guess'")
    refused(here(*submit, "--estimator", "guess", "--set", "spread=-1"), "spread")
    (folder / "other.toml").write_text(TASK.format(", ".join(['"' + "0" * 64 + '"'] * 5)))
    refused(
        here("submit", "other.toml", "--estimator", "guess", "--out", "a.tar.xz"),
        "the data of seed 0 have the hash",
    )
    assert not Path("a.tar.xz").exists()


@pytest.mark.long
def test_an_honest_bundle_is_refused_as_rarely_as_is_said(bundle_of):
    runs = read_bundle(bundle_of("guess", "--set", "spread=2", "--title", "Guesses")).runs
    rng = np.random.default_rng(0)
    refusals = 0
    for _ in range(25):
        pairs = []
        for run in runs:
            # Two draws of one method are as likely the other way round.
            swap = rng.random(len(run.trials.truth)) < 0.5
            moved = np.roll(run.trials.pose, 1, axis=0)
            one, other = (np.where(which[:, None, None], moved, run.trials.pose) for which in (swap, ~swap))
            pairs.append([replace(run, trials=replace(run.trials, pose=pose)) for pose in (one, other)])
        refusals += not compared(*zip(*pairs, strict=True), ["its author says so"])[0]
    assert refusals == 0


SMALL = {"letters": "IO", "trials": 2, "readings": 4}


def apart(name, limits=None, **words):
    (run,) = limited_runs([Wanted({**SMALL, "estimator": name, **words})], limits=limits)
    return run


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("crash", "crashed: KeyError: \"a bug of the plug-in's\" (failing.py, line"),
        ("leave", "crashed: its process ended by itself, with status 0"),
        ("abort", "crashed: its process was ended by SIGABRT"),
        ("eat", "out of memory: it takes more than 400 MB"),
    ],
)  # fmt: skip
def test_a_method_that_fails_gets_a_status_in_one_line(name, status, plugged):
    with pytest.raises(NoScore) as caught:
        apart(name, Limits(memory_mb=400))
    assert caught.value.status.startswith(status)
    assert "\n" not in caught.value.status
    assert "; run 0, after 0 of 4 trials" in caught.value.status


@pytest.mark.long
def test_a_method_that_hangs_is_ended(plugged):
    with pytest.raises(
        NoScore, match=r"^timed out: a trial took more than 0\.5 s; run 0, after 0 of 4 trials"
    ):
        apart("hang", Limits(trial_s=0.5))


@pytest.mark.long
def test_a_method_may_print(plugged, capfd):
    assert len(apart("print").trials.truth) == 4
    assert capfd.readouterr() == ("", "")
