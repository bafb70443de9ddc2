"""One side of the regression gate: prepare and time benchmarks, as asked for on standard input.

`python -P regression_worker.py FILE` runs with one version of the project first on the module path, so it
imports nothing of the project itself. FILE defines `BENCHMARKS`, {name: prepare}; `prepare()` returns the
work, and what gives the figures {name: value} of the work's result. A question is a line of JSON,
{"prepare": name} or {"calls": n}; an answer is one too. The benchmark that was prepared last is kept.
"""

import json
import os
import runpy
import sys
import time


def main(path: str) -> None:
    """Answer questions until standard input ends; what benchmarks print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    benchmarks = runpy.run_path(path)["BENCHMARKS"]
    print(json.dumps({"benchmarks": list(benchmarks), "modules": sorted(_files())}), file=answers)
    for line in sys.stdin:
        question = json.loads(line)
        if "prepare" in question:
            work, figures = benchmarks[question["prepare"]]()
            found = {name: float(value) for name, value in figures(work()).items()}
            start = time.process_time()  # the first call was the warm-up
            work()
            answer = {"figures": found, "seconds": time.process_time() - start}
        else:
            start = time.process_time()
            for _ in range(question["calls"]):
                work()
            answer = {"seconds": time.process_time() - start}
        print(json.dumps(answer), file=answers)


def _files() -> set[str]:
    """Give the files of the imported modules of the project."""
    modules = [module for name, module in sys.modules.items() if name.partition(".")[0] == "tactsim"]
    return {module.__file__ for module in modules if module.__file__ is not None}


if __name__ == "__main__":
    main(sys.argv[1])
