"""The process that runs are done in: a status for a method that fails, and its prints are kept apart."""

import pytest

from tactsim.bench.leaderboard.limited import Limits, NoScore, Wanted, limited_runs

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
