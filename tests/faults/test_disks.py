"""A disk that is full or read-only: one line, nothing half-written, and all is well once there is room."""

import shutil
import subprocess
from pathlib import Path

import pytest
from command_line import BENCH

import tactsim
from tactsim.bench import experiment, sweep

# A file system of one's own in a namespace of one's own: nothing is left mounted, whatever happens.
IN_NAMESPACE = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-eu", "-c"]


def can_mount():
    if shutil.which("unshare") is None:
        return False
    words = [*IN_NAMESPACE, "mount -t tmpfs tmpfs /mnt && mount -o remount,ro /mnt"]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0


pytestmark = pytest.mark.skipif(not can_mount(), reason="may not mount a file system in a namespace")


def on_small_disk(bench, script, size):
    """Run a script with $BENCH in a folder that has a tmpfs of `size` at `disk`; returns what it printed."""
    (bench.folder / "disk").mkdir(exist_ok=True)
    result = subprocess.run(
        [*IN_NAMESPACE, f"mount -t tmpfs -o size={size} tmpfs disk\n{script}"],
        cwd=bench.folder, env=bench.environment | {"BENCH": str(BENCH)}, text=True, capture_output=True,
        timeout=240, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "Traceback" not in result.stderr, result.stderr
    return result


SMALL = "--estimator histogram --trials 2 --readings 3 --bins 100"


@pytest.mark.long
def test_a_recording_on_a_full_disk_leaves_its_name_free(bench):
    result = on_small_disk(
        bench,
        """
        cat /dev/zero > disk/filler 2> /dev/null || true
        if $BENCH record --port simulated:A --seconds 1 --out disk/a.tactrec; then exit 9; else echo status $?; fi
        ls -A disk
        rm disk/filler
        mount -o remount,size=20m disk
        $BENCH record --port simulated:A --seconds 1 --out disk/a.tactrec > /dev/null && ls -A disk
        """,
        size="64k",
    )
    assert result.stdout.split() == ["status", "2", "filler", "a.tactrec"]
    assert "No space left" in result.stderr


@pytest.mark.long
def test_a_sweep_on_a_full_disk_goes_on_when_there_is_room(bench, scan_file):
    (bench.folder / "s.toml").write_text(
        f'[defaults]\nscan = "{scan_file}"\ntrials = 50\nreadings = 3\n'
        '[[run]]\nestimator = "histogram"\nbins = [100, 200]\n'
    )
    result = on_small_disk(
        bench,
        """
        if $BENCH sweep s.toml --jobs 1 --out disk/sweep; then exit 9; else echo status $?; fi
        ls disk/sweep/runs 2>/dev/null | wc -l
        mount -o remount,size=20m disk
        $BENCH sweep s.toml --jobs 1 --out disk/sweep > /dev/null
        mv disk/sweep/runs runs
        """,
        size="150k",
    )
    assert "No space left" in result.stderr
    status, code, before = result.stdout.split()
    assert (status, code) == ("status", "2")
    assert int(before) < 2
    whole = bench.folder / "whole"
    whole.mkdir()
    configs = sweep.read(str(bench.folder / "s.toml"))[1]
    for run in sweep.perform(configs, whole, jobs=1, progress=experiment.silent):
        kept = bench.folder / "runs" / run.name / "trials.csv"
        assert kept.read_bytes() == (run / "trials.csv").read_bytes()


@pytest.mark.long
def test_a_cache_on_a_full_or_read_only_disk_is_done_without(bench):
    bench.environment["TACTSIM_CACHE_DIR"] = "disk"
    result = on_small_disk(
        bench,
        """
        $BENCH scan --letters I --out full.npz > /dev/null && ls -A disk
        mount -o remount,size=10m,ro disk
        $BENCH scan --letters I --out read-only.npz > /dev/null && ls -A disk
        mount -o remount,rw disk
        $BENCH scan --letters I --out kept.npz > /dev/null && ls disk/*.readings | wc -l
        mount -o remount,ro disk
        $BENCH scan --letters I --out again.npz | grep -c "from the cache 384"
        """,
        size="20k",
    )
    assert result.stdout.split() == ["2", "1"], "what is kept is read from a read-only disk"
    contents = {(bench.folder / name).read_bytes() for name in ("full.npz", "read-only.npz", "kept.npz")}
    assert len(contents) == 1


@pytest.mark.parametrize(
    "words",
    [
        "scan --letters I --out disk/new/out.npz",
        pytest.param("sweep quick --out disk/sweep", marks=pytest.mark.long),
    ],
)
def test_a_read_only_folder_is_said_before_the_work(bench, words):
    result = on_small_disk(
        bench,
        f"""
        mount -o remount,ro disk
        if $BENCH {words}; then exit 9; else echo status $?; fi
        """,
        size="1m",
    )
    assert result.stdout.split() == ["status", "2"]
    (line,) = (line for line in result.stderr.splitlines() if line.startswith("bench:"))
    assert "disk" in line
    assert "pressing" not in result.stderr


@pytest.mark.long
def test_a_read_only_installation_without_a_home_gives_the_same_results(bench, scan_file):
    tree = Path(tactsim.__file__).parents[1]
    words = f"run --scan {scan_file} {SMALL}"
    assert bench(*words.split(), "--out", "usual").returncode == 0
    del bench.environment["TACTSIM_CACHE_DIR"]
    result = on_small_disk(
        bench,
        f"""
        mkdir disk/tmp disk/home
        mount -t tmpfs tmpfs disk/home && mount -o remount,ro disk/home
        mount --bind {tree} {tree} && mount -o remount,ro,bind {tree}
        export HOME=$PWD/disk/home TMPDIR=$PWD/disk/tmp
        unset XDG_CACHE_HOME XDG_CONFIG_HOME
        $BENCH {words} --out read-only > /dev/null
        ls -A $TMPDIR/tactsim-*
        """,
        size="20m",
    )
    assert "matplotlib" in result.stdout.split()
    assert "matplotlib" not in result.stderr.lower()
    for name in ("trials.csv", "summary.json"):
        assert (bench.folder / "usual" / name).read_bytes() == (
            bench.folder / "read-only" / name
        ).read_bytes()
