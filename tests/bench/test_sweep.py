"""Sweeps: what a file asks for, and that no kill, no second sweep and no dying worker loses or repeats a thing."""

import csv
import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from command_line import refused, wait_until
from small_runs import draw_nothing
from test_trials import Blind

from tactsim.bench import results, sweep
from tactsim.bench.experiment import perform, silent
from tactsim.core import InputError
from tactsim.estimators import registry

SMALL = """
[defaults]
letters = "IO"
trials = 30
readings = 3

[[run]]
estimator = "histogram"
bins = [100, 1000]
seed = [0, 1]
"""


def finish(process):
    output, errors = process.communicate(timeout=240)
    assert process.returncode == 0, errors
    return output


@pytest.fixture(scope="module")
def whole(tmp_path_factory, shared_cache):
    """Finish the small sweep once, undisturbed; tests compare with it or copy it."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "s.toml").write_text(SMALL)
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        sweep.perform(sweep.read(str(folder / "s.toml"))[1], folder / "whole", jobs=1, progress=silent)
    return folder / "whole"


def contents(folder):
    """Read all that must not differ between two sweeps: every file but the times."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(("times.", "."))
    }


def test_lists_stand_for_every_combination():
    configs = sweep.expand(
        {
            "defaults": {"trials": 3, "letters": "AE"},
            "run": [
                {"estimator": "histogram", "bins": [100, 1000], "scan_set": {"press": {"force": [1, 2]}}},
                {"estimator": "histogram", "bins": 100, "scan_set": {"press": {"force": 1}}},
            ],
        },
        "sweep",
    )
    assert len(configs) == 4, "the second table repeats a run of the first"
    assert {(c.options["bins"], c.scan_options.press.force) for c in configs} == {
        (100, 1.0), (100, 2.0), (1000, 1.0), (1000, 2.0),
    }  # fmt: skip
    assert all(c.trials == 3 and c.scan_options.letters == ("A", "E") for c in configs)


@pytest.mark.parametrize(
    ("content", "message"),
    [("[[run]]\nestimatr = 'histogram'", "estimatr"), ("[[run]]\ntrials = 0", "trials"),
     ("[defaults]\nbins = 1", r"no \[\[run\]\]"), ("[[run]", "not TOML"),
     ("[[run]]\nseed = [" + "1," * 400 + "]\ntrials = [" + "1," * 400 + "]", "100,000"),
     ("[[run]]\nbins = []", "list bins is empty")],
)  # fmt: skip
def test_a_wrong_file_is_refused_in_one_line(tmp_path, content, message):
    (tmp_path / "s.toml").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        sweep.read(str(tmp_path / "s.toml"))
    assert "\n" not in str(caught.value)


@pytest.mark.long
def test_a_method_of_ones_own_is_asked_the_same_as_those_of_a_sweep(here, tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(
        '[[run]]\nestimator = ["histogram", "refined"]\nbins = 1000\nseed = [0, 1]\nletters = "AE"\n'
    )
    _, configs = sweep.read(str(path), ["nearest"])
    asked = {(config.estimator, config.seed, config.bins) for config in configs}
    assert asked >= {("nearest", 0, None), ("nearest", 1, None), ("refined", 1, 1000)}
    assert len(configs) == 6  # beside each of the two, and done once
    assert {config.letters for config in configs} == {("A", "E")}
    refused(here("sweep", "two.toml", "--also", "nearst"), "did you mean 'nearest'")


@pytest.mark.long
def test_every_suite_can_be_read():
    assert {"quick", "paper"} <= set(sweep.suites())
    for suite in sweep.suites():
        name, configs = sweep.read(suite)
        assert name == suite
        assert sweep.count_runs(suite) == len(configs)


@pytest.mark.long
def test_a_sweep_gives_what_single_runs_give(here, tmp_path):
    (tmp_path / "s.toml").write_text(SMALL)
    output = here("sweep", "s.toml", "--out", "out", "--jobs", "2").stdout
    _, configs = sweep.read(str(tmp_path / "s.toml"))
    names = sorted(path.name for path in (tmp_path / "out" / "runs").iterdir())
    assert len(names) == len(configs) == 4
    assert output.count(" 100 bins") == output.count("1,000 bins") == 1  # the seeds of each are pooled
    run = perform(configs[0])
    (tmp_path / "single").mkdir()
    results.save(run, tmp_path / "single")
    places = sweep.perform(configs, tmp_path / "out", jobs=1, progress=silent)
    for name in ("trials.csv", "summary.json", "run.json"):
        assert (places[0] / name).read_bytes() == (tmp_path / "single" / name).read_bytes()


@pytest.mark.long
def test_a_sweep_goes_on_with_the_runs_that_are_missing(tmp_path, whole, undrawn):
    shutil.copytree(whole, tmp_path / "out")
    runs = tmp_path / "out" / "runs"
    kept, missing, *_ = sorted(path.name for path in runs.iterdir())
    written = (runs / kept / "times.json").read_bytes()
    (runs / missing).rename(runs / ".half-written.part")
    _, configs = sweep.read(str(whole.parent / "s.toml"))
    sweep.perform(configs, tmp_path / "out", jobs=2, progress=silent)
    assert contents(tmp_path / "out") == contents(whole)
    assert (runs / kept / "times.json").read_bytes() == written
    assert not list(runs.glob(".*"))


@pytest.mark.long
def test_a_sweep_does_not_go_on_beside_runs_of_another_source(tmp_path, whole):
    shutil.copytree(whole, tmp_path / "out")
    _, configs = sweep.read(str(whole.parent / "s.toml"))
    first, second = sorted((tmp_path / "out" / "runs").iterdir())[:2]
    about = json.loads((first / "run.json").read_text())
    (first / "run.json").write_text(json.dumps(about | {"source": "0" * 64}))
    sweep.perform(configs, tmp_path / "out", jobs=1, progress=silent)  # nothing is left to do
    shutil.rmtree(second)
    with pytest.raises(InputError, match=f"{first.name} was made by other source code"):
        sweep.perform(configs, tmp_path / "out", jobs=1, progress=silent)


def test_a_folder_that_holds_something_else_takes_no_sweep(here, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    refused(
        here("sweep", "quick", "--out", "run"), "--out run: the folder holds something already, and no sweep"
    )
    assert {path.name for path in (tmp_path / "run").iterdir()} <= {"run.json", ".lock"}


@pytest.mark.long
def test_a_folder_in_use_or_of_another_sweep_is_refused(bench, here, tmp_path):
    (tmp_path / "s.toml").write_text(SMALL)
    (tmp_path / "other.toml").write_text(SMALL.replace("trials = 30", "trials = 1"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".sweep.json.half.part").write_text("{")  # left by a sweep that was killed
    first = bench.start("sweep", "s.toml", "--out", "out", "--jobs", "1")
    wait_until(first, (tmp_path / "out" / "sweep.json").exists)
    first.send_signal(signal.SIGSTOP)  # it stays at work until the second has looked
    refused(here("sweep", "s.toml", "--out", "out"), "another sweep is at work")
    first.send_signal(signal.SIGCONT)
    finish(first)
    refused(here("sweep", "other.toml", "--out", "out"), "holds another sweep")


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@pytest.fixture
def cluster(bench, tmp_path):
    """Start a real scheduler and two real workers on loopback; gives the address and the workers."""
    address = f"tcp://127.0.0.1:{free_port()}"
    quiet = {
        "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path, "env": bench.environment,
    }  # fmt: skip
    bin_dir = Path(sys.executable).parent
    scheduler = subprocess.Popen(
        [bin_dir / "dask", "scheduler", "--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard"],
        **quiet,
    )  # fmt: skip
    workers = [
        subprocess.Popen(
            [bin_dir / "dask", "worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny", "--name", str(n)],
            **quiet,
        )
        for n in range(2)
    ]  # fmt: skip
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()


@pytest.mark.long
def test_a_dask_cluster_that_loses_a_worker_loses_nothing_and_does_nothing_twice(
    bench, here, drawn, tmp_path, cluster
):
    address, workers = cluster
    (tmp_path / "s.toml").write_text(SMALL.replace("trials = 30", "trials = 100"))
    process = bench.start("sweep", "s.toml", "--out", "far", "--dask", address)
    folder = tmp_path / "far" / "runs"
    wait_until(process, lambda: any(folder.glob("[!.]*")))
    workers[0].kill()
    finish(process)
    assert here("sweep", "s.toml", "--out", "near", "--jobs", "1").returncode == 0
    assert contents(tmp_path / "far") == contents(tmp_path / "near")
    for place in (tmp_path / "far" / "runs").iterdir():
        with (place / "trials.csv").open(newline="") as stream:
            rows = [(row["truth"], row["trial"], row["reading_number"]) for row in csv.DictReader(stream)]
        assert len(rows) == len(set(rows)) == 2 * 100 * 3


class OfOneThread(Blind):
    """Guess, but only in the thread in which it was fitted."""

    def fit(self, scan):
        super().fit(scan)
        self.thread = threading.get_ident()

    def update(self, reading, sensor_in_robot):
        assert self.thread == threading.get_ident()
        super().update(reading, sensor_in_robot)


@pytest.mark.long
def test_each_thread_of_a_dask_worker_has_an_estimator_of_its_own(monkeypatch, tmp_path, undrawn):
    monkeypatch.setitem(registry.BUILT_IN, "of-one-thread", ("test_sweep:OfOneThread", "for tests"))
    run = {"estimator": "of-one-thread", "letters": "IO", "trials": 100, "readings": 3}
    with pytest.importorskip("distributed").LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:
        pool = sweep.dask_pool(cluster.scheduler_address)
        sweep.perform(sweep.expand({"run": [run]}, "s"), tmp_path / "out", jobs=1, pool=pool, progress=silent)


@pytest.mark.parametrize(
    ("address", "says"),
    [("localhost", "such as tcp://localhost:8786"), ("tcp://:x", "such as tcp://localhost:8786"),
     ("tcp://localhost:1", "no scheduler answers there")],
)  # fmt: skip
def test_what_is_no_scheduler_is_refused_before_the_press(here, own_cache, monkeypatch, address, says):
    pytest.importorskip("distributed")
    monkeypatch.setattr(sweep, "SCHEDULER_ANSWERS_IN", 0.1)
    refused(here("sweep", "quick", "--dask", address), f"--dask {address}:", says)
    assert not list(own_cache.iterdir())
