"""The process that runs are done in: the same results as without it, and a status for a method that fails."""

from dataclasses import fields

import numpy as np
import pytest

from tactsim.bench import experiment
from tactsim.bench.config import run_config
from tactsim.bench.leaderboard.limited import Limits, NoScore, Wanted, limited_runs
from tactsim.bench.trials import OneTrial, Trials
from tactsim.core import InputError

SMALL = {"letters": "IO", "trials": 2, "readings": 4}


def differing(one, other):
    """Name the columns of two results that differ by a bit; times do."""
    return [
        field.name
        for field in fields(Trials)
        if not field.name.endswith("_s")
        and not np.array_equal(
            getattr(one, field.name),
            getattr(other, field.name),
            equal_nan=field.name in ("credibility", "radius_90"),
        )
    ]


def apart(name, limits=None, **words):
    (run,) = limited_runs([Wanted({**SMALL, "estimator": name, **words})], limits=limits)
    return run


@pytest.mark.long
@pytest.mark.parametrize("jobs", [1, 2])
def test_runs_are_the_same_as_in_this_process_and_any_trials_of_them(jobs, shared_cache):
    words = {**SMALL, "estimator": "histogram", "bins": 100, "slip": {"walk_mm": 0.5}}
    seen = []
    wanted = [Wanted(words), Wanted({**words, "seed": 1}, [("I", 1), ("O", 0)])]
    first, second = limited_runs(wanted, jobs=jobs, progress=lambda *said: seen.append(said))
    assert seen[-1][0] == "sweep"
    assert seen[-1][1] == seen[-1][2]
    here = experiment.perform(run_config(**words))
    assert differing(first.trials, here.trials) == []
    assert (first.about["options"], first.about["settings"]) == (
        here.about["options"],
        here.about["settings"],
    )
    chosen = experiment.perform(run_config(**words, seed=1), trials=[OneTrial("I", 1), OneTrial("O", 0)])
    assert differing(second.trials, chosen.trials) == []
    assert (first.trials.update_s > 0).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("crash", "crashed: KeyError: \"a bug of the plug-in's\" (failing.py, line"),
        ("exit", "crashed: RuntimeError: the estimator exit ended the program (SystemExit: 0)"),
        ("leave", "crashed: its process ended by itself, with status 0"),
        ("abort", "crashed: its process was ended by SIGABRT"),
        ("eat", "out of memory: it takes more than 400 MB"),
        ("boast", "crashed: InputError: the estimator failing.Boast is broken: its estimate"),
    ],
)  # fmt: skip
def test_a_method_that_fails_gets_a_status_in_one_line(name, status, plugged):
    with pytest.raises(NoScore) as caught:
        apart(name, Limits(memory_mb=400))
    assert caught.value.status.startswith(status)
    assert "\n" not in caught.value.status
    assert "; run 0, after 0 of 4 trials" in caught.value.status
    if name == "crash":
        assert "Traceback" in caught.value.output, "for its author"


def test_a_method_that_hangs_is_ended(plugged):
    with pytest.raises(
        NoScore, match=r"^timed out: a trial took more than 0\.5 s; run 0, after 0 of 4 trials"
    ):
        apart("hang", Limits(trial_s=0.5))


def test_a_method_may_print(plugged, capfd):
    assert len(apart("print").trials.truth) == 4
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"name": "gues"}, "did you mean 'guess'"),
        ({"name": "guess", "set": {"spread": -1}}, "spread"),
        ({"name": "guess", "readings": 500}, "500 readings a trial"),
    ],
)
def test_what_is_asked_wrongly_is_the_users_mistake(words, said, plugged):
    with pytest.raises(InputError, match=said):
        apart(words.pop("name"), **words)
