"""Keep a release's times in results/benchmarks, and draw those of all: `python history.py VERSION.json TIMED...`.

`make bench` calls it with the files that pytest-benchmark wrote. A panel for each benchmark, its least time in ms over
the releases; docs/performance.md shows it.
"""

import json
import sys
from pathlib import Path

import numpy as np
from check import ROOT, read, releases
from matplotlib import rc_context
from matplotlib.figure import Figure

PICTURE = ROOT / "docs" / "pictures" / "speed-over-time.svg"


def keep(path, timed):
    """Keep of each benchmark the quickest of several timings: what else a machine does slows some of them."""
    contents = [json.loads(Path(one).read_text()) for one in timed]
    same = zip(*(content["benchmarks"] for content in contents), strict=True)
    quickest = [min(timings, key=lambda one: one["stats"]["min"]) for timings in same]
    Path(path).write_text(json.dumps(contents[0] | {"benchmarks": quickest}, indent=4) + "\n")


def draw(kept, path):
    """Draw one panel a benchmark; a release on another machine has another colour."""
    found = list(map(read, kept))
    names = list(dict.fromkeys(name for one in found for name in one))
    processors = np.array([one["machine_info"]["processor"] for one in kept])
    rows = -(-len(names) // 4)
    figure = Figure(figsize=(11, 2 * rows), layout="constrained")
    panels = figure.subplots(rows, 4)
    for panel, name in zip(panels.flat, names, strict=False):
        times = np.array([1e3 * one[name][0] if name in one else np.nan for one in found])
        for processor in dict.fromkeys(processors):
            panel.plot(np.where(processors == processor, times, np.nan), "o-", label=processor)
        panel.set_xticks(range(len(kept)), [one["release"] for one in kept])
        panel.set_title(
            name.removeprefix("test_").replace("_", " ").replace("[", ", ").rstrip("]"), fontsize=9
        )
        panel.set_ylim(0, 1.1 * np.nanmax(times))
    for panel in panels.flat[len(names) :]:
        panel.axis("off")
    figure.supylabel("least processor time, ms", fontsize=9)
    if len(set(processors)) > 1:
        figure.legend(*panels.flat[0].get_legend_handles_labels(), loc="outside lower right", fontsize=9)
    with rc_context({"svg.hashsalt": "tactsim", "svg.fonttype": "none"}):
        figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    keep(sys.argv[1], sys.argv[2:])
    draw(releases(), PICTURE)
