"""Print how exact the press is: every taxel of every press of A-Z and 0-9 against an exact reference.

python tests/press/measure_accuracy.py

Errors of the worst taxel of a press are given in kPa, in % of the highest taxel of the exact reading (the
peak) and in % of the contact pressure F / A. Slivers, which touch less than 4 mm^2, stand apart: their pressure
is so high that little of it flatters what the taxels read.
"""

import numpy as np
from level_world import level_press, level_scan
from test_accuracy import LEAST_AREA

from tactsim import models
from tactsim.bench.stress.exact_readings import expected_reading
from tactsim.press.engine import press_at
from tactsim.press.scan_poses import grid_poses
from tactsim.press.touches import Touches

ENGINES = [("exact", {"cells_per_taxel": cells}) for cells in (1, 2, 3)]
ENGINES += [("bed", {"cells_per_taxel": 2})]
ENGINES += [("collide", {"points_per_taxel": points}) for points in (24, 48, 96)]


def main() -> None:
    """Print a row for each engine and fineness."""
    pad, poses = level_scan().pad, grid_poses()
    truth = {
        name: [expected_reading(models.letter(name).footprint, pose, pad) for pose in poses]
        for name in models.names()
    }
    area = np.array([area for found in truth.values() for _, area in found])
    expected = np.array([reading for found in truth.values() for reading, _ in found])
    touching = area > 0
    area, expected = area[touching], expected[touching]
    contact, peak = 2e3 / area, expected.max(axis=1)
    print(
        "| engine | 95 % of taxels below | largest | worst taxel / peak, 95 % below, largest "
        "| / contact pressure, largest | slivers: / peak, 95 % below, largest | / contact pressure, largest |"
    )
    for engine, press in ENGINES:
        options = level_scan(press=level_press(engine=engine, wrist_stiffness=None, **press))
        got = [press_at(Touches.of(models.letter(name), poses), options).readings(options) for name in truth]
        errors = np.abs(np.concatenate(got)[touching] - expected)
        worst = errors.max(axis=1)
        enough = area >= LEAST_AREA
        columns = [f"{np.percentile(errors[enough], 95):.4f} kPa", f"{errors[enough].max():.3f} kPa"]
        for some in (enough, ~enough):
            of_peak = 100 * worst[some] / peak[some]
            columns.append(f"{np.percentile(of_peak, 95):.3f} %, {of_peak.max():.3f} %")
            columns.append(f"{100 * (worst[some] / contact[some]).max():.3f} %")
        print(f"| {engine}, {next(iter(press.values()))} | {' | '.join(columns)} |", flush=True)
    print(f"{len(area)} presses, of which {np.count_nonzero(area < LEAST_AREA)} slivers")


if __name__ == "__main__":
    main()
