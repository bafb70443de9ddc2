"""What a command costs as a whole, imports and pictures included: processor time of its process and all below it.

`python tests/bench/bench_startup.py` prints a table, in a minute on a quiet machine: seconds, and the same in units of
a fixed piece of work that is done in turns with the commands, since seconds say nothing about another machine.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

BENCH = Path(sys.executable).parent / "bench"
REFERENCE = [
    sys.executable,
    "-I",
    "-c",
    "import ast, inspect; t = inspect.getsource(ast)\nfor _ in range(12): ast.parse(t)",
]
HISTOGRAM = ["run", "--estimator", "histogram", "--bins", "10000"]
# name: the command, and the seconds of processor time that are asked for, None where the clock is what counts
CASES = {
    "bench --help": (["--help"], 0.3),
    "histogram, scan cached": (HISTOGRAM, 3.0),
    "histogram, --no-cache": ([*HISTOGRAM, "--no-cache"], 3.5),
    "bench run": (["run"], 6.0),
    "bench run --jobs 2": (["run", "--jobs", "2"], None),
}
ROUNDS = 3


def seconds(words, folder):
    """Run a program once: seconds of processor time, of its children too, and by the clock."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    subprocess.run(words, cwd=folder, env=environment, check=True, capture_output=True)
    passed, after = perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, passed


def main():
    """Time all cases in turns and print the table."""
    times = {name: [] for name in ("reference", *CASES)}
    with tempfile.TemporaryDirectory() as folder:
        for name in ("bench run", "histogram, scan cached"):  # what is compiled and pressed once is there
            seconds([BENCH, *CASES[name][0]], folder)
        for _ in range(ROUNDS):
            times["reference"].append(seconds(REFERENCE, folder))
            for name, (words, _) in CASES.items():
                out = [] if words == ["--help"] else ["--out", tempfile.mktemp(dir=folder)]
                times[name].append(seconds([BENCH, *words, *out], folder))
    unit = median(cpu for cpu, _ in times["reference"])
    print(f"{'command':26}{'asked s':>9}{'processor s':>13}{'x reference':>13}{'clock s':>9}")
    for name, measured in times.items():
        cpu, clock = (median(column) for column in zip(*measured, strict=True))
        asked = CASES[name][1] if name in CASES else None
        print(f"{name:26}{asked or '':>9}{cpu:13.2f}{cpu / unit:13.1f}{clock:9.2f}")


if __name__ == "__main__":
    main()
