"""Compare an earlier commit with the working tree: `python tests/benchmarks/check.py [COMMIT]`; `make bench-check`.

Both run bench_speed.py, each its own, in turns on this machine with the same packages, so that what else goes on here
slows both alike. A benchmark is slower if its least time is more than a quarter above the commit's; what looks slower
is run again, up to MOST turns, since a minimum only falls. Figures have no noise, and must agree within 1e-9. Ends with
1 if one is slower, changed or gone. COMMIT: that of the newest file of results/benchmarks unless it is given.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "results" / "benchmarks"
TREES = Path(sys.prefix) / "benchmark"  # where earlier commits are unpacked, and their kernels stay compiled
BENCHMARKS = "tests/benchmarks/bench_speed.py"
SLOWER = 1.25
SAME = 1e-9  # how far a figure may move, relative to its size or to 1
LEAST, MOST = 2, 6  # turns
SERIAL = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "NUMBA")}
Found = dict[str, tuple[float, dict[str, float]]]  # {benchmark: (its least time, s, and its figures)}


def stop(words: str) -> NoReturn:
    """End with the status of a user's mistake."""
    print(words, file=sys.stderr)
    sys.exit(2)


def releases(folder: Path = KEPT) -> list[dict]:
    """Read what `make bench` kept, in the order of the commits."""
    kept = [json.loads(path.read_text()) | {"release": path.stem} for path in folder.glob("*.json")]
    return sorted(kept, key=lambda one: one["commit_info"]["time"])


def read(content: dict) -> Found:
    """Give the minima and the figures of pytest-benchmark's JSON; the names of machine and commit are no figures."""
    found = {}
    for one in content["benchmarks"]:
        figures = {name: value for name, value in one["extra_info"].items() if not isinstance(value, str)}
        found[one["name"]] = one["stats"]["min"], figures
    return found


def run(tree: Path, names: list[str]) -> Found:
    """Run the benchmarks of a tree with its own code; names: those to be run, all if there are none."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "found.json")
        tests = [f"{BENCHMARKS}::{name}" for name in names] or [BENCHMARKS]
        words = [sys.executable, "-m", "pytest", "-q", "-m", "benchmark", "--benchmark-only", *tests]
        words.append(f"--benchmark-json={out}")
        # A check within a test run of several workers is none of these.
        outside = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
        environment = outside | SERIAL | {"PYTHONPATH": str(tree), "BENCH_ROUNDS": "3"}
        done = subprocess.run(words, cwd=tree, env=environment, capture_output=True, text=True)
        if done.returncode:
            stop(f"the benchmarks fail with the code in {tree}:\n{done.stdout}{done.stderr}")
        return read(json.loads(out.read_text()))


def unpack(commit: str) -> Path:
    """Give the files of a commit in a folder of its own, unpacked there the first time."""
    tree = TREES / commit
    if not tree.is_dir():
        begun = tree.with_suffix(".begun")
        begun.mkdir(parents=True, exist_ok=True)
        archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-x", "-C", begun], input=archive, check=True)
        begun.rename(tree)
    return tree


def least(first: Found, second: Found) -> Found:
    """Join two turns: the lesser time of each benchmark, and the figures of the later turn."""
    both = first | second
    return {name: (min(f[name][0] for f in (first, second) if name in f), both[name][1]) for name in both}


def slower(base: Found, new: Found) -> list[str]:
    """Name the benchmarks of both that take more than SLOWER times as long."""
    return [name for name in base if name in new and new[name][0] > SLOWER * base[name][0]]


def judge(base: Found, new: Found) -> list[str]:
    """Say in a line each what became worse: slower or gone benchmarks, figures that changed or are gone."""
    bad = [f"slower   {name}: {new[name][0] / base[name][0]:.2f} times" for name in slower(base, new)]
    for name, (_, figures) in base.items():
        if name not in new:
            bad.append(f"gone     {name}")
            continue
        for what, before in figures.items():
            after = new[name][1].get(what)
            if after is None or not abs(after - before) <= SAME * max(1, abs(before)):
                bad.append(f"changed  {name} {what}: {before:.12g} -> {after}")
    return bad


def main(words: list[str]) -> int:
    """Compare, print each ratio and what became worse; returns the exit status."""
    if not words and not releases():
        stop(f"{KEPT} is empty: name a commit, or run `make bench`")
    name = words[0] if words else releases()[-1]["commit_info"]["id"]
    asked = ["git", "rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}"]
    commit = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True).stdout.strip()
    if not commit:
        stop(f"{name} is no commit of this repository; fetch it, or name another")
    tree, base, new, turn, suspects = unpack(commit), {}, {}, 0, []
    while turn < LEAST or (suspects and turn < MOST):
        again = suspects if turn >= LEAST else []
        base, new, turn = least(base, run(tree, again)), least(new, run(ROOT, again)), turn + 1
        suspects = slower(base, new)
        print(f"turn {turn}, slower so far: {', '.join(suspects) or 'none'}", file=sys.stderr, flush=True)
    for benchmark in new:
        ratio = f"{new[benchmark][0] / base[benchmark][0]:.2f}" if benchmark in base else "new"
        print(f"{ratio:>5}  {benchmark}")
    worse = judge(base, new)
    print("\n".join(worse or [f"nothing is worse than at {commit[:12]}, in {turn} turns"]))
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
