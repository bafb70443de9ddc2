"""The process of a plug-in: the same answers as without it, only the knowledge that is due, a status for failures."""

from dataclasses import fields, replace

import numpy as np
import pytest

from tactsim.bench import experiment
from tactsim.bench.leaderboard.confined import Limits, NoScore
from tactsim.bench.leaderboard.confined_trials import confined_processes, run_trials_confined
from tactsim.bench.trials import OneTrial, Trials, run_trials
from tactsim.core import InputError
from tactsim.estimators.estimator import about_estimator

SMALL = Limits(fit_s=60, trial_s=60, memory_mb=400)


def behind_fences(plan, tasks, jobs=1, limits=SMALL, rng=0):
    with confined_processes(plan.estimator, plan.options, jobs, limits) as processes:
        trials, work = run_trials_confined(
            plan, tasks, processes, rng=np.random.default_rng(rng), progress=experiment.silent
        )
        return trials, work, processes[0]


@pytest.fixture
def confine(plugged, gathered, small_config):
    """Do the trials of a small run behind the fence."""

    def run(name, limits=SMALL, jobs=1, rng=0, count=2, **words):
        config = small_config(estimator=name, **words)
        plan = experiment.plan_of(config, gathered.scan)
        tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(count)]
        return behind_fences(plan, tasks, jobs, limits, rng)

    return run


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


@pytest.mark.long
@pytest.mark.parametrize(
    "words",
    [
        {"estimator": "tempered", "particles": 200},
        {"estimator": "synthesis", "set": {"modes": 50}},
        {"estimator": "histogram", "bins": 100, "hold_out": "each", "slip": {"walk_mm": 0.5}},
    ],
    ids=lambda words: words["estimator"],
)
def test_a_built_in_estimator_answers_the_same_behind_the_fence(words, gathered, small_config):
    config = small_config(**words)
    plan = experiment.plan_of(config, gathered.scan)
    tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(2)]
    free, work = run_trials(plan, plan.fitted(), tasks, progress=experiment.silent)
    behind, same_work, estimator = behind_fences(plan, tasks)
    assert differing(free, behind) == []
    assert work == same_work
    about = about_estimator(plan.make())
    assert about == about_estimator(estimator) | {"settings": estimator.settings}
    assert (behind.update_s > 0).all()


def test_a_plug_in_answers_the_same_in_any_order_and_number_of_processes(confine):
    one, work, estimator = confine("guess", set={"spread": 2.0})
    two, same_work, _ = confine("guess", set={"spread": 2.0}, jobs=2, rng=1)
    assert differing(one, two) == []
    assert work == same_work
    assert estimator.settings == {"spread": 2.0}
    assert estimator.describe() == "spread 2.0"


@pytest.mark.parametrize("explore", ["random", "information"])
def test_a_plug_in_answers_as_it_does_in_the_harness(explore, gathered, small_config, imported):
    plan = replace(experiment.plan_of(small_config(estimator="choosy"), gathered.scan), explore=explore)
    tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(2)]
    behind, *_ = behind_fences(plan, tasks)
    guess = imported("guess")
    given = replace(plan, given=guess.Choosy(guess.GuessOptions()))
    free, _ = run_trials(given, given.fitted(), tasks, progress=experiment.silent)
    assert differing(free, behind) == []
    assert len(np.unique(free.label)) == 2


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("crash", "crashed: KeyError: \"a bug of the plug-in's\" (failing.py, line"),
        ("exit", "crashed: SystemExit: 0 (failing.py, line"),
        ("leave", "crashed: its process ended by itself, with status 0"),
        ("abort", "crashed: its process was ended by SIGABRT"),
        ("eat", "out of memory: it takes more than 400 MB"),
        ("fork", "forbidden: a plug-in may not start a process (os.fork)"),
        ("program", "forbidden: a plug-in may not start a program (os.system)"),
        ("kill", "forbidden: a plug-in may not send a signal (os.kill)"),
        ("network", "forbidden: a plug-in may not use the network (socket."),
        ("boast", "crashed: InputError: the estimator failing.Boast is broken: its estimate"),
        ("forge", "crashed: its process answered what it should not: a message of"),
        ("files", "peeked: listed "),
        ("notes", "peeked: opened /etc/passwd"),
        ("neighbour", "peeked: opened /proc/"),
        ("write", "forbidden: a plug-in may not write "),
    ],
)  # fmt: skip
def test_a_plug_in_that_fails_gets_a_status_in_one_line(name, status, confine, site):
    with pytest.raises(NoScore) as caught:
        confine(name)
    assert caught.value.status.startswith(status)
    assert "\n" not in caught.value.status
    if name == "crash":
        assert "Traceback" in caught.value.output, "for its author"
        assert "; seed 0, letter " in caught.value.status
    assert {path.name for path in site.iterdir()} == {"plugged-1.0.dist-info"}


def test_a_plug_in_that_hangs_is_ended(confine):
    with pytest.raises(NoScore, match=r"^timed out: a trial took more than 0\.5 s; seed 0, letter"):
        confine("hang", limits=Limits(trial_s=0.5))


def test_a_plug_in_may_print_and_may_try_what_it_does_without(confine, capfd):
    assert len(confine("print")[0].truth) == 4
    assert len(confine("quietly")[0].truth) == 4
    assert capfd.readouterr() == ("", "")


def test_the_truth_is_nowhere_in_a_plug_ins_process(confine):
    assert len(confine("memory", count=1)[0].truth) == 2


def test_the_order_of_the_trials_tells_nothing(confine):
    right = confine("listen", count=20)[0].right[:, 0]
    assert 8 < right.sum() < 32, "a guess by the order is right in half of 40 trials, not in all or none"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"name": "gues"}, "did you mean 'guess'"),
        ({"name": "guess", "set": {"spread": -1}}, "spread"),
        ({"name": "guess", "set": {"width": 1}}, "unknown option 'width'"),
    ],
)
def test_what_is_asked_wrongly_is_the_users_mistake(words, said, confine):
    with pytest.raises(InputError, match=said):
        confine(words.pop("name"), **words)
