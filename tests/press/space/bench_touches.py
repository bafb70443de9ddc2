"""Print what a touch in space costs, how exact it is, and what a soft layer feels that a stiff one does not.

    python tests/press/space/bench_touches.py

Processor time of one core, kernels compiled before. Exact is the press of relief, which integrates over each facet that
is seen; an error is that of a touch's worst taxel as a share of the reading's peak.
"""

from __future__ import annotations

from time import process_time
from types import SimpleNamespace

import numpy as np

from tactsim import models
from tactsim.core.poses import FloatArray
from tactsim.core.rigid import matrix
from tactsim.models.relief import Relief
from tactsim.press import PressOptions, ScanOptions, relief
from tactsim.press.space import SpaceOptions, SpacePress, random_starts
from tactsim.press.touches import Touches

EACH = 84  # touches of each of twelve solids: 1,008
FEW = 10  # of each that are worked out exactly too


def exact(solid: models.Solid, starts: FloatArray, options: SpaceOptions) -> FloatArray:
    """Press as the engine relief does, which sees the object from outside, so that y is turned."""
    layer = PressOptions(stiffness=options.stiffness, thickness=options.thickness, wrist_stiffness=None)
    given = ScanOptions(placement_tilt=0.0, press=layer)
    turns = matrix(starts[:, 3:]) * (1.0, -1.0, -1.0)
    poses = np.einsum("ni,nij->nj", starts[:, :3], turns) * (1.0, 1.0, 0.0)
    seen = SimpleNamespace(relief=Relief(solid.vertices, solid.faces))
    pressed = relief.press(Touches(seen, poses, np.zeros((len(starts), 2)), turns), given)
    rows, columns = options.pad.rows, options.pad.columns
    return pressed.readings(given).reshape(-1, rows, columns)[:, ::-1].reshape(-1, rows * columns)


def main() -> None:
    """Print the rows."""
    solids = [models.solid(name) for name in SpaceOptions().objects]
    starts = {one.name: random_starts(one, EACH, np.random.default_rng(1)) for one in solids}
    press = SpacePress(solids, SpaceOptions())
    before = process_time()
    found = {name: press.touch(name, start) for name, start in starts.items()}
    ours = (process_time() - before) / (EACH * len(solids))
    print(f"1,000 touches of the twelve: {1e3 * ours:.2f} s")
    before, off = process_time(), []
    for one in solids:
        expected = exact(one, starts[one.name][:FEW], press.options)
        met = found[one.name].met[:FEW]
        wrong = np.abs(found[one.name].readings[:FEW] - expected)[met].max(axis=1)
        off.append(wrong / expected[met].max(axis=1))
    theirs = (process_time() - before) / (FEW * len(solids))
    print(f"the exact press takes {theirs / ours:.0f} times as long")
    print("error, median, 95 % and largest:", *np.quantile(np.concatenate(off), (0.5, 0.95, 1)).round(4))
    for stiffness, thickness in ((50.0, 3.0), (1000.0, 1.0)):
        layer = SpacePress(solids, SpaceOptions(stiffness=stiffness, thickness=thickness))
        readings = np.concatenate([layer.touch(name, start).readings for name, start in starts.items()])
        peak = readings.max(axis=1)
        felt = (readings > 0.2 * peak[:, None])[peak > 0].sum(axis=1)
        print(
            f"{stiffness:g} kPa/mm: taxels above 20 % of the peak, median {np.median(felt):g}; "
            f"median peak {np.median(peak[peak > 0]):.0f} kPa"
        )


if __name__ == "__main__":
    main()
