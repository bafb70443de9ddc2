"""Kinds of run: another one hangs on by its class alone, and nobody loads one that is not asked for."""

import subprocess
import sys
from typing import ClassVar, Literal

import numpy as np
import pytest
from command_line import refused

from tactsim.bench import kinds
from tactsim.bench.compare import compare
from tactsim.bench.config import RunConfig
from tactsim.bench.experiment import perform
from tactsim.bench.plane import Plane
from tactsim.bench.runs.saved import load
from tactsim.bench.trials import Trials
from tactsim.core import Scan
from tactsim.estimators import registry
from tactsim.estimators.filters.histogram import HistogramFilter


class UprightTrials(Trials):
    kind = "upright"


class UprightScan(Scan):
    kind = "upright"


class UprightConfig(RunConfig):
    kind: ClassVar[str] = "upright"
    task: Literal["upright"] = "upright"
    estimator: str = "upright-histogram"


class UprightHistogram(HistogramFilter):
    KIND = "upright"


class Upright(Plane):
    """Letters that nobody turns."""

    name, thing, touch, touches = "upright", "character", "print", "prints"
    config, trials = UprightConfig, UprightTrials
    columns = tuple(name.replace("reading_number", "print_number") for name in Plane.columns)

    def configured(self, **words):
        return UprightConfig(**words)

    def gather(self, config, **how):
        found = super().gather(config, **how)
        own = UprightScan(**{name: getattr(found.scan, name) for name in Scan._ARRAYS}, meta=found.scan.meta)
        return kinds.Gathered(own, found.letters, found.work, found.seconds, found.objects)

    def hide(self, scan, rng):
        return super().hide(scan, rng) * [1, 1, 0]


@pytest.fixture
def upright(monkeypatch):
    monkeypatch.setitem(kinds._KINDS.built_in, "upright", ("test_kinds:Upright", "letters that nobody turns"))
    monkeypatch.setitem(registry.BUILT_IN, "upright-histogram", ("test_kinds:UprightHistogram", "for tests"))


def test_a_third_kind_is_run_saved_loaded_compared_and_shown(upright, here, tmp_path):
    words = ["--letters", "LT", "--trials", "2", "--readings", "3", "--bins", "500"]
    said = here("run", "--task", "upright", "--out", "a", *words).stdout
    assert "name the character" in said
    assert "right after 3 prints" in said
    run = load(tmp_path / "a")
    assert (run.kind.name, run.task, run.letters) == ("upright", "upright", ["L", "T"])
    assert not run.trials.true_pose[..., 2].any()
    assert run.trials.true_pose[..., :2].any()
    assert (tmp_path / "a" / "prints.png").exists()
    again = perform(kinds.of_task("upright").configured(letters="LT", trials=2, readings=3, bins=500))
    assert np.array_equal(again.trials.pose, run.trials.pose)
    assert compare(run, again)[0].name == "share of prints right"
    assert "upright" in here("table", "a").stdout
    refused(here("run", "--task", "upright", "--estimator", "histogram"), "is for runs of kind plane")


@pytest.mark.long
def test_a_run_in_the_plane_loads_no_other_kind():
    script = (
        "import sys, tactsim\n"
        "tactsim.run(letters='LT', trials=1, readings=1)\n"
        "print([name for name in sys.modules if name.startswith(('tactsim.solids', 'tactsim.attach'))])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
