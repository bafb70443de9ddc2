"""What identifies the trials of a plan."""

from tactsim.bench import trial_plan
from tactsim.bench.trial_plan import source_of_trials
from tactsim.core.source_digest import source_of


def test_trials_depend_on_the_press_only_if_they_press(monkeypatch):
    monkeypatch.setattr(trial_plan, "source_digest", lambda *modules: "\n".join(source_of(*modules)))
    press, touching = "tactsim.press.clip", "tactsim.bench.touching"
    assert press not in source_of_trials("histogram").split()
    assert press in source_of_trials("synthesis").split()
    assert {press, touching} <= set(source_of_trials("histogram", on_demand=True).split())
