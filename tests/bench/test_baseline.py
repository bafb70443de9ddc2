"""The baseline `nearest` stands beside the others, and remembering readings is not enough for any default task."""

import json

import pytest

from tactsim.bench.config import run_config
from tactsim.bench.experiment import perform
from tactsim.bench.sweep import read, suites

# The paper's protocol tests at the training poses: there it is enough, which is why the default is another one.
# Recordings are not ours to ship; the tasks of regions are those of other suites, and objects in space.
DEFAULT_TASKS = [name for name in suites() if not name.startswith(("paper", "recordings", "regions"))]
MOST = 0.95


def right_at_once(config):
    """Give the accuracy of `nearest` after one reading of a run's task."""
    words = config.model_dump(exclude_unset=True) | {"estimator": "nearest", "readings": 1}
    words["trials"] = min(20, config.trials)  # a frozen task has no more than it says
    for name in ("bins", "particles", "set"):
        words.pop(name, None)
    if words.get("explore") == "information":  # the same touches; which of them it cannot choose
        words["explore"] = "blind"
    return perform(run_config(**words)).summary["accuracy"][0]


@pytest.mark.parametrize("explore", [pytest.param("random", marks=pytest.mark.long), "blind"])
def test_the_default_run_is_not_done_by_remembering(explore):
    assert right_at_once(run_config(explore=explore)) <= MOST
    if explore == "random":
        assert right_at_once(run_config(test_poses="same")) > MOST  # so the check can fail


@pytest.mark.slow
@pytest.mark.parametrize("name", DEFAULT_TASKS)
def test_no_default_task_is_done_by_remembering(name):
    tasks = {}
    for config in read(name)[1]:
        if config.seed == 0:
            key = json.dumps([config.scan_options.model_dump(mode="json"), config.explore == "random"])
            tasks.setdefault(key, config)
    assert {key: right for key, task in tasks.items() if (right := right_at_once(task)) > MOST} == {}
